"""Measure the errors of a few nodes on their pictures, and estimate those of the others.

The error of a node is the size of a pixel at which the picture of its proxies is as good as that of
its children; see `pictures`. It is measured for a few nodes of each of the lowest levels. For the
others it is proportional to the typical size of their proxies, by the factor of the measured nodes
of the same level, or else of the highest measured level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from usdsplat.core.cloud import F32, F64, I32, I64, SplatCloud
from usdsplat.core.node_cuts import heights
from usdsplat.core.node_table import NESTED, NodeTable, nested
from usdsplat.core.progress import Progress
from usdsplat.interchange.lod import chunks, levels
from usdsplat.interchange.lod.chunks import chunk_name, joined, read_chunk
from usdsplat.interchange.lod.pictures import Comparison, Pair
from usdsplat.interchange.lod.sources import splat_bytes
from usdsplat.kernels.device import Device
from usdsplat.render.specs import RasterizeMode

_Load = Callable[[int], SplatCloud]
MEASURED = (16, 4, 2)
"""Number of nodes that are measured with leaves at most 1, 2, 3 levels below."""
MOST_SPLATS, MOST_BYTES = 600_000, 96 << 20
"""Nodes with more splats below, or larger ones, are not measured, because of time and memory."""

_LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ErrorMeter:
    """Measure of the errors of the nodes of a tree."""

    table: NodeTable
    sizes: F64
    """Typical size of the proxies of each node [unit], shape (n,)."""
    folder: Path
    """Folder of the chunks."""
    degree: int
    """Degree of the harmonics."""
    pixel: float
    """Size of the pixel of the baked low-pass [unit]; 0 for none. From closer, leaves are right."""
    captured_mode: RasterizeMode
    """How pictures draw splats of the capture."""
    device: Device

    def errors(self, progress: Progress) -> F32:
        """Return the errors of all nodes [unit], 0 for leaves, shape (n,)."""
        above = heights(self.table)
        factors, measured = self._measured(above, progress)
        estimated = self._estimated(above, factors)
        estimated[list(measured)] = list(measured.values())
        return nested(estimated, self.table)

    def _estimated(self, above: I32, factors: F64) -> F64:
        """Return errors [unit] by height and size, not nested, 0 for leaves; from closer than the
        pixel of the low-pass, leaves are right.

        Args:
            above: Heights of the nodes.
            factors: Errors relative to sizes for the height 1, 2, ..., the last one also above.
        """
        height = np.clip(above - 1, 0, len(factors) - 1)
        return np.where(above > 0, np.maximum(factors[height] * self.sizes, self._closest), 0.0)

    @property
    def _closest(self) -> float:
        """Size of the pixel from which on nodes are drawn [unit], in the range of the table."""
        return min(self.pixel, _LARGEST)

    def _measured(self, above: I32, progress: Progress) -> tuple[F64, dict[int, float]]:
        """Return errors relative to typical sizes for nodes of the height 1, 2, ..., and the errors
        of the measured nodes [unit]."""
        below, few = splats_below(self.table), MOST_BYTES // splat_bytes(self.degree)
        is_fit = (below <= min(few, MOST_SPLATS)) & (self.sizes > 0)
        asked = [
            (height, node)
            for height, most in enumerate(MEASURED, 1)
            for node in _spread(np.flatnonzero((above == height) & is_fit), most)
        ]
        comparison, load = Comparison(self.device), lru_cache(maxsize=2)(self._chunk)
        found: list[list[float]] = [[] for _ in MEASURED]
        measured: dict[int, float] = {}
        for done, (height, node) in enumerate(asked):
            progress.step("measuring errors", done, len(asked))
            least = self._closest
            if lower := [_mean(each) for each in found[: height - 1] if each]:
                first, count = self.table.first_child[node], self.table.child_count[node]
                errors = self._estimated(above, np.array(lower))[first : first + count]
                least = max(least, NESTED * float(errors.max()))
            error = comparison.error(self._pair(node, load), self.sizes[node], least)
            found[height - 1].append(error / self.sizes[node])
            measured[node] = error
        progress.step("measuring errors", len(asked), len(asked))
        return np.array([_mean(each) for each in found if each] or [1.0]), measured

    def _pair(self, node: int, load: _Load) -> Pair:
        """Return what is drawn of a node, of its children, and of the leaves below."""
        table, own = self.table, self._splats(node, load)
        captured = [chunks.rows(own, int(table.proxies[node]), len(own))]
        proxies = [chunks.rows(own, 0, 0)]
        first = int(table.first_child[node])
        for child in range(first, first + int(table.child_count[node])):
            splats = self._splats(child, load)
            here = int(table.proxies[child]) if table.child_count[child] else 0
            proxies.append(chunks.rows(splats, 0, here))
            captured.append(chunks.rows(splats, here, len(splats)))
        return Pair(
            node=own,
            proxies=joined(proxies),
            captured=joined(captured),
            captured_mode=self.captured_mode,
            leaves=self._leaves(node, load),
        )

    def _leaves(self, node: int, load: _Load) -> SplatCloud:
        """Return what is drawn of a node if all below it is refined, with the baked low-pass."""
        table, parts, waiting = self.table, [], [node]
        while waiting:
            here = waiting.pop()
            count = int(table.child_count[here])
            if count == 0:
                parts.append(levels.baked(self._splats(here, load), self.pixel))
                continue
            own = self._splats(here, load)
            parts.append(chunks.rows(own, int(table.proxies[here]), len(own)))
            first = int(table.first_child[here])
            waiting.extend(range(first, first + count))
        return joined(parts)

    def _splats(self, node: int, load: _Load) -> SplatCloud:
        """Return the proxies and residents of a node."""
        table, first = self.table, int(self.table.first_row[node])
        count = int(table.proxies[node] + table.residents[node])
        return chunks.rows(load(int(table.chunk[node])), first, first + count)

    def _chunk(self, number: int) -> SplatCloud:
        """Return the splats of a chunk."""
        return read_chunk(self.folder / chunk_name(number))


def splats_below(table: NodeTable) -> I64:
    """Return the number of splats of the leaves below each node, its own for a leaf, shape (n,)."""
    parents = table.parents()
    found = np.where(table.child_count == 0, table.proxies, 0).astype(np.int64)
    for node in range(len(table) - 1, 0, -1):
        found[parents[node]] += found[node]
    return found


def _mean(errors: Sequence[float]) -> float:
    """Return the geometric mean."""
    return float(np.exp(np.mean(np.log(errors))))


def _spread(nodes: I64, most: int) -> list[int]:
    """Return at most `most` of the nodes, evenly spread."""
    if not len(nodes):
        return []
    places = np.linspace(0, len(nodes) - 1, min(most, len(nodes)))
    return [int(nodes[int(place)]) for place in places]
