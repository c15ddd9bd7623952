"""Describe one picture of one frame and its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from usdsplat.images.layout import ImageLayout
from usdsplat.products.request import PicturePlan
from usdsplat.render.band import BAND_PIXELS
from usdsplat.render.deep_merging import ENTRIES
from usdsplat.render.occluders import ReadHoldout
from usdsplat.render.specs import View

RowsWritten = Callable[[int], None]
"""Callback that receives the number of rows of a picture that are in its file."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PictureFile:
    """Picture to draw at the engine's time, and its file."""

    plan: PicturePlan
    path: Path
    view: View
    """View of the picture."""
    layout: ImageLayout
    """Layout of the file, with its header."""
    holdout: ReadHoldout | None = None
    """External holdout, see `Engine.render`."""
    band_pixels: int = BAND_PIXELS
    """See `Engine.render`."""
    deep_entries: int = ENTRIES
    """See `DeepSize`."""
