"""Read the AOVs under a pixel of the viewport at full resolution, by drawing them again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.delegate.render_buffer import Pixels
from usdsplat.preview.document import Document
from usdsplat.preview.sides import Side
from usdsplat.render.specs import Framing, View

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PixelProbe:
    """AOVs of the pixels around a pixel."""

    side: Side
    """Side of a comparison that contains the pixel."""
    arrays: Mapping[str, Pixels]
    """Pixels by Hydra's AOV name; shape (rows, columns) or (rows, columns, channels)."""
    prims: tuple[str, ...]
    """Paths of the prims by primId, current: the stage may have changed since the last picture."""
    x: int
    y: int
    """Position of the pixel from the viewport's top left."""
    row: int
    column: int
    """Its position in the arrays."""


def read(
    document: Document, x: float, y: float, aovs: tuple[str, ...], *, reach: int = 0
) -> PixelProbe | None:
    """Draw the pixels around a pixel of the viewport at full quality.

    Args:
        document: Document whose last picture is used; it does not change otherwise.
        x, y: Position from the viewport's top left [pixel].
        aovs: Hydra's names of AOVs.
        reach: Number of pixels on each side, limited to the picture.

    Returns:
        The pixels; None outside the viewport and before the first picture.
    """
    shown = document.shown
    if shown is None:
        return None
    width, height = shown.picture.state.size
    column, row = math.floor(x), math.floor(y)
    if not (0 <= column < width and 0 <= row < height):
        return None
    x0, y0 = max(0, column - reach), max(0, row - reach)
    window = x0, y0, min(width, column + reach + 1), min(height, row + reach + 1)
    side = shown.side_at(x)
    arrays = read_window(side, (width, height), window, aovs)
    return PixelProbe(
        side=side,
        arrays=arrays,
        prims=side.scene.engine.drawn_paths(),
        x=column,
        y=row,
        row=row - y0,
        column=column - x0,
    )


def read_window(
    side: Side,
    size: tuple[int, int],
    window: tuple[int, int, int, int],
    aovs: tuple[str, ...],
) -> dict[str, Pixels]:
    """Draw some pixels of one side of the last picture at full quality, by Hydra's AOV names.

    Args:
        side: The side.
        size: Width and height of the viewport [pixel].
        window: First column and row, and those after the last.
        aovs: Hydra's names of AOVs.
    """
    framing = Framing(resolution=size, data_window=window)
    view = View(camera=side.scene.camera, framing=framing)
    settings = replace(side.look.settings, samples=1)
    engine = side.scene.engine
    if engine.time != side.scene.time:  # a comparison was started since
        engine.set_time(side.scene.time)
    bands = [band.arrays for band in engine.render(view, settings, aovs)]
    return {name: np.concatenate([band[name] for band in bands]) for name in aovs}


def vector(numbers: Pixels) -> Vector:
    """Convert an array of three numbers to a tuple."""
    x, y, z = numbers.tolist()
    return x, y, z
