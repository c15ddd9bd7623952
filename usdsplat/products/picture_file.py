"""One picture of one frame, and the file that it is drawn into."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from usdsplat.images.layout import ImageLayout
from usdsplat.products.request import PicturePlan
from usdsplat.render.occluders import ReadHoldout
from usdsplat.render.renderer import BAND_PIXELS
from usdsplat.render.specs import View

RowsWritten = Callable[[int], None]
"""Told how many rows of a picture are in its file."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PictureFile:
    """A picture that is about to be drawn at the engine's time."""

    plan: PicturePlan
    path: Path
    view: View
    """What is looked at."""
    layout: ImageLayout
    """What the file is going to hold, with its header."""
    holdout: ReadHoldout | None = None
    """What else hides, as `Engine.render` takes it."""
    band_pixels: int = BAND_PIXELS
    """As `Engine.render` takes it."""
