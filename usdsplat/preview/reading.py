"""Read the AOVs under a pixel of the viewport at full resolution, by drawing them again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.delegate.render_buffer import Pixels
from usdsplat.preview.document import Document
from usdsplat.preview.drawing import Side
from usdsplat.render.specs import Framing, View

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PixelProbe:
    """AOVs of the pixels around one."""

    side: Side
    """The side of a comparison that the pixel is on."""
    arrays: Mapping[str, Pixels]
    """Hydra's name of an AOV -> its pixels; shape (rows, columns) or (rows, columns, channels)."""
    prims: tuple[str, ...]
    """Paths that primId counts, by now: the stage may be other than in the last picture."""
    x: int
    y: int
    """The pixel, from the viewport's top left."""
    row: int
    column: int
    """Where it is in the arrays."""


def read(
    document: Document, x: float, y: float, aovs: tuple[str, ...], *, reach: int = 0
) -> PixelProbe | None:
    """Draw the pixels around one of the viewport as a full picture would.

    Args:
        document: Whose last picture is looked at; nothing else of it changes.
        x, y: From the viewport's top left [pixel].
        aovs: In Hydra's words.
        reach: How many pixels to each side, as far as there are any.

    Returns:
        What is there; None outside of the viewport and before the first picture.
    """
    shown = document.shown
    if shown is None:
        return None
    width, height = shown.picture.state.size
    column, row = math.floor(x), math.floor(y)
    if not (0 <= column < width and 0 <= row < height):
        return None
    side = shown.side_at(x)
    x0, y0 = max(0, column - reach), max(0, row - reach)
    window = x0, y0, min(width, column + reach + 1), min(height, row + reach + 1)
    framing = Framing(resolution=(width, height), data_window=window)
    view = View(camera=side.scene.camera, framing=framing)
    settings = replace(side.look.settings, samples=1)
    engine = side.scene.engine
    if engine.time != side.scene.time:  # a comparison was asked for since
        engine.set_time(side.scene.time)
    bands = [band.arrays for band in engine.render(view, settings, aovs)]
    arrays = {name: np.concatenate([band[name] for band in bands]) for name in aovs}
    return PixelProbe(
        side=side,
        arrays=arrays,
        prims=engine.drawn_paths(),
        x=column,
        y=row,
        row=row - y0,
        column=column - x0,
    )


def vector(numbers: Pixels) -> Vector:
    """Three numbers of an array."""
    x, y, z = numbers.tolist()
    return x, y, z
