"""Measure nodes of a tree in a view: their projected errors, and whether they can be seen.

The projected error of a node is its error [local unit] divided by the size of a pixel there. The
nearest point of the node's box that the view can show decides. A child is never measured larger
than its parent, because its box lies within its parent's and its error is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, I64
from usdsplat.core.extent import REACH
from usdsplat.core.node_table import NodeTable
from usdsplat.render.screen import MARGIN, Screen

Bools = npt.NDArray[np.bool_]

MARGIN_PIXELS = 1
"""Pixels around the window within which nodes are kept, for samples beside the pixels' centres."""
ROUNDING = 1e-6
OUTSIDE = 2e-3
"""Part of a box's size by which the nodes below may exceed it: more than what `check_nodes` lets
pass, on all levels together."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Measures of p pairs of instance and node; all arrays have the shape (p,)."""

    errors: F64
    """Projected errors [pixel]; 0 for a node that is not shown."""
    shown: Bools
    """Whether a splat of the node or of a node below can touch the display or the data window."""
    in_window: Bools
    """Whether one can touch the data window."""
    inside: Bools
    """Whether all nodes below are shown too, as the whole box is within the windows."""


@dataclass(frozen=True, eq=False)
class NodeMeasure:
    """Measure of the nodes of one tree in one view.

    Args:
        transforms: Local to world of each instance, shape (m, 4, 4).
        tangential: Whether splats are projected on the planes across their viewing rays.
    """

    table: NodeTable
    screen: Screen
    transforms: F64
    tangential: bool = False

    def of(self, instances: I64, nodes: I64) -> Measured:
        """Measure p pairs of instance and node."""
        low, high = (each[nodes].astype(np.float64) for each in (self.table.low, self.table.high))
        center, half = 0.5 * (low + high), 0.5 * (high - low)
        with np.errstate(invalid="ignore", over="ignore"):
            to_camera = self._to_camera[instances]
            linear = to_camera[:, :3, :3]
            at = np.einsum("pij,pj->pi", linear, center) + to_camera[:, :3, 3]
            box = _Box(linear, at, half)
            seen, between = box.between(*self.screen.clipping_range)
            in_window, inside = self._touches(box, self.screen.window)
            x0, y0, x1, y1 = self.screen.window
            width, height = self.screen.size
            union = min(x0, 0), min(y0, 0), max(x1, width), max(y1, height)
            shown = in_window
            if union != (x0, y0, x1, y1):
                shown, inside = self._touches(box, union)
            shown, in_window, inside = seen & shown, seen & in_window, between & inside
            errors = np.where(shown, self._errors(instances, nodes, box), 0)
        return Measured(np.nan_to_num(errors, posinf=np.inf), shown, in_window, inside)

    # --- private ---------------------------------------------------------------------------

    def _errors(self, instances: I64, nodes: I64, box: _Box) -> F64:
        """Return the projected errors [pixel]."""
        largest, smallest, eyes = self._of_instances
        errors = self.table.errors[nodes].astype(np.float64)
        scaled = errors * largest[instances] * max(self.screen.focal)
        if self.screen.orthographic:
            return np.asarray(scaled)
        low, high = self.table.low[nodes], self.table.high[nodes]
        eye = eyes[instances]
        apart = np.linalg.norm(np.maximum(0.0, np.maximum(low - eye, eye - high)), axis=1)
        beside = smallest[instances] * apart * self._least_cosine()
        depth = np.maximum(np.maximum(box.nearest(), beside), self.screen.clipping_range[0])
        return np.asarray(scaled / np.maximum(depth, np.finfo(np.float64).tiny))

    @cached_property
    def _to_camera(self) -> F64:
        """Local to camera of each instance, shape (m, 4, 4)."""
        return np.asarray(self.screen.world_to_camera @ self.transforms)

    @cached_property
    def _of_instances(self) -> tuple[F64, F64, F64]:
        """Return the largest and the smallest singular value of each instance, shape (m,), and the
        eye in its local space, shape (m, 3)."""
        linear = np.nan_to_num(self.transforms[:, :3, :3])
        sizes = np.asarray(np.linalg.svd(linear, compute_uv=False), np.float64)
        offset = self.screen.eye - np.nan_to_num(self.transforms[:, :3, 3])
        eyes = np.einsum("mij,mj->mi", np.linalg.pinv(linear), offset)
        return sizes[:, 0], sizes[:, 2], np.asarray(eyes, np.float64)

    def _least_cosine(self) -> float:
        """Return the least cosine of an angle between the axis and a ray of the display window."""
        (fx, fy), (cx, cy), (width, height) = (
            self.screen.focal,
            self.screen.center,
            self.screen.size,
        )
        u = max(abs(-0.5 - cx), abs(width - 0.5 - cx)) / fx
        v = max(abs(-0.5 - cy), abs(height - 0.5 - cy)) / fy
        return float(1 / np.sqrt(1 + u * u + v * v))

    def _touches(self, box: _Box, window: tuple[int, int, int, int]) -> tuple[Bools, Bools]:
        """Return two masks of the boxes, shape (p,) each.

        The first is whether a splat in the box can touch a window. The second is whether the whole
        box is in the window: then splats of every smaller box in it can touch the window too.

        A splat reaches REACH standard deviations on the screen, as its box, plus the low-pass. What
        the affine approximation adds is added: it is taken at the splat's centre, not at the border
        of the window.
        """
        screen = self.screen
        margin = MARGIN_PIXELS + REACH * np.sqrt(screen.low_pass)
        x0, y0, x1, y1 = window
        touches, inside = np.ones((2, len(box.at)), np.bool_)
        for axis, (first, last) in enumerate(((x0, x1 - 1), (y0, y1 - 1))):
            focal, middle = screen.focal[axis], screen.center[axis]
            size = screen.size[axis]
            extra = MARGIN * 0.5 * size / focal
            for sign, edge, clamp in (
                (1, last + margin, (size - 0.5 - middle) / focal + extra),
                (-1, first - margin, (-0.5 - middle) / focal - extra),
            ):
                slope = (edge - middle) / focal
                beyond, within = self._beside(box, axis, sign, slope, abs(clamp - slope))
                touches &= ~beyond
                inside &= within
        return touches, inside

    def _beside(
        self, box: _Box, axis: int, sign: int, slope: float, turn: float
    ) -> tuple[Bools, Bools]:
        """Return whether all splats of the box are beyond one edge of a window, and whether the
        whole box is on the other side.

        Args:
            axis: 0 for x, 1 for y.
            sign: 1 for the right or lower edge, -1 for the left or upper one.
            slope: x / z or y / z of the edge; for parallel rays x or y.
            turn: Largest difference between the slope and that of a splat beyond the edge.
        """
        g = [0.0, 0.0, 0.0]
        g[axis] = float(sign)
        if self.screen.orthographic:
            middle, half = box.at[:, axis] * sign - sign * slope, box.half(*g)
            beyond = middle - half > ROUNDING * (1 + abs(slope))
        else:
            g[2] = -sign * slope
            middle, half = _weighted(g, box.at), box.half(*g)
            reach = turn * box.half_depth
            if self.tangential:
                halves = [box.half(*row) for row in np.eye(3).tolist()]
                reach = np.linalg.norm(halves, axis=0) + half
            beyond = middle - half - reach > ROUNDING * (1 + abs(slope)) * np.abs(box.at[:, 2])
        return np.asarray(beyond), np.asarray(middle + (1 + OUTSIDE) * half <= 0)


@dataclass(frozen=True, eq=False)
class _Box:
    """Boxes of p nodes in camera space."""

    linear: F64
    """Local to camera, shape (p, 3, 3)."""
    at: F64
    """Centres, shape (p, 3)."""
    size: F64
    """Half extents in local space, shape (p, 3)."""

    @cached_property
    def half_depth(self) -> F64:
        """Half of the extent in depth."""
        return self.half(0, 0, 1)

    def half(self, x: float, y: float, z: float) -> F64:
        """Return half of the extent along a direction in camera space."""
        return np.asarray((np.abs(_weighted((x, y, z), self.linear)) * self.size).sum(axis=1))

    def nearest(self) -> F64:
        """Return the least planar depth."""
        return np.asarray(self.at[:, 2] - self.half_depth)

    def between(self, near: float, far: float) -> tuple[Bools, Bools]:
        """Return whether the box is partly between two planar depths, and whether all boxes within
        are."""
        depth, half = self.at[:, 2], self.half_depth
        nearest, farthest = depth - half, depth + half
        slack = ROUNDING * (np.abs(nearest) + np.abs(farthest))
        partly = (farthest + slack >= near) & (nearest - slack <= far)
        more = (1 + OUTSIDE) * half
        return np.asarray(partly), np.asarray((depth - more >= near) & (depth + more <= far))


def _weighted(weights: Sequence[float], rows: F64) -> F64:
    """Return the weighted sum over the second axis, of three elements.

    Each result depends on its own row only. With `@`, the last bit would depend on their number.
    """
    found = np.zeros_like(rows[:, 0])
    for axis, weight in enumerate(weights):
        if weight:
            found += weight * rows[:, axis]
    return found
