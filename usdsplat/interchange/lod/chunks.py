"""Write and read the chunks of a tree: layers with the splats of sibling nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat import schema
from usdsplat.core import edit
from usdsplat.core.cloud import F64, I64, SplatCloud
from usdsplat.core.extent import extent
from usdsplat.core.output import output_file
from usdsplat.interchange import files
from usdsplat.interchange.authoring import prepare
from usdsplat.interchange.lod.runs import cloud_of, rows_of
from usdsplat.schema import DrawingHints
from usdsplat.schema.chunk_layers import state_digest
from usdsplat.schema.packed import SLACK

FIELD = "/splats"
"""Path of the field in a chunk, its default prim."""

_SUFFIX, _NOTES = ".usdc", ".npz"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkForm:
    """What all chunks of a tree have in common."""

    up_axis: str
    meters_per_unit: float
    color_space: str
    drawing: DrawingHints
    """Those of the leaves."""

    def hints(self, *, of_leaves: bool) -> DrawingHints:
        """Return the drawing hints of leaves, or of proxies."""
        if of_leaves:
            return self.drawing
        return replace(self.drawing, rasterize_mode="antialiased", footprint=None)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChunkNodes:
    """The nodes whose splats are in a chunk, in the order of its rows, and what passes them."""

    proxies: I64
    """Number of proxies of each node, shape (k,)."""
    residents: I64
    """Number of residents of each node, which follow its proxies, shape (k,)."""
    low: F64
    """Lower corner of the box around the splats of each node and of those below it [unit], shape
    (k, 3)."""
    high: F64
    """Upper corners, shape (k, 3)."""
    sizes: F64
    """Typical size of the proxies of each node [unit], 0 for a leaf, shape (k,)."""
    strays: SplatCloud
    """Splats that are too large for these nodes and belong to one above."""
    digest: str
    """Digest of the splats of the chunk."""

    @property
    def first_rows(self) -> I64:
        """Row at which each node begins, shape (k,)."""
        counts = self.proxies + self.residents
        return np.cumsum(counts) - counts


def chunk_name(number: int) -> str:
    """Return the file name of a chunk."""
    return f"{number:04}{_SUFFIX}"


def write_chunk(
    target: Path, cloud: SplatCloud, form: ChunkForm, *, has_leaves: bool
) -> tuple[SplatCloud, str]:
    """Write splats as the layer of a chunk.

    Returns:
        The splats as they are drawn, and their digest, which the layer states.

    Raises:
        OutputError: If the file cannot be written.
    """
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, form.up_axis, form.meters_per_unit)
    prim = schema.author(
        stage,
        FIELD,
        cloud,
        form="packed",
        color_space=form.color_space,
        drawing=form.hints(of_leaves=has_leaves),
    )
    stage.SetDefaultPrim(prim)
    digest = state_digest(stage.GetRootLayer())
    files.save(stage.GetRootLayer(), target)
    return schema.fetch(prim), digest


def read_chunk(path: Path) -> SplatCloud:
    """Return the splats of a chunk as they are drawn.

    Raises:
        StageError: If the file is not a chunk.
    """
    stage = files.open_stage(path)
    return schema.fetch(stage.GetDefaultPrim())


def boxes_of(cloud: SplatCloud, counts: I64) -> tuple[F64, F64]:
    """Return the corners of the boxes around consecutive groups of splats, each of shape (k, 3);
    inf and -inf for a group without splats."""
    low, high = np.full((len(counts), 3), np.inf), np.full((len(counts), 3), -np.inf)
    ends = np.cumsum(counts)
    for group, (count, end) in enumerate(zip(counts, ends, strict=True)):
        box = extent(rows(cloud, int(end - count), int(end)), slack=SLACK)
        if box is not None:
            low[group], high[group] = box
    return low, high


def rows(cloud: SplatCloud, first: int, last: int) -> SplatCloud:
    """Return consecutive splats, without a copy."""
    part = slice(first, last)
    return SplatCloud(
        positions=cloud.positions[part],
        scales=cloud.scales[part],
        rotations=cloud.rotations[part],
        opacities=cloud.opacities[part],
        sh=cloud.sh[part],
    )


def write_nodes(chunk: Path, nodes: ChunkNodes) -> None:
    """Write what is known of the nodes of a chunk beside it. The chunk is finished with it."""
    with output_file(chunk.with_suffix(_NOTES)) as output, output.open() as file:
        np.savez(
            file,
            proxies=nodes.proxies,
            residents=nodes.residents,
            low=nodes.low,
            high=nodes.high,
            sizes=nodes.sizes,
            strays=rows_of(nodes.strays),
            digest=nodes.digest,
        )


def read_nodes(chunk: Path) -> ChunkNodes:
    """Return what `write_nodes` wrote."""
    with np.load(chunk.with_suffix(_NOTES), allow_pickle=False) as found:
        arrays = dict(found)
    strays, digest = cloud_of(arrays.pop("strays")), str(arrays.pop("digest"))
    return ChunkNodes(strays=strays, digest=digest, **arrays)


def is_finished(chunk: Path) -> bool:
    """Return whether a chunk and what is known of its nodes were written."""
    return chunk.is_file() and chunk.with_suffix(_NOTES).is_file()


def joined(clouds: list[SplatCloud]) -> SplatCloud:
    """Concatenate clouds of one degree; a single one is not copied."""
    return clouds[0] if len(clouds) == 1 else edit.merge(clouds)


def taken(cloud: SplatCloud, mask: npt.NDArray[np.bool_]) -> tuple[SplatCloud, SplatCloud]:
    """Return the splats outside of a mask, and those in it."""
    if not mask.any():
        return cloud, rows(cloud, 0, 0)
    return edit.take(cloud, ~mask), edit.take(cloud, mask)
