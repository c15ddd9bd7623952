"""Conform splats to a mesh by transport: the capture covers it evenly, and neighbours stay
neighbours.

The outer carriers of the capture are mapped onto the mesh, see `transport_map`. Splats follow them,
lie on the surface at a part of their height, with sizes by the spacing there, and ride on the
mesh's triangles.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import conform as conform_kernels
from usdsplat.kernels.sim import landing as kernels
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.carrying import Carried, Carrying, Landing
from usdsplat.sim.conform import Rows
from usdsplat.sim.flying import TORN, Flight
from usdsplat.sim.grounds import MeshGround
from usdsplat.sim.parameters import ConformParameters, Parameters
from usdsplat.sim.sheets import MeshGoal, outer_sheet
from usdsplat.sim.specs import Surface
from usdsplat.sim.state import Frame
from usdsplat.sim.target_mesh import TargetMesh
from usdsplat.sim.transport_map import match

MOST = 20_000
"""Largest number of points that are transported."""

_MAP, _MESH = "map:", "mesh:"


class TransportConform:
    """Binding of each splat to the target, by transport of the capture's carriers.

    Splats are bound by the first call of `apply`, in their pose at rest, and stay bound.

    Args:
        device: Runs the kernels.
        rest: The capture at rest.
        carriers: Its carriers.
        ids: Identities of the splats, shape (n,).
        select: Weight of each, 0..1, shape (n,).
        order: When each starts, 0 first and 1 last, shape (n,); None follows `conform:order`.
        up: Unit vector upwards.
        parameters: `conform:order`, `sim:seed` and `appearance:maxStretch` are taken from here.
    """

    def __init__(
        self,
        device: Device,
        rest: SplatCloud,
        carriers: Carriers,
        *,
        ids: I64,
        select: F32,
        order: F32 | None,
        up: tuple[float, float, float],
        parameters: Parameters,
    ) -> None:
        self._up = up
        self._part = np.zeros(len(select), np.float32)
        """Progress of each splat at the last pose, 0 before its start and 1 when it has arrived."""
        self._travel = 0.0, (0.0, 0.0, 0.0), 0.0, self._part
        """Time, (start, duration, stagger) and arc then, and the weight of each point of the
        map."""
        self._device, self._carriers = device, carriers
        self._rest, self._ids, self._order = rest, ids, order
        self._parameters = parameters
        self._select = select
        self._ranks = np.zeros(0, np.float32)
        self._carrying: Carrying | None = None
        self._bound = Carried.nothing()
        self._target: TargetMesh | None = None
        self._first: Surface | None = None

    def __len__(self) -> int:
        return len(self._select)

    @property
    def is_bound(self) -> bool:
        """Whether `apply` needs no gradient to bind splats; always."""
        return True

    # --- births, deaths, restarts -------------------------------------------------------

    def extended(
        self, parents: Rows, positions: F32, rotations: F32, scales: F32, ids: I64
    ) -> TransportConform:
        """Return a copy with children appended. A child starts when its parent does.

        Args:
            parents: Rows of the parents, shape (c,).
            positions, rotations, scales, ids: The children at rest.
        """
        other = self.selected(np.concatenate([np.arange(len(self)), parents]))
        if self._carrying is not None and self._first is not None:
            mesh = TargetMesh(self._device, self._first)
            landing = self._carrying.landing(MeshGround(mesh), positions)
            children = self._carrying.land(landing, rotations, scales)
            other._bound = other._bound.joined(children)
        return other

    def selected(self, rows: Rows) -> TransportConform:
        """Return a copy with these rows only, in this order."""
        other = self._copy()
        other._select_rows(rows)
        return other

    def _copy(self) -> Self:
        """Return a copy that shares all arrays."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _select_rows(self, rows: Rows) -> None:
        """Keep these rows only."""
        self._select, self._part = self._select[rows], self._part[rows]
        if self._carrying is not None:
            self._ranks = self._ranks[rows]
            self._bound = self._bound.selected(rows)

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return the binding of the splats and the map; only the selection before the first
        `apply`."""
        kept: dict[str, npt.NDArray[Any]] = {"select": self._select}
        if self._carrying is None or self._first is None:
            return kept
        kept |= {"ranks": self._ranks, **self._bound.arrays()}
        kept |= {f"{_MAP}{name}": each for name, each in self._carrying.arrays().items()}
        surface = {"points": self._first.points, "triangles": self._first.triangles}
        return kept | {f"{_MESH}{name}": each for name, each in surface.items()}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, for any number of splats, bit for bit."""
        self._select = memory["select"]
        self._part = np.zeros(len(self._select), np.float32)
        if "ranks" not in memory:
            return
        self._ranks = memory["ranks"]
        self._bound = Carried.of(memory)
        self._carrying = Carrying.of(self._device, below(memory, _MAP))
        self._first = Surface(**below(memory, _MESH))

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
            gradient: Gradient of the deformation so far, shape (n, 3, 3), replaced by that of the
                deformation and the motion onto the target.
            factor: Factor of the weight of each splat, shape (n,).

        Raises:
            StageError: If the target is not a mesh with an area, or has other triangles than
                before.
        """
        if len(positions) == 0:
            return
        mesh = self._update_target(target)
        if self._carrying is None:
            self._bind(mesh)
        way = self._progress(now, parameters, factor)
        run, bound = self._device.run, self._bound
        run(
            kernels.travel, positions,
            np.zeros((0, 3, 3), np.float32) if gradient is None else gradient, way,
            (
                bound.faces, bound.places, bound.heights, bound.depths, bound.turns,
                bound.stretches, bound.sizes,
            ),
            bound.bows,
            (mesh.surface.points, mesh.surface.triangles, mesh.normals, mesh.frames, mesh.sizes),
            (
                float(parameters.orient), float(parameters.keep_thickness), float(parameters.arc),
                np.float32(self._parameters.appearance.max_stretch),
            ),
        )  # fmt: skip

    def _progress(self, now: float, parameters: ConformParameters, factor: F32 | None) -> F32:
        """Return the progress of splats towards their places on the target, 0..1."""
        run, way = self._device.run, np.empty(len(self), np.float32)
        timing = float(parameters.start), float(parameters.duration), float(parameters.stagger)
        select = self._select if factor is None else self._select * factor
        how = float(parameters.weight), *timing
        run(conform_kernels.advance, float(now), how, self._ranks, select, way)
        # the way of a splat that has arrived, in the arithmetic of `advance`
        whole = (float(parameters.weight) * select.astype(np.float64)).astype(np.float32)
        part = np.divide(way, whole, out=np.zeros_like(way), where=whole > 0)
        self._part = np.minimum(part, np.float32(1))
        near, c = self._bound.points, 0 if self._carrying is None else len(self._carrying.order)
        pull = np.bincount(near, whole, c) / np.maximum(np.bincount(near, minlength=c), 1)
        self._travel = float(now), timing, float(parameters.arc), pull.astype(np.float32)
        return way

    def _torn(self, carrying: Carrying) -> F32:
        """Return the stretch around each point of the map at the last pose, see `Flight`, (c,)."""
        now, timing, arc, pull = self._travel
        if self._order is None and self._parameters.conform.order == "random":
            apart = pull * np.linalg.norm(carrying.images - carrying.source.positions, axis=1)
            return np.where(apart > carrying.source.spacing, TORN, 0).astype(np.float32)
        way, run = np.empty_like(carrying.order), self._device.run
        run(conform_kernels.advance, now, (1.0, *timing), carrying.order, pull, way)
        return carrying.stretch(way, arc)

    def pause(self) -> None:
        """Show splats as they are: there is no target now."""
        self._part = np.zeros(len(self), np.float32)

    def finished(self, frame: Frame) -> Frame:
        """Return a frame at the time of the last `apply` with the look of splats in flight."""
        carrying, bound = self._carrying, self._bound
        rows = np.flatnonzero((self._part > 0) & (self._part < 1))
        if carrying is None or not len(rows):
            return frame
        flight = Flight(
            rows=rows,
            part=self._part[rows],
            spacings=(carrying.source.spacing, carrying.spacing),
            stretch=self._torn(carrying)[bound.points[rows]],
            colors=bound.colors[rows],
        )
        return replace(frame, cloud=flight.seen(frame.cloud))

    def _update_target(self, surface: Surface) -> TargetMesh:
        """Update the target's positions, if it has moved."""
        if self._target is None:
            self._target = TargetMesh(self._device, surface)
        else:
            self._target.update(surface)
        return self._target

    def _bind(self, mesh: TargetMesh) -> None:
        """Map the carriers onto the target, and bind all splats."""
        device, rest = self._device, self._moving
        sheet = outer_sheet(device, self._carriers, rest)
        rows = sheet.thinned(device, MOST)
        if len(rows) < len(sheet):
            sheet = sheet.selected(device, rows)
        with phase("transport", work=len(sheet)):
            found = match(device, sheet, MeshGoal(device, mesh, len(sheet)))
        ground = MeshGround(mesh)
        self._finish(*Carrying.along(device, found, ground, rest, down=self._down), mesh)

    @property
    def _down(self) -> F32 | None:
        """The direction in which splats start one after the other; None for another order."""
        if self._parameters.conform.order != "height":
            return None
        return -np.asarray(self._up, np.float32)

    @property
    def _moving(self) -> SplatCloud:
        """The capture at rest. What stays where it is is transparent: it takes no part of the
        target."""
        return replace(self._rest, opacities=self._rest.opacities * (self._select > 0))

    def _finish(self, carrying: Carrying, landing: Landing, mesh: TargetMesh) -> Carrying:
        """Bind all splats of the capture to the map. Return the map; if a primvar gives the order
        of the splats, its points start in that order, too."""
        rest = self._rest
        if self._order is not None:
            self._ranks = np.clip(self._order, 0, 1).astype(np.float32)
            carrying = carrying.started(landing, self._ranks)
        elif self._parameters.conform.order != "random":
            self._ranks = carrying.ranks(landing)
        else:
            self._ranks = self._drawn(self._ids)
        self._carrying, self._first = carrying, mesh.surface
        self._bound = carrying.land(landing, rest.rotations, rest.scales)
        return carrying

    def _drawn(self, ids: I64) -> F32:
        """Return random ranks of splats."""
        ranks = np.empty(len(ids), np.float32)
        self._device.run(conform_kernels.draw_ranks, self._parameters.sim.seed, ids, ranks)
        return ranks


def below(memory: dict[str, npt.NDArray[Any]], lead: str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays whose names start with `lead`, by the rest of their names."""
    return {key.removeprefix(lead): each for key, each in memory.items() if key.startswith(lead)}
