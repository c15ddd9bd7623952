"""Handles that move, rotate and scale a prim: their shapes in a viewport, and hit tests.

Handles have a constant size on the screen. `dragging` computes the effect of a drag on the prim's
matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.preview.projection import Pixel, Projection

Mode = Literal["translate", "rotate", "scale"]
Space = Literal["world", "local"]
Handle = Literal["x", "y", "z", "yz", "zx", "xy", "view"]
"""An axis, a plane by its axes, or the handle that faces the viewer."""

AXES: tuple[Handle, ...] = ("x", "y", "z")
PLANES: tuple[Handle, ...] = ("yz", "zx", "xy")
"""Plane i is perpendicular to axis i."""

LENGTH = 92.0
"""Length of an axis [pixel of the window]."""
GAP = 0.16
"""Start of an axis, as a fraction of its length."""
PLANE = (0.3, 0.5)
"""Start and end of the square of a plane, as fractions of an axis."""
RING = 0.9
VIEW_RING = 1.12
"""Radii of the rings, in axis lengths."""
CENTER = 8.0
"""Half the size of the centre handle [pixel of the window]."""
REACH = 7.0
"""Maximum distance from a line for a hit [pixel of the window]."""
END_ON = 0.985
"""Cosine to the view direction from which an axis cannot be dragged."""
EDGE_ON = 0.12
"""Cosine below which a plane cannot be dragged."""
RING_STEPS = 72


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shape:
    """The visible shape of a handle."""

    handle: Handle
    kind: Literal["arrow", "box", "plane", "ring", "center"]
    points: F64
    """Points of its line or outline in the viewport, shape (n, 2) [pixel]."""
    front: npt.NDArray[np.bool_]
    """Whether each point faces the viewer, shape (n,)."""
    can_be_hit: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Manipulator:
    """The handles of a prim."""

    matrix: F64
    """Matrix of the prim, local to world, for column vectors, shape (4, 4)."""
    mode: Mode = "translate"
    space: Space = "world"
    ratio: float = 1.0
    """Viewport pixels per window pixel."""

    @property
    def origin(self) -> F64:
        """Position of the handles, shape (3,)."""
        return self.matrix[:3, 3]

    @property
    def axes(self) -> F64:
        """Unit vectors x, y and z of the handles in the world, as rows, shape (3, 3).

        Scaling always uses the prim's own axes: others would shear it.
        """
        if self.space == "world" and self.mode != "scale":
            return np.eye(3)
        columns = self.matrix[:3, :3]
        lengths = np.linalg.norm(columns, axis=0)
        return np.where(lengths > 0, columns / np.where(lengths > 0, lengths, 1.0), np.eye(3)).T

    def length(self, projection: Projection) -> float:
        """Return the length of an axis in the world [scene unit]."""
        return LENGTH * self.ratio * projection.unit(self.origin)

    def shapes(self, projection: Projection) -> tuple[Shape, ...]:
        """Return the shapes of all handles, far to near; empty if they are behind the eye."""
        if not projection.depths(self.origin)[0] > projection.near:
            return ()
        if self.mode == "rotate":
            return tuple(self._rings(projection))
        planes = self._planes(projection) if self.mode == "translate" else []
        order = np.argsort(self.axes @ projection.axes[2])
        lines = self._lines(projection)
        return (*planes, *(lines[i] for i in order), self._center(projection))

    def hit(self, pixel: Pixel, projection: Projection) -> Handle | None:
        """Return the handle under a pointer: centre first, then planes, then the nearest."""
        shapes = [shape for shape in self.shapes(projection) if shape.can_be_hit]
        for shape in reversed(shapes):
            if shape.kind in ("center", "plane") and _is_inside(pixel, shape.points):
                return shape.handle
        lines = [shape for shape in shapes if shape.kind not in ("center", "plane")]
        distances = [_distance(pixel, shape) for shape in lines]
        nearest = int(np.argmin(distances)) if distances else -1
        if nearest < 0 or distances[nearest] > REACH * self.ratio:
            return None
        return lines[nearest].handle

    # --- private ---------------------------------------------------------------------------

    def _lines(self, projection: Projection) -> list[Shape]:
        length, sight = self.length(projection), projection.towards(self.origin)
        kind: Literal["arrow", "box"] = "arrow" if self.mode == "translate" else "box"
        return [
            Shape(
                handle=handle,
                kind=kind,
                points=projection.pixels([self.origin + at * length * axis for at in (GAP, 1.0)]),
                front=np.ones(2, bool),
                can_be_hit=bool(abs(axis @ sight) < END_ON),
            )
            for handle, axis in zip(AXES, self.axes, strict=True)
        ]

    def _planes(self, projection: Projection) -> list[Shape]:
        length, sight = self.length(projection), projection.towards(self.origin)
        low, high = PLANE
        found = []
        for i, handle in enumerate(PLANES):
            first, second = np.delete(self.axes, i, axis=0) * length
            corners = [(low, low), (high, low), (high, high), (low, high)]
            found.append(
                Shape(
                    handle=handle,
                    kind="plane",
                    points=projection.pixels(
                        [self.origin + a * first + b * second for a, b in corners]
                    ),
                    front=np.ones(4, bool),
                    can_be_hit=bool(abs(self.axes[i] @ sight) > EDGE_ON),
                )
            )
        return found

    def _center(self, projection: Projection) -> Shape:
        middle, half = projection.pixels(self.origin)[0], CENTER * self.ratio
        corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        return Shape(
            handle="view",
            kind="center",
            points=middle + corners,
            front=np.ones(4, bool),
            can_be_hit=True,
        )

    def _rings(self, projection: Projection) -> list[Shape]:
        length, sight = self.length(projection), projection.towards(self.origin)
        normals = [*zip(AXES, self.axes, (RING,) * 3, strict=True), ("view", sight, VIEW_RING)]
        angles = np.linspace(0.0, 2.0 * np.pi, RING_STEPS + 1)
        found = []
        for handle, normal, radius in normals:
            first, second = across(normal)
            around = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
            is_view = handle == "view"
            found.append(
                Shape(
                    handle=handle,
                    kind="ring",
                    points=projection.pixels(self.origin + length * radius * around),
                    front=np.full(len(angles), True) if is_view else around @ sight < 0.02,
                    can_be_hit=True,
                )
            )
        return found


def across(normal: F64) -> tuple[F64, F64]:
    """Return two unit vectors that complete a right-handed frame."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(abs(normal)))])
    first = first / np.linalg.norm(first)
    return first, np.cross(normal, first)


def _is_inside(pixel: Pixel, corners: F64) -> bool:
    """Return whether a point is inside a convex outline of either orientation."""
    edges, ways = np.roll(corners, -1, axis=0) - corners, np.asarray(pixel) - corners
    turns = edges[:, 0] * ways[:, 1] - edges[:, 1] * ways[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def _distance(pixel: Pixel, shape: Shape) -> float:
    """Return the distance from a point to the nearest front-facing line of a shape [pixel]."""
    starts, ends = shape.points[:-1], shape.points[1:]
    seen = shape.front[:-1] & shape.front[1:]
    if not seen.any():
        return float("inf")
    starts, ways = starts[seen], (ends - starts)[seen]
    squares = np.maximum(np.sum(ways * ways, axis=1), 1e-30)
    parts = np.clip(np.sum((np.asarray(pixel) - starts) * ways, axis=1) / squares, 0.0, 1.0)
    nearest = starts + parts[:, None] * ways
    return float(np.min(np.linalg.norm(np.asarray(pixel) - nearest, axis=1)))
