"""Compute motion vectors to the next frame and from the previous one, in pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I64, SplatCloud
from usdsplat.kernels import position
from usdsplat.kernels.device import Device
from usdsplat.render.fields import Drawn
from usdsplat.render.frame_buffers import PixelBuffers
from usdsplat.render.scene import RenderScene, matrix
from usdsplat.render.screen import Screen
from usdsplat.render.specs import InstanceSpec, MeshSpec, View
from usdsplat.render.surfaces import SurfaceBand

FRAMES = {"motionForward": 1, "motionBackward": -1}
"""AOV -> frame offset. Both AOVs contain the motion in the direction of increasing time."""

Thing = SplatCloud | MeshSpec


@dataclass(frozen=True, slots=True, eq=False)
class _Pose:
    """Transforms and geometry of all appearances at one time: splats, then surfaces, in drawing
    order."""

    screen: Screen
    things: dict[tuple[str, str, int], tuple[F64, Thing]]

    @classmethod
    def of(cls, scene: RenderScene, view: View, drawn: Sequence[Drawn]) -> _Pose:
        things: dict[tuple[str, str, int], tuple[F64, Thing]] = {}

        def put(path: str, instance: InstanceSpec, thing: Thing) -> None:
            things[path, instance.path, instance.index] = matrix(instance.transform), thing

        for path, field, instance in drawn:
            put(path, instance, field.spec.cloud)
        for path, mesh, instance in scene.drawn_meshes():
            put(path, instance, mesh.spec)
        return cls(Screen.of(view), things)


@dataclass(frozen=True, slots=True, eq=False)
class _FrameMotion:
    """Motion from one frame to another, as arrays of the kernel."""

    views: npt.NDArray[Any]
    moves: F64
    turns: F64
    first: I64
    deltas: F32

    @property
    def arrays(self) -> tuple[npt.NDArray[Any], ...]:
        """All arrays in the order of the kernel's arguments."""
        return self.views, self.moves, self.turns, self.first, self.deltas


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of all appearances between a frame and its neighbours."""

    splats: int
    """Number of appearances of splats. Those of surfaces follow."""
    motions: dict[str, _FrameMotion]
    """AOV -> motion."""

    @classmethod
    def between(
        cls,
        sampler: Callable[[float], tuple[RenderScene, View]],
        time: float,
        screen: Screen,
        drawn: Callable[[RenderScene], Sequence[Drawn]] = RenderScene.drawn,
    ) -> Motion:
        """Compare a frame with both of its neighbours.

        Args:
            sampler: As in `Renderer.render`. It is left at `time`, also after an error.
            time: Time of the frame [time code], relative to that of the picture.
            screen: Screen of the frame.
            drawn: Function that returns each appearance of splats in a scene.
        """

        def pose(at: float) -> _Pose:
            scene, view = sampler(at)
            return _Pose.of(scene, view, drawn(scene))

        try:
            others = {name: pose(time + step) for name, step in FRAMES.items()}
        finally:
            scene, view = sampler(time)
        appearances = drawn(scene)
        here = _Pose.of(scene, view, appearances)
        return cls(
            splats=len(appearances),
            motions={name: _frame_motion(here, other, screen) for name, other in others.items()},
        )

    def draw(
        self,
        device: Device,
        buffers: PixelBuffers,
        median: Mapping[str, npt.NDArray[Any]],
        drawn: SurfaceBand | None,
        corner: tuple[int, int],
        wanted: set[str],
    ) -> dict[str, F32]:
        """Return the motion AOVs of one band as arrays of the device: (right, up) [pixel], shape
        (h, w, 2).

        Args:
            median: Depth, primId, elementId and row of the visible appearance.
            drawn: The surfaces of the band.
            corner: Its first pixel, x and y.
            wanted: The AOVs.
        """
        rows, elements = median["row"], median["elementId"]
        weights: F32 = np.empty((0, 0, 2), np.float32)
        if drawn is not None:
            all_rows = buffers.motion_rows(*rows.shape)
            all_elements = buffers.motion_elements(*rows.shape)
            weights = buffers.motion_weights(*rows.shape)
            device.run(
                position.seen, median["primId"], rows, elements, drawn.hit, drawn.bary, self.splats,
                (all_rows, all_elements, weights),
            )  # fmt: skip
            rows, elements = all_rows, all_elements
        memory = {
            "motionForward": buffers.motion_forward,
            "motionBackward": buffers.motion_backward,
        }
        arrays = {}
        for name in sorted(wanted & set(self.motions)):
            motion = self.motions[name]
            arrays[name] = memory[name](*rows.shape)
            device.run(
                position.motion, *map(device.keep, motion.arrays),
                median["depth"], rows, elements, weights, *corner, FRAMES[name], arrays[name],
            )  # fmt: skip
        return arrays


def _frame_motion(here: _Pose, other: _Pose, screen: Screen) -> _FrameMotion:
    """Return the motion from `here` to `other`. Appearances that `other` lacks do not move."""
    n = len(here.things)
    moves, turns = np.empty((n, 3, 4)), np.empty((n, 3, 3))
    first = np.full(n, position.STILL, np.int64)
    deltas: list[F32] = [np.empty((0, 3), np.float32)]
    count = 0
    known: dict[tuple[int, int], int] = {}
    back = np.linalg.inv(screen.world_to_camera)
    for row, (key, (transform, thing)) in enumerate(here.things.items()):
        to, later = other.things.get(key, (transform, thing))
        move = other.screen.world_to_camera @ to @ np.linalg.pinv(transform) @ back
        moves[row] = move[:3]
        turns[row] = (other.screen.world_to_camera @ to)[:3, :3]
        pair = id(thing), id(later)
        if pair not in known:
            delta = _delta(thing, later)
            known[pair] = position.STILL if delta is None else count
            if delta is not None:
                deltas.append(delta)
                count += len(delta)
        first[row] = known[pair]
    views = np.concatenate([screen.view_record(), other.screen.view_record()])
    return _FrameMotion(views, moves, turns, first, np.concatenate(deltas))


def _delta(thing: Thing, later: Thing) -> F32 | None:
    """Return the motion of points in local space, one row for each splat or each corner of each
    triangle.

    None if they do not move, or if the points of the two times do not correspond.
    """
    if thing is later:
        return None
    if isinstance(thing, SplatCloud) and isinstance(later, SplatCloud):
        return _splat_delta(thing, later)
    if not isinstance(thing, MeshSpec) or not isinstance(later, MeshSpec):
        return None
    if thing.points is later.points or len(thing.points) != len(later.points):
        return None
    if not np.array_equal(thing.triangles, later.triangles):
        return None
    return np.asarray((later.points - thing.points)[thing.triangles.ravel()], np.float32)


def _splat_delta(thing: SplatCloud, later: SplatCloud) -> F32 | None:
    """Return the motion of splats, matched by id if both clouds have ids, else by row."""
    if thing.ids is not None and later.ids is not None:
        if not np.array_equal(thing.ids, later.ids):
            order = np.argsort(later.ids, kind="stable")
            at = np.searchsorted(later.ids, thing.ids, sorter=order)
            found = order[np.minimum(at, len(order) - 1)]
            same = later.ids[found] == thing.ids
            moved = later.positions[found] - thing.positions
            return np.where(same[:, None], moved, 0).astype(np.float32)
    elif len(thing) != len(later):
        return None
    return np.asarray(later.positions - thing.positions)
