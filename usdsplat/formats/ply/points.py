"""Read plain point clouds: PLY files with positions and optional colours, without splats.

Each point becomes an opaque sphere whose sigma is half the distance to its nearest neighbour.
Neighbours then meet at one sigma, and a sampled surface closes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core import morton
from usdsplat.core.cloud import F32, F64
from usdsplat.core.sh import rgb_to_dc
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.options import ReadOptions
from usdsplat.formats.ply.columns import Columns
from usdsplat.formats.ply.header import Header
from usdsplat.formats.ply.table import Table

LONE_SIGMA = 0.01
"""Sigma of a point without any neighbour [scene unit]."""
LONGEST = 4.0
"""Maximum neighbour distance, in medians: keeps isolated points small."""

_POSITIONS = ("x", "y", "z")
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_SHIFTS = (0.0, 0.23, 0.41)  # see `shift` of `morton.codes`
_REACH = 4
_FLOAT32_MAX = float(np.finfo(np.float32).max)


def read_points(path: Path, header: Header, table: Table, how: ReadOptions) -> Capture:
    """Read points; integer colours span their type, float ones 0 to 1, the default is mid grey.

    Raises:
        FormatError: If a position or colour is not finite.
    """
    colors = next((names for names in _COLORS if set(names) <= set(table.types)), ())
    builder = CloudBuilder(str(path), table.count, 0, how)
    builder.rotations[:] = (1, 0, 0, 0)
    builder.opacities[:] = 1
    builder.scales[:] = 0
    builder.sh[:] = 0
    get_positions = Columns(table.dtype, _POSITIONS)
    get_colors = Columns(table.dtype, colors)
    names = {"positions": _POSITIONS, "sh": colors}
    tops = np.array([_top(table.types[name]) for name in colors], np.float32)
    for rows, block in table.blocks():
        get_positions.into(builder.positions[rows], block)
        if colors:
            get_colors.into(builder.sh[rows, 0], block)
            builder.sh[rows, 0] = rgb_to_dc(builder.sh[rows, 0] / tops)
        builder.settle(rows, lambda field, column: f"property {names[field][column]}")
        how.progress.step(f"reading {path}", rows.stop, table.count)
    cloud, dropped = builder.cloud()
    cloud.scales[:] = (0.5 * neighbour_distances(cloud.positions))[:, None]
    note = (
        "plain points: each becomes an opaque ball, with half the distance to its nearest "
        "neighbour as standard deviation; the axes are assumed"
    )
    return Capture(
        cloud=cloud,
        format=f"PLY points, {header.data_kind}",
        files=(path,),
        frame="rdf",
        frame_source="assumed",
        notes=(note, UNKNOWN_AXES, *dropped, *table.remarks()),
    )


def neighbour_distances(positions: F32) -> F32:
    """Estimate the distance of each point to its nearest neighbour.

    Only points close in one of three Morton orders are compared, so a distance is never too short
    and rarely much too long. Points at the same position do not count. Distances are limited to
    `LONGEST` medians. Points without any neighbour get the median.

    Args:
        positions: Finite points, shape (n, 3).

    Returns:
        Distances [scene unit], shape (n,), all positive.
    """
    best = np.full(len(positions), np.inf)
    if len(positions):
        for shift in _SHIFTS:
            _shorten(
                best, positions, np.argsort(morton.codes(positions, shift=shift), kind="stable")
            )
    found = best[np.isfinite(best)]
    median = float(np.median(found)) if len(found) else 2 * LONE_SIGMA
    longest = min(LONGEST * median, _FLOAT32_MAX)
    return np.minimum(np.where(np.isfinite(best), best, median), longest).astype(np.float32)


def _shorten(best: F64, positions: F32, order: npt.NDArray[np.intp]) -> None:
    """Lower `best` to the distances between points that are close to each other in `order`."""
    ordered = positions[order].astype(np.float64)
    for step in range(1, _REACH + 1):
        gaps = ordered[step:] - ordered[:-step]
        distances = np.sqrt(np.einsum("ni,ni->n", gaps, gaps))
        distances[distances == 0] = np.inf
        for ends in (order[step:], order[:-step]):
            best[ends] = np.minimum(best[ends], distances)


def _top(code: str) -> float:
    """Return the value of a colour property of this type that represents 1."""
    return float(np.iinfo(code).max) if code[0] in "iu" else 1.0
