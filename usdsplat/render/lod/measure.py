"""Measure nodes of a tree in a view: their projected errors, and whether they can be seen.

The projected error of a node is its error [local unit] divided by the size of a pixel there. The
nearest point of the node's box that the view can show decides. A child is never measured larger
than its parent, because its box lies within its parent's and its error is smaller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, I64
from usdsplat.core.extent import REACH
from usdsplat.core.node_table import NodeTable
from usdsplat.kernels import node_measure
from usdsplat.render.lod.placing import Placing
from usdsplat.render.screen import MARGIN, Screen

Bools = npt.NDArray[np.bool_]

MARGIN_PIXELS = 1
"""Pixels around the window within which nodes are kept, for samples beside the pixels' centres."""


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


class NodeMeasure:
    """Measure of the nodes of one tree in one view.

    Args:
        placing: The instances.
        tangential: Whether splats are projected on the planes across their viewing rays.
    """

    def __init__(
        self, table: NodeTable, screen: Screen, placing: Placing, tangential: bool = False
    ) -> None:
        self._table, self._scales = table, placing.scales
        with np.errstate(invalid="ignore", over="ignore"):
            self._to_camera = np.asarray(screen.world_to_camera @ placing.transforms)
            self._eyes = placing.eyes(screen.eye)
        self._is_parallel, self._is_tangential = screen.orthographic, tangential
        x0, y0, x1, y1 = screen.window
        width, height = screen.size
        windows = dict.fromkeys(
            (screen.window, (min(x0, 0), min(y0, 0), max(x1, width), max(y1, height)))
        )
        self._edges = np.array([list(_edges(screen, window)) for window in windows])
        self._lens = np.array([*screen.clipping_range, max(screen.focal), _least_cosine(screen)])

    def of(self, instances: I64, nodes: I64) -> Measured:
        """Measure p pairs of instance and node."""
        table, count = self._table, len(nodes)
        errors, masks = np.empty(count), np.empty((3, count), np.bool_)
        node_measure.measure(
            instances, nodes, table.low, table.high, table.errors, self._to_camera, self._scales,
            self._eyes, self._edges, self._lens, self._is_parallel, self._is_tangential, errors,
            *masks,
        )  # fmt: skip
        return Measured(errors, *masks)


def _least_cosine(screen: Screen) -> float:
    """Return the least cosine of an angle between the axis and a ray of the display window."""
    (fx, fy), (cx, cy), (width, height) = screen.focal, screen.center, screen.size
    u = max(abs(-0.5 - cx), abs(width - 0.5 - cx)) / fx
    v = max(abs(-0.5 - cy), abs(height - 0.5 - cy)) / fy
    return 1 / math.sqrt(1 + u * u + v * v)


def _edges(
    screen: Screen, window: tuple[int, int, int, int]
) -> Iterator[tuple[float, float, float, float]]:
    """Yield the edges of a window, see `kernels.node_measure`.

    A splat reaches REACH standard deviations on the screen, as its box, plus the low-pass. What the
    affine approximation adds is added: it is taken at the splat's centre, not at the border of the
    window.
    """
    margin = MARGIN_PIXELS + REACH * math.sqrt(screen.low_pass)
    x0, y0, x1, y1 = window
    for axis, (first, last) in enumerate(((x0, x1 - 1), (y0, y1 - 1))):
        focal, middle, size = screen.focal[axis], screen.center[axis], screen.size[axis]
        extra = MARGIN * 0.5 * size / focal
        for sign, edge, clamp in (
            (1, last + margin, (size - 0.5 - middle) / focal + extra),
            (-1, first - margin, (-0.5 - middle) / focal - extra),
        ):
            slope = (edge - middle) / focal
            yield axis, sign, slope, abs(clamp - slope)
