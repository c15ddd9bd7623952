"""A flat picture into its file, band by band."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.delegate.engine import Engine
from usdsplat.images import open_writer
from usdsplat.images.aovs import AOVS
from usdsplat.images.layout import ImageLayout
from usdsplat.images.view import ViewTransform
from usdsplat.products.request import Picture
from usdsplat.render.occluders import ReadHoldout
from usdsplat.render.output import view_of
from usdsplat.render.specs import View


def draw_flat(
    engine: Engine,
    picture: Picture,
    path: Path,
    view: View,
    layout: ImageLayout,
    *,
    holdout: ReadHoldout | None,
    band_pixels: int,
    finished: Callable[[int], None],
) -> None:
    """Draw `picture` at the engine's time.

    Args:
        view: What is looked at.
        layout: What the file is going to hold.
        holdout: What else hides, as `Engine.render` takes it.
        band_pixels: As `Engine.render` takes it.
        finished: Told how many rows are in the file.

    Raises:
        OutputError: If the file cannot be written.
    """
    # A premultiplied colour goes through a view by the coverage of the pixel.
    with_color = picture.is_baked and "albedo" in picture.aovs
    names = dict.fromkeys((*picture.aovs, *(("color",) if with_color else ())))
    by_hydra = {AOVS[name].hydra: AOVS[name] for name in names}
    through = view_of(picture.settings) if picture.is_baked else None
    bands = engine.render(
        view, picture.settings, tuple(by_hydra), holdout=holdout, band_pixels=band_pixels
    )
    with open_writer(path, layout) as writer:
        for band in bands:
            # -1, which stands for nothing among the renderer's ids, is 2**32 - 1 in the file.
            arrays = {
                aov.name: array.view(np.uint32) if aov.kind == "id" else array
                for aov, array in ((by_hydra[key], band.arrays[key]) for key in by_hydra)
            }
            if through is not None:
                arrays |= _baked(through, arrays)
            writer.write_band(band.y0, arrays)
            finished(band.y1 - layout.window[1])


def _baked(
    through: ViewTransform, arrays: dict[str, npt.NDArray[Any]]
) -> dict[str, npt.NDArray[Any]]:
    """What a view shows of all colours."""
    shown: dict[str, npt.NDArray[Any]] = {}
    if "albedo" in arrays:
        image = np.concatenate([arrays["albedo"], arrays["color"][..., 3:]], axis=-1)
        shown["albedo"] = np.ascontiguousarray(through.forward_over(image)[..., :3])
    if "color" in arrays:
        shown["color"] = through.forward_over(arrays["color"])
    return shown
