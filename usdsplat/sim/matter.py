"""Matter: the carriers of a field as particles that hold together, pushed by affectors.

Splats follow their carriers, so a sign bends as a sign, and a meadow parts and closes again. The
target pose of the carriers, from deformers, a skeleton or a target, is the shape that the matter
has at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import matter as kernels
from usdsplat.sim.carriers import Binding, Carriers
from usdsplat.sim.contact import Contacts, Particles
from usdsplat.sim.following import Motion, follow, motion_of
from usdsplat.sim.gradients import LocalGradients
from usdsplat.sim.materials import resolved
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.parameters import AffectorParameters, MatterParameters
from usdsplat.sim.pieces import Pieces
from usdsplat.sim.specs import Affector, Moment, Solid
from usdsplat.sim.state import ALIVE, PINNED, State
from usdsplat.sim.timeline import Step

SIZE = 0.3
"""Standard deviation of a carrier as affectors see it, in distances of carriers."""
RELAXATION = 1.6
"""Factor of the mean correction of edges that are too long or too short."""
SPAN = 3.5
"""Length of the longest edge, in distances of carriers."""
EDGES = 14
"""Number of neighbours to which a carrier has edges; more have edges to it."""
NEIGHBORS = 12
"""Number of neighbours from which the gradient of the motion is estimated."""
SLIP, SETTLED = 1.2, 0.5
"""Distance from its pose at which a carrier slips off what pushes it, and at which it can be pushed
again, in largest radii of the affectors."""
SLIPPING = np.uint32(1 << 8)
"""Bit of `State.flags` of carriers that slip."""
NO_OFFSETS = np.zeros((0, 3), np.float32)
LOWEST = 1.0
"""Percentile of the heights of carriers at which the ground is: strays may be below it. The upper
end is as far from the highest."""
_PIECES = "pieces:"
_ARRAYS = ("turns", "cut", "offsets", "speeds", "since")
_MOVING = ("positions", "velocities", "flags")


class Matter:
    """The matter of one field.

    Args:
        device: Runs the kernels, and keeps the carriers.
        carriers: Carriers of the field.
        selection: Selection weight of each carrier, shape (c,); carriers with 0 stay on their pose.
        colors: Colour of each carrier, shape (c, 3).
        first: Values of the stage at the first frame.
    """

    def __init__(
        self, device: Device, carriers: Carriers, selection: F32, colors: F32, first: Moment
    ) -> None:
        self._device, self._carriers = device, carriers
        self._contacts = Contacts(device)
        self.particles = State.of(_cloud(carriers), selection)
        """Carriers as particles. Positions, velocities and flags are arrays of the device."""
        knobs = resolved(first.parameters.matter)
        held = selection <= 0
        heights = carriers.positions @ np.asarray(first.up, np.float32)
        low, high = (float(each) for each in np.percentile(heights, (LOWEST, 100 - LOWEST)))
        if knobs.roots >= 0 and knobs.hang:
            held |= heights >= high - knobs.roots * (high - low)
        elif knobs.roots >= 0:
            held |= heights <= low + knobs.roots * (high - low)
        self.particles.flags[held] |= PINNED
        self.ground = _ground(first, low, knobs.friction) if knobs.ground else None
        """The ground as an affector; None without one."""
        rows, neighbours, twins = edges(device, carriers)
        self._graph = rows, neighbours
        self._edges = device.keep(rows), device.keep(neighbours)
        self._twins = device.keep(twins)
        near, _ = nearest(device, carriers.positions, carriers.positions, NEIGHBORS + 1)
        self._near = np.ascontiguousarray(near[:, 1:])
        self._sizes = device.keep(self.particles.rest_scales)
        self._poses = carriers.positions
        c, count = len(carriers), len(neighbours)
        self._turns: Any = device.move(np.tile(np.array([1, 0, 0, 0], np.float32), (c, 1)))
        self._cut: Any = device.move(np.zeros(count, np.uint8))
        is_plastic = knobs.plasticity > 0
        offsets = np.zeros((count, 3), np.float32) if is_plastic else NO_OFFSETS
        self._offsets: Any = device.move(offsets)
        self._speeds: Any = device.move(np.zeros((c, 3), np.float32))
        self._since: Any = device.move(np.full(c, np.inf, np.float32))
        self._gradients: LocalGradients | None = None
        self.pieces: Pieces | None = None
        """Rigid pieces; None for matter that does not break up."""
        if knobs.grain > 0:
            self.pieces = Pieces(
                device, carriers, rows, neighbours, colors=colors, size=knobs.grain, roots=held,
                seed=first.parameters.sim.seed,
            )  # fmt: skip
        self._move_in()

    def _move_in(self) -> None:
        """Move what changes to the device."""
        for name in _MOVING:
            setattr(self.particles, name, self._device.move(getattr(self.particles, name)))

    def move_to(self, poses: F32) -> None:
        """Put all carriers at their poses, at rest."""
        self._poses = poses
        self.particles.positions = self._device.move(poses.copy())

    def advance(self, poses: F32, before: Moment, after: Moment, step: Step) -> None:
        """Take a substep.

        Args:
            poses: Target pose of the carriers at its end [unit], shape (c, 3).
            before, after: Values of the stage at its start and its end.
            step: The substep.
        """
        state, knobs, run = self.particles, resolved(after.parameters.matter), self._device.run
        keep, resident = self._device.keep, self._device.resident
        dt, f = np.float32(step.dt), np.float32
        if self.ground is not None:
            before, after = (
                replace(each, affectors=(*each.affectors, self.ground)) for each in (before, after)
            )
        if self.pieces is not None:
            self._wake(self.pieces, after)
        started = resident(poses.shape, np.float32)
        reach = SLIP * widest(after.affectors) if knobs.back > 0 else np.inf
        run(
            kernels.slip, f(reach), f(SETTLED / SLIP * reach), SLIPPING, ALIVE, keep(self._poses),
            state.positions, state.flags, started,
        )  # fmt: skip
        run(
            kernels.predict, f(knobs.back), f(knobs.damping), dt, _gravity(after, knobs),
            keep(self._poses), keep(poses), self._speeds, state.flags, keep(state.weight),
            state.positions, state.velocities,
        )  # fmt: skip
        self._poses, poses = poses, keep(poses)
        pull = -np.expm1(-knobs.stiffness * step.dt / knobs.iterations)
        if self.pieces is not None:
            pull = 0.0
        limits = f(knobs.press), f(knobs.stretch)
        shifts = resident((poses.shape[0], 8), np.float32)
        self._push(started, before, after, step.dt, continuous=knobs.back <= 0)
        pushed = state.positions
        for number in range(knobs.iterations):
            run(
                kernels.match, *limits, poses, state.positions, *self._edges, self._cut,
                self._offsets, self._turns, shifts,
            )  # fmt: skip
            out = resident(poses.shape, np.float32)
            run(
                kernels.correct, f(pull), *limits, f(RELAXATION), poses, state.positions,
                state.flags, *self._edges, self._twins, self._cut, self._offsets, self._turns,
                shifts, out,
            )  # fmt: skip
            state.positions = out
            if self.pieces is not None:
                if number % 2 == 0:  # lists of what is near cost as much as all passes
                    self.pieces.part(state, poses)
                self.pieces.place(state, poses)
        run(
            kernels.finish, f(after.parameters.sim.max_speed), dt, state.flags, pushed,
            state.positions, state.velocities,
        )  # fmt: skip
        if np.isfinite(knobs.tear):
            run(
                kernels.tear, f(knobs.tear), poses, state.positions, *self._edges, self._twins,
                self._offsets, self._cut,
            )  # fmt: skip
        if self._offsets.shape[0] and knobs.plasticity > 0:
            rate = -np.log1p(-min(knobs.plasticity, 1 - 1e-6))
            run(
                kernels.flow, f(knobs.yielding), f(rate), dt, poses, state.positions, *self._edges,
                self._cut, self._turns, self._offsets,
            )  # fmt: skip

    def _push(
        self, started: Any, before: Moment, after: Moment, dt: float, *, continuous: bool
    ) -> None:
        """Move carriers out of the affectors.

        Matter that returns to its pose cannot be pushed farther than about the radius of what
        pushes it: a post that runs over a sign bends it, until the sign slips off and swings back
        behind the post. A carrier that slips passes the affector; its splats are still pushed out.
        Its motion is not swept, because a sweep would carry along what has slipped.
        """
        if continuous:
            sides, span = (before.affectors, after.affectors), dt
        else:
            sides, span = (after.affectors, after.affectors), np.inf
        bodies = self._contacts.packed(*sides, span)
        if len(bodies):
            self._contacts.push(bodies, started, self._as_particles(), span)

    def _as_particles(self) -> Particles:
        """Return the carriers as affectors see them."""
        state = self.particles
        return Particles(
            flags=state.flags, sizes=self._sizes, positions=state.positions,
            velocities=state.velocities, since=self._since,
        )  # fmt: skip

    def _wake(self, pieces: Pieces, moment: Moment) -> None:
        """Let pieces go that affectors other than the ground touch, and those without support."""
        state, fetch = self.particles, self._device.fetch
        positions = fetch(state.positions)
        others = tuple(each for each in moment.affectors if each is not self.ground)
        bodies = self._contacts.packed(others, others, np.inf)
        touched = np.zeros(len(positions), np.bool_)
        if len(bodies):
            copy = Particles(
                flags=np.full(len(positions), ALIVE, np.uint32),
                sizes=self._sizes,
                positions=positions.copy(),
                velocities=np.zeros_like(positions),
                since=np.zeros(len(positions), np.float32),
            )
            self._contacts.push(bodies, positions, copy, np.inf)
            touched = (copy.positions != positions).any(axis=1)
        flags, cut = (np.array(fetch(each)) for each in (state.flags, self._cut))
        pieces.update(flags, touched, cut)
        state.flags, self._cut = self._device.move(flags), self._device.move(cut)

    def motion(self, moment: Moment) -> Motion:
        """Return the motion of the carriers from their poses."""
        positions = self._device.fetch(self.particles.positions)
        if self.pieces is not None:
            return Motion(
                poses=self._poses,
                displacements=positions - self._poses,
                maps=self.pieces.maps(),
                spacing=self._carriers.spacing,
            )
        knobs = resolved(moment.parameters.matter)
        if self._gradients is None or self._gradients.rest is not self._poses:
            normals = self._carriers.normals if self._is_at_rest else None
            self._gradients = LocalGradients.of(self._device, self._poses, self._near, normals)
        return motion_of(
            self._device, self._gradients, positions, self._carriers.spacing,
            (knobs.press, knobs.stretch),
        )  # fmt: skip

    def follow(
        self, binding: Binding, moment: Moment, positions: Any, gradient: Any = None
    ) -> None:
        """Move splats with the matter, see `following.follow`."""
        follow(self._device, binding, self.motion(moment), positions, gradient)

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return what `restore` needs."""
        fetch = self._device.fetch
        own = {name: fetch(getattr(self, f"_{name}")) for name in _ARRAYS}
        own |= {name: fetch(getattr(self.particles, name)) for name in _MOVING}
        if self.pieces is not None:
            own |= {_PIECES + key: each for key, each in self.pieces.memory().items()}
        return own | {"poses": self._poses}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, bit for bit."""
        for name in _ARRAYS:
            setattr(self, f"_{name}", self._device.move(memory[name].copy()))
        for name in _MOVING:
            setattr(self.particles, name, memory[name].copy())
        self._move_in()
        self._poses = memory["poses"]
        if self.pieces is not None:
            of_pieces = {
                name.removeprefix(_PIECES): each
                for name, each in memory.items()
                if name.startswith(_PIECES)
            }
            self.pieces.restore(of_pieces)

    def stretches(self) -> F32:
        """Return the length of each edge that has not torn, relative to that at rest."""
        rows, neighbours = self._graph
        kept = self._device.fetch(self._cut) == 0
        a = np.repeat(np.arange(len(self._poses)), np.diff(rows))[kept]
        b = neighbours[kept]
        now = self._device.fetch(self.particles.positions)
        length, rest = (np.linalg.norm(p[a] - p[b], axis=1) for p in (now, self._poses))
        return np.asarray(length / np.maximum(rest, 1e-30), np.float32)

    @property
    def _is_at_rest(self) -> bool:
        """Whether the poses are those of the capture."""
        return self._poses is self._carriers.positions or np.array_equal(
            self._poses, self._carriers.positions
        )


def edges(device: Device, carriers: Carriers) -> tuple[npt.NDArray[np.int64], I32, I32]:
    """Return the edges between carriers.

    Returns:
        First edge of each carrier, shape (c + 1,); the carrier at the end of each edge, ascending
        for each carrier, shape (e,); and the edge back, shape (e,).
    """
    c = len(carriers)
    near, apart = nearest(device, carriers.positions, carriers.positions, EDGES + 1)
    own = np.repeat(np.arange(c, dtype=np.int64), EDGES + 1)
    other, length = near.reshape(-1).astype(np.int64), apart.reshape(-1)
    kept = (other >= 0) & (other != own) & (length <= SPAN * carriers.spacing)
    own, other = own[kept], other[kept]
    keys = np.unique(np.concatenate([own * c + other, other * c + own]))
    own, other = np.divmod(keys, c)
    rows = np.zeros(c + 1, np.int64)
    np.cumsum(np.bincount(own, minlength=c), out=rows[1:])
    twins = np.searchsorted(keys, other * c + own)
    return rows, other.astype(np.int32), twins.astype(np.int32)


def _ground(moment: Moment, height: float, friction: float) -> Affector:
    """Return the ground at a height along the up direction."""
    up = np.asarray(moment.up)
    side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([side, np.cross(up, side), up])
    matrix[:3, 3] = height * up
    return Affector(
        path="",
        parameters=AffectorParameters(friction=friction, blend=0.0, clearance=0.0),
        solids=(Solid(kind="plane", matrix=matrix),),
    )


def widest(affectors: Sequence[Affector]) -> float:
    """Return the largest radius of the solids that collide [unit]; 0 without any, and infinity with
    a plane."""
    found = 0.0
    for each in affectors:
        if each.parameters.enabled and each.parameters.role == "collide":
            radii = (_radius(solid) for solid in each.solids)
            found = max(found, each.parameters.radius_scale * max(radii, default=0.0))
    return found


def _radius(solid: Solid) -> float:
    """Return half of the smallest width of a solid [unit]."""
    if solid.kind == "plane":
        return float("inf")
    if solid.kind == "box":
        return min(solid.size)
    if solid.kind == "mesh":
        points = solid.surface.points if solid.surface else np.zeros((1, 3))
        return 0.5 * float(np.ptp(points, axis=0).min())
    return max(solid.size[:2])


def _cloud(carriers: Carriers) -> SplatCloud:
    """Return carriers as round splats."""
    c = len(carriers)
    return SplatCloud(
        positions=carriers.positions,
        scales=np.full((c, 3), SIZE * carriers.spacing, np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (c, 1)),
        opacities=np.ones(c, np.float32),
        sh=np.zeros((c, 1, 3), np.float32),
    )


def _gravity(moment: Moment, knobs: MatterParameters) -> F32:
    """Return the acceleration in the simulation's space [unit/s^2], shape (3,)."""
    gravity = knobs.gravity * np.asarray(moment.parameters.particles.gravity)
    return np.linalg.solve(moment.to_world[:3, :3], gravity).astype(np.float32)
