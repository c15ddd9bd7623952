"""Conform splats to a mesh, and carry them along with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F32, I32, I64
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import conform as kernels
from usdsplat.sim.closest import Hits, Triangles
from usdsplat.sim.fitting import growth, heights
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.parameters import ConformParameters, Parameters
from usdsplat.sim.relaxing import relax
from usdsplat.sim.specs import Surface
from usdsplat.sim.target_mesh import TargetMesh

NEIGHBORS = 16
"""Number of neighbours of a splat that define its spacing, and the capture's surface around it."""
MOST_GROWTH = 4.0
"""Largest factor by which splats grow or shrink as their spacing changes."""
FLAT = 0.15
"""Thickness of a flat splat, as a fraction of its mean size along the surface."""

SWEEPS = 240
"""Maximum number of redistribution sweeps over the target. All of them are needed if most splats
start on one side of it."""

_OWN, _ROWS = "own:", ("rest", "ids", "select", "axes", "flats")
"""Keys of the rest data of splats, which is stored because children are not in the capture."""

UNBOUND, HOPELESS = -1, -2
"""Values in place of a face: not bound yet, and cannot be bound because the position is not
finite."""

SCALE_MODES = {
    "preserve": kernels.PRESERVE,
    "density": kernels.DENSITY,
    "flatten": kernels.FLATTEN,
}

Rows = npt.NDArray[np.integer[Any]]
_NOTHING = (
    np.zeros(0, np.int32), np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32),
    np.zeros(0, np.float32),
)  # fmt: skip


class Conform:
    """Binding of each splat to the target: a triangle, a point on it, a height over it, and a
    rotation.

    Splats are bound by the first call of `apply`, and stay bound.

    Args:
        device: Runs the kernels.
        positions, rotations, scales: The splats at rest, shapes (n, 3), (n, 4), (n, 3).
        ids: Their identities, shape (n,).
        select: Weight of each, 0..1, shape (n,).
        parameters: `conform:order`, `mode`, `axis` and `path` are taken from here, `sim:seed`, and
            for optimalSpread `relax:strength` and the group `neighbors`.
    """

    def __init__(
        self,
        device: Device,
        positions: F32,
        rotations: F32,
        scales: F32,
        *,
        ids: I64,
        select: F32,
        parameters: Parameters,
    ) -> None:
        self._device = device
        self._all, self._parameters = parameters, parameters.conform
        self._rest, self._ids, self._select = positions, ids, select
        self._axes, self._flats = _shape(rotations, scales)
        self._memory: dict[str, npt.NDArray[Any]] = {}
        self._target: TargetMesh | None = None

    def __len__(self) -> int:
        return len(self._rest)

    @property
    def is_bound(self) -> bool:
        """Whether every splat is bound. If not, `apply` needs a gradient."""
        faces = self._memory.get("faces")
        return faces is not None and not (faces == UNBOUND).any()

    # --- births, deaths, restarts -------------------------------------------------------

    def extended(
        self, parents: Rows, positions: F32, rotations: F32, scales: F32, ids: I64
    ) -> Conform:
        """Return a copy with children appended. A child starts at the same time and keeps the same
        height as its parent, but is bound by its own position.

        Args:
            parents: Rows of the parents, shape (c,).
            positions, rotations, scales, ids: The children at rest.
        """
        n = len(self)
        other = self.selected(np.concatenate([np.arange(n), parents]))
        axes, flats = _shape(rotations, scales)
        other._rest = np.concatenate([self._rest, positions])
        other._ids = np.concatenate([self._ids, ids])
        other._axes = np.concatenate([self._axes, axes])
        other._flats = np.concatenate([self._flats, flats])
        if other._memory:
            other._memory["faces"][n:] = UNBOUND
        return other

    def selected(self, rows: Rows) -> Conform:
        """Return a copy with these rows only, in this order."""
        other = object.__new__(Conform)
        other._device, other._target = self._device, self._target
        other._all, other._parameters = self._all, self._parameters
        other._rest, other._ids = self._rest[rows], self._ids[rows]
        other._select, other._axes = self._select[rows], self._axes[rows]
        other._flats = self._flats[rows]
        other._memory = {name: array[rows] for name, array in self._memory.items()}
        return other

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return the binding and the rest state of the splats, first axis n."""
        own = {f"{_OWN}{name}": getattr(self, f"_{name}") for name in _ROWS}
        return {**self._memory, **own}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, for any number of splats, bit for bit."""
        for name in _ROWS:
            setattr(self, f"_{name}", memory[f"{_OWN}{name}"])
        self._memory = {key: each for key, each in memory.items() if not key.startswith(_OWN)}

    # --- one step -----------------------------------------------------------------------

    def apply(
        self,
        target: Surface,
        now: float,
        parameters: ConformParameters,
        positions: F32,
        gradient: F32 | None = None,
        factor: F32 | None = None,
    ) -> None:
        """Move splats towards the target.

        Args:
            target: The mesh now; only its points may change over time.
            now: Time since the simulation's start [s].
            parameters: Parameters now.
            positions: [unit], shape (n, 3), changed in place.
            gradient: Gradient of the deformation so far, shape (n, 3, 3), multiplied in place by
                the rotation and stretch of each splat.
            factor: Factor of the weight of each splat, shape (n,).

        Raises:
            StageError: If the target is not a mesh, or has other triangles than before.
        """
        if len(positions) == 0:
            return
        mesh = self._update_target(target)
        slopes = np.zeros((0, 3, 3), np.float32) if gradient is None else gradient
        self._bind(mesh, positions, slopes)
        bound = self._memory
        way = np.empty(len(positions), np.float32)
        timing = (
            float(parameters.weight), float(parameters.start),
            float(parameters.duration), float(parameters.stagger),
        )  # fmt: skip
        run = self._device.run
        select = self._select if factor is None else self._select * factor
        run(kernels.advance, float(now), timing, bound["ranks"], select, way)
        slide = _NOTHING
        if self._parameters.path == "slide":
            slide = self._slide(mesh, positions, way)
        names = ("faces", "places", "turns", "heights", "spreads", "sizes")
        run(
            kernels.move, positions, slopes, way, tuple(bound[name] for name in names),
            (target.points, target.triangles, mesh.normals, mesh.frames, mesh.sizes),
            (self._axes, self._flats),
            (
                float(parameters.orient),
                float(parameters.keep_thickness),
                SCALE_MODES[parameters.scale_mode],
            ),
            slide,
        )  # fmt: skip

    def _update_target(self, surface: Surface) -> TargetMesh:
        """Update the target's positions, if it has moved."""
        if self._target is None:
            self._target = TargetMesh(self._device, surface)
        else:
            self._target.update(surface)
        return self._target

    # --- what splats are bound to ---------------------------------------------------------

    def _bind(self, mesh: TargetMesh, positions: F32, gradient: F32) -> None:
        """Bind the splats that are not bound yet."""
        n = len(positions)
        is_first = not self._memory
        if is_first:
            self._memory = {
                "faces": np.full(n, UNBOUND, np.int32),
                "places": np.zeros((n, 3), np.float32),
                "turns": np.zeros((n, 4), np.float32),
                "heights": np.zeros(n, np.float32),
                "spreads": np.ones(n, np.float32),
                "sizes": np.zeros(n, np.float32),
                "ranks": np.zeros(n, np.float32),
            }
        kept = self._memory
        rows = np.flatnonzero(kept["faces"] == UNBOUND)
        if len(rows) == 0:
            return
        with phase("binding to the target", work=len(rows)):
            self._bind_rows(mesh, rows, positions, gradient, is_first=is_first)

    def _bind_rows(
        self, mesh: TargetMesh, rows: Rows, positions: F32, gradient: F32, *, is_first: bool
    ) -> None:
        """Bind some splats."""
        n, kept = len(positions), self._memory
        axes = np.empty_like(self._axes)
        self._device.run(kernels.look, gradient, self._axes, axes)
        hits = self._target_points(mesh.tree, positions[rows], axes[rows])
        if is_first:
            self._rank(hits)
        if is_first and self._parameters.mode == "optimalSpread":
            hits = self._spread(mesh, hits)
        kept["faces"][rows] = np.where(hits.faces < 0, HOPELESS, hits.faces)
        kept["places"][rows] = hits.weights
        rows = rows[hits.faces >= 0]
        kept["sizes"][rows] = mesh.sizes[kept["faces"][rows]]
        ups = np.zeros((n, 3), np.float32)
        self._device.run(
            kernels.attach, rows, axes, kept["faces"], kept["places"], mesh.normals, mesh.frames,
            kept["turns"], ups,
        )  # fmt: skip
        if is_first:
            near, _ = nearest(self._device, self._rest, self._rest, NEIGHBORS + 1)
            over, normals = heights(self._rest, near[:, 1:])
            side = np.einsum("ni,ni->n", normals, ups)
            kept["heights"] = np.where(side < 0, -over, over)
            kept["spreads"] = growth(self._rest, hits.points, near[:, 1:], MOST_GROWTH)

    def _target_points(self, tree: Triangles, points: F32, axes: F32) -> Hits:
        """Return the point on the target for each splat."""
        mode = self._parameters.mode
        hits = tree.closest(points)
        if mode == "projectAlong":
            axis = np.tile(np.array(self._parameters.axis, np.float32), (len(points), 1))
            ahead, behind = tree.rays(points, axis), tree.rays(points, -axis)
            hits = _choose(behind.faces >= 0, behind, hits)
            hits = _choose(ahead.faces >= 0, ahead, hits)
        elif mode == "normalRay":
            ahead, behind = tree.rays(points, axes), tree.rays(points, -axes)
            nearer = _choose(behind.squared < ahead.squared, behind, ahead)
            hits = _choose(nearer.faces >= 0, nearer, hits)
        return hits

    def _spread(self, mesh: TargetMesh, hits: Hits) -> Hits:
        """Return as many points, evenly distributed over the target."""

        spread, _ = relax(self._device, hits.points, None, self._all, SWEEPS, mesh.onto)
        return mesh.tree.closest(spread)

    def _rank(self, hits: Hits) -> None:
        """Store the order in which splats start, 0..1."""
        n = len(self)
        ranks = np.empty(n, np.float32)
        if self._parameters.order != "random":
            order = np.argsort(hits.squared, kind="stable")
            ranks[order] = np.linspace(0, 1, n, dtype=np.float32)
        else:
            self._device.run(kernels.draw_ranks, self._all.sim.seed, self._ids, ranks)
        self._memory["ranks"] = ranks

    def _slide(self, mesh: TargetMesh, positions: F32, way: F32) -> tuple[I32, F32, F32, F32]:
        """Return the mesh points nearest to straight paths.

        Returns:
            Faces and barycentric weights of these points, the points on the paths, and the heights
            of the starts of the paths over the mesh.
        """
        bound = self._memory
        line = np.empty_like(positions)
        surface = mesh.surface
        self._device.run(
            kernels.approach, positions, bound["faces"], bound["places"],
            (surface.points, surface.triangles), way, line,
        )  # fmt: skip
        # splats before their start or after their arrival use the point that they are bound to
        faces, places, over = bound["faces"].copy(), bound["places"].copy(), np.zeros_like(way)
        rows = np.flatnonzero((way > 0) & (way < 1))
        under, start = mesh.tree.closest(line[rows]), mesh.tree.closest(positions[rows])
        faces[rows], places[rows] = under.faces, under.weights
        ups = np.einsum("nk,nki->ni", start.weights, mesh.normals[start.faces])
        side = np.einsum("ni,ni->n", positions[rows] - start.points, ups)
        over[rows] = np.copysign(np.sqrt(start.squared), side)
        return faces, places, line, over


def _choose(which: npt.NDArray[np.bool_], yes: Hits, no: Hits) -> Hits:
    rows = which[:, None]
    return Hits(
        faces=np.where(which, yes.faces, no.faces),
        weights=np.where(rows, yes.weights, no.weights),
        squared=np.where(which, yes.squared, no.squared),
        points=np.where(rows, yes.points, no.points),
    )


def _shape(rotations: F32, scales: F32) -> tuple[F32, F32]:
    """Return the smallest axis of each splat, and the factor of its size that makes it flat."""
    smallest = np.argmin(scales, axis=1)
    rows = np.arange(len(scales))
    axes = quaternion.to_matrix(rotations)[rows, :, smallest]
    sizes = np.sort(scales, axis=1)
    thin = FLAT * np.sqrt(sizes[:, 1] * sizes[:, 2])
    flats = np.divide(thin, sizes[:, 0], out=np.ones_like(thin), where=sizes[:, 0] > thin)
    return np.ascontiguousarray(axes), flats
