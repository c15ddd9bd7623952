"""Draw a flat picture into its file, band by band."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.delegate.engine import Engine
from usdsplat.images import open_writer
from usdsplat.images.aovs import aov_named
from usdsplat.images.view import ViewTransform
from usdsplat.products.picture_file import PictureFile, RowsWritten
from usdsplat.render.band import Band
from usdsplat.render.output import view_of

EMPTY = 2**32 - 1
"""Id of empty pixels in files."""


def draw_flat(engine: Engine, file: PictureFile, *, rows_written: RowsWritten) -> None:
    """Draw a picture at the engine's time. The file appears when it is complete.

    Args:
        engine: Engine that draws.
        file: The picture and its file.
        rows_written: Called after each band. An exception that it raises ends the drawing, and no
            file is left.

    Raises:
        OutputError: If the file cannot be written.
    """
    write_flat(file, flat_bands(engine, file), rows_written=rows_written)


def write_flat(file: PictureFile, bands: Iterable[Band], *, rows_written: RowsWritten) -> None:
    """Write the bands of a picture, see `flat_bands`, into its file. For errors see `draw_flat`."""
    with open_writer(file.path, file.layout) as writer:
        for band in bands:
            writer.write_band(band.y0, band.arrays)
            rows_written(band.y1 - file.layout.window[1])


def flat_bands(engine: Engine, file: PictureFile) -> Iterator[Band]:
    """Yield the bands of a picture at the engine's time, with the values of its file.

    Their arrays are named by AOV, ids are those of files, and colours have the view transform if it
    is baked.
    """
    plan = file.plan
    # The view transform of a premultiplied colour needs the coverage of the pixel.
    with_color = plan.is_baked and "albedo" in plan.aovs
    names = dict.fromkeys((*plan.aovs, *(("color",) if with_color else ())))
    by_hydra = {aov.hydra: aov for aov in map(aov_named, names)}
    through = view_of(plan.settings) if plan.is_baked else None
    bands = engine.render(
        file.view,
        plan.settings,
        tuple(by_hydra),
        holdout=file.holdout,
        band_pixels=file.band_pixels,
    )
    numbers = _file_ids(engine) if "id" in names else np.empty(0, np.uint32)
    for band in bands:
        # The renderer's id for no prim, -1, is 2**32 - 1 in the file.
        arrays = {
            aov.name: array.view(np.uint32) if aov.kind == "id" else array
            for aov, array in ((by_hydra[key], band.arrays[key]) for key in by_hydra)
        }
        if "id" in arrays:
            arrays["id"] = numbers[band.arrays["primId"]]
        if through is not None:
            arrays |= _baked(through, arrays)
        yield Band(band.y0, band.y1, arrays)


def _file_ids(engine: Engine) -> npt.NDArray[np.uint32]:
    """Return the id in files of each drawn prim: its index among all prims that can be drawn.

    The last entry, which the renderer's -1 selects, is the id of empty pixels.
    """
    index = {path: number for number, path in enumerate(engine.stage_info().prims)}
    return np.array([*(index[path] for path in engine.drawn_paths()), EMPTY], np.uint32)


def _baked(
    through: ViewTransform, arrays: dict[str, npt.NDArray[Any]]
) -> dict[str, npt.NDArray[Any]]:
    """Return the colour AOVs after the view transform."""
    shown: dict[str, npt.NDArray[Any]] = {}
    if "albedo" in arrays:
        image = np.concatenate([arrays["albedo"], arrays["color"][..., 3:]], axis=-1)
        shown["albedo"] = np.ascontiguousarray(through.forward_over(image)[..., :3])
    if "color" in arrays:
        shown["color"] = through.forward_over(arrays["color"])
    return shown
