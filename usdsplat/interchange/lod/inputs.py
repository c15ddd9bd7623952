"""Open the inputs of a tree."""

from __future__ import annotations

from pathlib import Path

from usdsplat import formats
from usdsplat.formats import ply
from usdsplat.interchange.files import is_usd
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.ply_source import PlySource
from usdsplat.interchange.lod.sources import CaptureSource, Source
from usdsplat.interchange.lod.stage_source import StageSource
from usdsplat.interchange.lod.streamed_source import StreamedSource
from usdsplat.interchange.streamed import is_streamed


def open_source(path: Path, options: LodOptions) -> Source:
    """Return an input.

    Raises:
        StageError: If a stage cannot be opened, or has no visible field.
        FormatError: If a capture cannot be opened.
        UnknownFormatError: If it has no known format.
    """
    if is_usd(path):
        return StageSource(path, options)
    if options.reading.lod == 0 and is_streamed(path):
        return StreamedSource(path, options)
    count = ply.count_splats(path) if formats.find(path) is ply else None
    return CaptureSource(path, options) if count is None else PlySource(path, count, options)
