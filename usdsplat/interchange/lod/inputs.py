"""Open the inputs of a tree."""

from __future__ import annotations

from pathlib import Path

from usdsplat.interchange.files import is_usd
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.sources import CaptureSource, Source
from usdsplat.interchange.lod.stage_source import StageSource


def open_source(path: Path, options: LodOptions) -> Source:
    """Return an input.

    Raises:
        StageError: If a stage cannot be opened, or has no visible field.
    """
    return StageSource(path, options) if is_usd(path) else CaptureSource(path, options)
