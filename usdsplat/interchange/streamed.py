"""Open a streamed SOG as a splat tree, as it is: its files are the chunks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Usd

from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import I64
from usdsplat.core.errors import FormatError
from usdsplat.core.node_cuts import level_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture
from usdsplat.formats.capture import UNKNOWN_AXES
from usdsplat.formats.sog import ERROR_BOUNDS, FRAME, lod
from usdsplat.formats.sog.decoding import Sog, limits, read_sizes
from usdsplat.formats.sog.lod_nodes import LodNodes
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.models import author_model
from usdsplat.interchange.placement import (
    define_ancestors,
    field_path,
    placement,
    set_default_prim,
    set_op,
)
from usdsplat.interchange.streamed_table import RangeSizes, table_of
from usdsplat.schema.chunks import ChunkReader
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.tree import author_tree

_SAMPLED = 1 << 16
"""Number of splats by which axes are chosen."""
_MOST_READS = 512
"""Largest number of ranges that they are read from: to read a few splats takes a millisecond."""


def is_streamed(path: Path) -> bool:
    """Return whether a capture is a streamed SOG.

    Raises:
        FormatError: If the file cannot be opened.
        UnknownFormatError: If it has no known format.
    """
    return formats.find(path) is lod


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StreamedSog:
    """A streamed SOG as a splat tree; only sizes of its coarse levels have been read."""

    path: Path
    """`lod-meta.json`."""
    table: NodeTable
    chunks: tuple[str, ...]
    """Files of the SOGs: archives, or `meta.json` of folders."""
    degree: int
    """Highest degree of the harmonics of a file."""
    antialiased: bool
    """Whether a file of the finest level states that its splats are for the antialiased
    projection; the other levels are always drawn so."""
    format: str

    @classmethod
    def open(cls, path: Path, progress: Progress = silent) -> StreamedSog:
        """Read the metadata of all files, and the sizes of the splats of all levels but the finest.

        The environment is a leaf below the root, which is always drawn.

        Raises:
            FormatError: If a file is missing or damaged, or contradicts `lod-meta.json`.
        """
        path, meta = lod.read_meta(path)
        names, nodes = meta.names, meta.nodes
        if meta.environment is not None:
            if meta.environment in names:
                raise FormatError(f"{path}: environment", meta.environment, "a file of its own")
            with lod.open_unit(path, meta.environment) as sog:
                nodes = _with_environment(nodes, len(names), sog.meta.count)
            names += (meta.environment,)
        units = _Units.survey(path, names, nodes, progress)
        versions = " and ".join(map(str, sorted(units.versions)))
        return cls(
            path=path,
            table=table_of(str(path), nodes, units.sizes),
            chunks=tuple(str(path.parent.absolute() / name) for name in names),
            degree=units.degree,
            antialiased=units.antialiased,
            format=f"streamed SOG {versions}".rstrip(),
        )

    def sample(self) -> Capture:
        """Return a few splats of the coarsest level as a capture.

        Raises:
            FormatError: If there are no splats.
            StageError: If a file is damaged.
        """
        reader, table = ChunkReader(self.chunks, self.degree), self.table
        if not table.proxies.any():
            raise FormatError(str(self.path), "no splats", "at least one")
        rows = level_cut(table, int(np.iinfo(np.int32).max)).rows(table)
        rows = rows[:: -(-len(rows) // _MOST_READS)]
        few = _SAMPLED // len(rows)
        parts = [reader.read(chunk, first, min(count, few)) for chunk, first, count in rows]
        return Capture(
            cloud=edit.merge(parts),
            format=self.format,
            files=(self.path, *map(Path, self.chunks)),
            frame=FRAME,
            frame_source="assumed",
            antialiased=self.antialiased,
            error_bounds=ERROR_BOUNDS,
            notes=(UNKNOWN_AXES,),
        )

    def author(self, stage: Usd.Stage, capture: Capture) -> Usd.Prim:
        """Author the tree on a stage in memory; no splat is copied.

        Args:
            stage: The stage; its edit target is written.
            capture: The sample, with axes.

        Raises:
            StageError: If two leaves have a splat in common.
        """
        where = field_path(stage, self.path, None)
        define_ancestors(stage, where)
        mode = "antialiased" if capture.antialiased else "classic"
        prim = author_tree(
            stage,
            where,
            self.table,
            self.chunks,
            degree=self.degree,
            color_space=capture.color_space,
            drawing=DrawingHints(rasterize_mode=mode),
        )
        set_op(prim, placement(stage, capture.frame, capture.meters_per_unit).matrix)
        set_default_prim(stage, where)
        author_model(prim, None)
        return prim


def open_streamed(
    path: Path, stage: Usd.Stage, *, axes: str | None = None, progress: Progress = silent
) -> tuple[Usd.Prim, Capture]:
    """Author a streamed SOG as a splat tree whose chunks are its files.

    Args:
        path: `lod-meta.json`, or its folder.
        stage: A stage in memory; its edit target is written.
        axes: Axes of the capture; None or "auto" chooses them by splats of the coarsest level.
        progress: Receives the progress of reading metadata and sizes.

    Returns:
        The tree; a sample of the coarsest level, with axes.

    Raises:
        FormatError: If a file is missing or damaged, or contradicts `lod-meta.json`.
        StageError: If two leaves have a splat in common.
        UsageError: If the axes are invalid.
    """
    streamed = StreamedSog.open(path, progress)
    sample = streamed.sample()
    capture = with_axes(sample, choose_axes(sample, axes))
    return streamed.author(stage, capture), capture


@dataclass(frozen=True, slots=True, eq=False)
class _Units:
    """What is known of the SOGs of a tree."""

    sizes: RangeSizes
    degree: int
    versions: frozenset[int]
    antialiased: bool

    @classmethod
    def survey(
        cls, path: Path, names: Sequence[str], nodes: LodNodes, progress: Progress
    ) -> _Units:
        """Read the metadata of all files with splats of the tree, and the sizes of coarse ones.

        Raises:
            FormatError: If a file is missing or damaged, or lacks splats of the tree.
        """
        count = len(nodes.range_file)
        sizes = RangeSizes(
            low=np.zeros((count, 3)),
            high=np.zeros((count, 3)),
            largest=np.zeros(count),
            typical=np.zeros(count),
        )
        order = np.lexsort((nodes.range_first, nodes.range_file))
        files, starts = np.unique(nodes.range_file[order], return_index=True)
        degree, versions, antialiased = 0, set(), False
        for done, file in enumerate(files.tolist()):
            progress.step(f"reading {path}", done, len(files))
            rows = order[starts[done] : starts[done + 1] if done + 1 < len(files) else None]
            with lod.open_unit(path, names[file]) as sog:
                last = int((nodes.range_first + nodes.range_count)[rows].max())
                if last > sog.meta.count:
                    found = f"splat {last - 1} of {names[file]}"
                    raise FormatError(str(path), found, f"one of its {sog.meta.count}")
                sizes.low[rows], sizes.high[rows], sizes.largest[rows] = limits(sog.meta)
                coarse = rows[nodes.range_level[rows] > 0]
                if len(coarse):
                    _measure(sog, nodes, coarse, sizes)
                degree = max(degree, sog.degree)
                versions.add(sog.meta.version)
                antialiased |= sog.meta.antialiased and len(coarse) < len(rows)
        progress.step(f"reading {path}", len(files), len(files))
        return cls(sizes, degree, frozenset(versions), antialiased)


def _measure(sog: Sog, nodes: LodNodes, rows: I64, sizes: RangeSizes) -> None:
    """Measure the largest scale and the typical size of the splats of some ranges of a file, as
    `interchange.lod.levels.typical_size` does.

    Args:
        sog: The file.
        nodes: The ranges.
        rows: Numbers of the ranges of the file to measure.
        sizes: Receives the sizes.
    """
    counts = nodes.range_count[rows]
    begins = np.cumsum(counts) - counts
    own = np.repeat(np.arange(len(rows)), counts)
    chosen = np.arange(counts.sum()) + (nodes.range_first[rows] - begins)[own]
    scales, opacities = (each[chosen] for each in read_sizes(sog))
    sizes.largest[rows] = np.maximum.reduceat(scales.max(axis=1), begins)
    scales.sort(axis=1)
    area = scales[:, 1].astype(np.float64) * scales[:, 2]
    order = np.lexsort((area, own))
    weights = np.cumsum((area * opacities)[order])
    before = np.r_[0.0, weights[:-1]][begins]
    middle = 0.5 * (before + weights[begins + counts - 1])
    median = np.clip(np.searchsorted(weights, middle), begins, begins + counts - 1)
    sizes.typical[rows] = np.sqrt(area[order[median]])


def _with_environment(nodes: LodNodes, file: int, count: int) -> LodNodes:
    """Return the nodes below a new root, beside a leaf with all splats of a file."""
    last = len(nodes.parents) + 1
    unknown = np.full((1, 3), np.nan)
    added = min(count, 1)  # a range must not be empty
    return LodNodes(
        parents=np.r_[-1, nodes.parents + 1, 0].astype(np.int32),
        low=np.concatenate([unknown, nodes.low, unknown]),
        high=np.concatenate([unknown, nodes.high, unknown]),
        range_node=np.r_[nodes.range_node + 1, [last] * added].astype(np.int32),
        range_level=np.r_[nodes.range_level, [0] * added].astype(np.int32),
        range_file=np.r_[nodes.range_file, [file] * added].astype(np.int64),
        range_first=np.r_[nodes.range_first, [0] * added].astype(np.int64),
        range_count=np.r_[nodes.range_count, [count] * added].astype(np.int64),
    )
