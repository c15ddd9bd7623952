"""Compute a prim's matrix from the drag of a manipulator's handle.

    drag = begin_drag(manipulator, "x", (310.0, 200.0), projection)
    matrix = drag((330.0, 205.0))                      # as often as the pointer moves

The matrix follows from the start of the drag and the current pointer, not from the path between;
only a rotation counts its full turns. A pointer without a valid position, such as one beyond the
horizon of a plane, leaves the matrix unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.preview.manipulator import (
    AXES,
    EDGE_ON,
    LENGTH,
    PLANES,
    RING,
    Handle,
    Manipulator,
    across,
)
from usdsplat.preview.projection import Pixel, Projection
from usdsplat.render.specs import Matrix

TURN = 15.0
"""Step of a snapping rotation [degree]."""
SCALE = 0.1
"""Step of a snapping scale."""
SMALLEST = 1e-3
"""Minimum scale factor, so that a prim can be enlarged again."""
FARTHEST = 1e3
"""Maximum distance of a drag, in handle lengths: near a horizon a pixel covers a large distance."""
STEPS = 10.0
"""Approximate length of a handle in snapping steps."""

Value = F64 | float
Moved = tuple[F64, str]
"""Matrix of a prim, and how it was changed, in words."""


class Drag:
    """A drag in progress.

    Args:
        measure: Function (pointer) -> value, or None if the pointer has no valid position.
        place: Function (start value, current value, snaps) -> matrix, and the change in words.
        begun: Initial position of the pointer.
        matrix: Initial matrix of the prim.
    """

    def __init__(
        self,
        measure: Callable[[Pixel], Value | None],
        place: Callable[[Any, Any, bool], Moved],
        *,
        begun: Pixel,
        matrix: F64,
    ) -> None:
        self._measure, self._place = measure, place
        self._start = measure(begun)
        self._matrix = matrix
        self.words = ""
        """The change since the start, such as "X +1.25" or "Y 30°"."""

    def __call__(self, pixel: Pixel, *, snaps: bool = False) -> F64:
        """Return the prim's matrix for a pointer position, local to world, shape (4, 4)."""
        now = self._measure(pixel)
        if self._start is None:
            self._start = now
        elif now is not None:
            self._matrix, self.words = self._place(self._start, now, snaps)
        return self._matrix


def begin_drag(
    manipulator: Manipulator, handle: Handle, pixel: Pixel, projection: Projection
) -> Drag:
    """Begin the drag of a handle."""
    kinds = {"translate": _translating, "rotate": _rotating, "scale": _scaling}
    measure, place = kinds[manipulator.mode](manipulator, handle, projection)
    return Drag(measure, place, begun=pixel, matrix=manipulator.matrix)


def snapping_step(length: float) -> float:
    """Return the snapping step of a move: 1, 2 or 5 times a power of ten, about ten per handle."""
    wanted = length / STEPS
    power = 10.0 ** math.floor(math.log10(wanted))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(math.log(step * power / wanted)))


def as_matrix(array: F64) -> Matrix:
    """Convert an array to a tuple for the stage."""
    return tuple(float(value) for value in array.ravel())


_Measure = Callable[[Pixel], Value | None]
_Place = Callable[[Any, Any, bool], Moved]


def _translating(
    manipulator: Manipulator, handle: Handle, projection: Projection
) -> tuple[_Measure, _Place]:
    axes, step = manipulator.axes, snapping_step(manipulator.length(projection))
    measure: _Measure
    if handle in AXES:
        axis = axes[AXES.index(handle)]
        kept, measure = axis[None], _along(axis, manipulator, projection)
    elif handle == "view":
        kept = projection.axes[:2]
        measure = _on_plane(projection.axes[2], manipulator, projection)
    else:
        across_it = PLANES.index(handle)
        kept = np.delete(axes, across_it, axis=0)
        normal = np.cross(kept[0], kept[1])
        measure = _on_plane(normal / np.linalg.norm(normal), manipulator, projection)

    def place(start: F64, now: F64, snaps: bool) -> Moved:
        parts = (now - start) @ np.linalg.pinv(kept)
        if snaps:
            parts = step * np.round(parts / step)
        moved, shift = manipulator.matrix.copy(), parts @ kept
        moved[:3, 3] += shift
        names = "XYZ" if handle == "view" else handle.upper()
        along = dict(zip("XYZ", axes @ shift, strict=True))
        return moved, "   ".join(f"{name} {along[name]:+.4g}" for name in sorted(names))

    return measure, place


def _rotating(
    manipulator: Manipulator, handle: Handle, projection: Projection
) -> tuple[_Measure, _Place]:
    sight = projection.towards(manipulator.origin)
    axis = sight if handle == "view" else manipulator.axes[AXES.index(handle)]
    is_edge_on = abs(float(axis @ sight)) < EDGE_ON
    measure = (_along_rim if is_edge_on else _around)(axis, manipulator, projection)
    turned, before = 0.0, None

    def place(start: float, now: float, snaps: bool) -> Moved:
        nonlocal turned, before
        step = now - (start if before is None else before)
        turned += step if is_edge_on else math.remainder(step, 2.0 * math.pi)
        before = now
        angle = math.degrees(turned)
        angle = TURN * round(angle / TURN) if snaps else angle
        placed = manipulator.matrix.copy()
        placed[:3, :3] = _turn(axis, math.radians(angle)) @ placed[:3, :3]
        shown = -angle if handle == "view" else angle  # counter-clockwise as the user sees it
        shown = round(shown, 1) + 0.0  # no -0.0
        return placed, f"{_prefix(handle)}{shown:+.1f}°"

    return measure, place


def _scaling(
    manipulator: Manipulator, handle: Handle, projection: Projection
) -> tuple[_Measure, _Place]:
    measure: _Measure
    if handle in AXES:
        kept = np.arange(3) == AXES.index(handle)
        axis = manipulator.axes[AXES.index(handle)]
        point = _along(axis, manipulator, projection)

        def measure(pixel: Pixel) -> float | None:
            found = point(pixel)
            return None if found is None else float((found - manipulator.origin) @ axis)

        def factor(start: float, now: float) -> float:
            return now / start if start else 1.0
    else:
        kept = np.ones(3, bool)

        def measure(pixel: Pixel) -> float:
            return (pixel[0] - pixel[1]) / (LENGTH * manipulator.ratio)

        def factor(start: float, now: float) -> float:
            return 2.0 ** (now - start)

    def place(start: float, now: float, snaps: bool) -> Moved:
        scale = factor(start, now)
        if snaps:
            scale = max(SCALE * round(scale / SCALE), SCALE)
        scale = max(scale, SMALLEST)
        scaled = manipulator.matrix.copy()
        scaled[:3, :3] *= np.where(kept, scale, 1.0)
        return scaled, f"{_prefix(handle)}×{scale:.3f}"

    return measure, place


def _prefix(handle: Handle) -> str:
    """Return the name of an axis before its number; "" for the handle that faces the viewer."""
    return f"{handle.upper()} " if handle in AXES else ""


# --- pointer to value -----------------------------------------------------------------------


def _along(
    axis: F64, manipulator: Manipulator, projection: Projection
) -> Callable[[Pixel], F64 | None]:
    """Return a function for the point of an axis through the origin nearest to the pointer."""
    origin, length = manipulator.origin, manipulator.length(projection)
    first, second = projection.pixels([origin, origin + 0.5 * length * axis])
    way = (second - first) / max(float(np.linalg.norm(second - first)), 1e-12)

    def point(pixel: Pixel) -> F64 | None:
        x, y = first + ((np.asarray(pixel) - first) @ way) * way
        start, ray = projection.ray((float(x), float(y)))
        gap, cosine = origin - start, float(axis @ ray)
        share = 1.0 - cosine * cosine
        if share < 1e-12:
            return None
        along_axis, along_ray = float(axis @ gap), float(ray @ gap)
        distance = (cosine * along_ray - along_axis) / share
        is_behind = (along_ray - cosine * along_axis) / share <= 0.0
        if is_behind or abs(distance) > FARTHEST * length:
            return None
        return np.asarray(origin + distance * axis)

    return point


def _on_plane(
    normal: F64, manipulator: Manipulator, projection: Projection
) -> Callable[[Pixel], F64 | None]:
    """Return a function for the point of a plane through the origin under the pointer."""
    origin, length = manipulator.origin, manipulator.length(projection)

    def point(pixel: Pixel) -> F64 | None:
        start, ray = projection.ray(pixel)
        slope = float(ray @ normal)
        distance = float((origin - start) @ normal) / slope if abs(slope) > 1e-9 else -1.0
        found = start + distance * ray
        is_far = float(np.linalg.norm(found - origin)) > FARTHEST * length
        return None if distance <= 0.0 or is_far else np.asarray(found)

    return point


def _around(
    axis: F64, manipulator: Manipulator, projection: Projection
) -> Callable[[Pixel], float | None]:
    """Return a function for the angle of the pointer about an axis [radian]."""
    first, second = across(axis)
    point = _on_plane(axis, manipulator, projection)

    def angle(pixel: Pixel) -> float | None:
        found = point(pixel)
        if found is None:
            return None
        way = found - manipulator.origin
        return math.atan2(float(way @ second), float(way @ first))

    return angle


def _along_rim(
    axis: F64, manipulator: Manipulator, projection: Projection
) -> Callable[[Pixel], float | None]:
    """Return a function like that of `_around` for a ring seen edge-on, whose near side follows the
    pointer."""
    origin, length = manipulator.origin, manipulator.length(projection)
    rim = np.cross(axis, -projection.towards(origin))
    start, end = projection.pixels([origin, origin + 0.5 * length * rim])
    way = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)

    def angle(pixel: Pixel) -> float:
        return float((np.asarray(pixel) - start) @ way) / (RING * LENGTH * manipulator.ratio)

    return angle


def _turn(axis: F64, angle: float) -> F64:
    """Return the rotation about a unit vector, counter-clockwise seen from its tip, shape (3,
    3)."""
    x, y, z = axis
    cross = np.array([(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)
