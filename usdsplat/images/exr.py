"""OpenEXR files, written band by band: colour and data in one part, ids in another.

Colour may be half; data channels beside it stay float32 in the same part, because EXR keeps a type
for each channel. Colour that half cannot hold is clamped to +-65504, its largest number: an
infinite pixel would spread through every filter that the picture goes through.

Ids are uint32 in a second part, written from uint32 arrays: on the way through a float buffer every
id above 2^24 would change. A file takes one part after the other and a render makes them side by
side, so ids wait in an unnamed file beside the target until the first part is complete: memory
holds one band, whatever the size of the picture.

Source: OpenEXR's standard attributes; ASWF Color Interop IDs; OpenImageIO's notes on OpenEXR.
"""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

import usdsplat
from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.images.aovs import Aov, find_aovs
from usdsplat.images.color import color_space
from usdsplat.images.layout import Band, ImageLayout, Metadata
from usdsplat.images.writer import ROWS, ImageWriter

Pixels = npt.NDArray[Any]

COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "dwaa", "dwab")
"""Those that keep float32 data as it is; dwaa and dwab lose a little in R, G and B only."""

SHARED = (
    "usdsplat:ids",
    "worldToCamera",
    "worldToNDC",
    "screenWindowCenter",
    "screenWindowWidth",
)
"""Entries that every part has: what ids stand for and where the camera is. Readers that look at one
part only need them there."""


class ExrWriter(ImageWriter):
    """An EXR file that is being written; see `ImageWriter` for how to feed it.

    Args:
        path: The file; it appears when the context ends without an error.
        layout: What it will hold; `pixel_type` half (default) or float.
        compression: One of `COMPRESSIONS`; ids are kept exactly by any of them.

    Raises:
        UsageError: If the layout or the compression is not one that EXR can hold.
        OutputError: If the file cannot be made, on entering the context.
    """

    FORMAT = "openexr"

    def __init__(self, path: Path | str, layout: ImageLayout, *, compression: str = "zip") -> None:
        if compression not in COMPRESSIONS:
            expected = f"one of {', '.join(COMPRESSIONS)}"
            raise UsageError(str(path), f"compression {compression!r}", expected)
        if layout.pixel_type not in (None, "half", "float"):
            raise UsageError(str(path), f"{layout.pixel_type} pixels", "half or float in an EXR")
        aovs = find_aovs(layout.aovs, where=str(path))
        halves = ([a for a in aovs if a.kind != "id"], [a for a in aovs if a.kind == "id"])
        self._parts = [part for part in halves if part]
        specs = tuple(_spec(layout, part, compression) for part in self._parts)
        _label(specs[0], layout)
        for spec in specs[1:]:
            _attach(spec, {key: layout.metadata[key] for key in SHARED if key in layout.metadata})
        super().__init__(path, layout, specs)

    def __enter__(self) -> Self:
        super().__enter__()
        if len(self._parts) > 1:
            with ExitStack() as stack:
                stack.push(self._stack)
                self._spool = stack.enter_context(
                    tempfile.TemporaryFile(dir=self._temporary.parent)
                )
                self._stack = stack.pop_all()
        return self

    def _append(self, y0: int, band: Band) -> None:
        pixels = [
            _side_by_side([self._within_range(aov, band[aov.name]) for aov in part])
            for part in self._parts
        ]
        self._write_rows(y0, pixels[0])
        if len(pixels) > 1:
            self._spool_rows(pixels[1])

    def _within_range(self, aov: Aov, values: Pixels) -> Pixels:
        """Values that the channels of an AOV can hold; NaN stays NaN."""
        is_half = _type_of(aov, self._layout) == "half"
        return np.clip(values, -HALF_MAX, HALF_MAX) if is_half else values

    def _spool_rows(self, ids: Pixels) -> None:
        """Put ids aside until the first part is complete."""
        try:
            ids.tofile(self._spool)
        except OSError as error:
            raise OutputError(
                str(self._path), "no room for ids beside it", "a place with room to write"
            ) from error

    def _finish(self) -> None:
        """Copy the ids that wait behind the first part, some rows at a time."""
        if len(self._parts) == 1:
            return
        self._open_next_part(self._specs[1])
        _, top, _, bottom = self._layout.window
        width, channels = self._layout.shape[1], len(self._parts[1])
        self._spool.seek(0)
        for y0 in range(top, bottom, ROWS):
            rows = min(ROWS, bottom - y0)
            ids = np.fromfile(self._spool, np.uint32, rows * width * channels)
            self._write_rows(y0, ids.reshape(rows, width, channels))


def _side_by_side(arrays: list[Pixels]) -> Pixels:
    """The channels of one part, shape (rows, width, channels), contiguous."""
    planes = [np.atleast_3d(array) for array in arrays]
    return np.ascontiguousarray(planes[0]) if len(planes) == 1 else np.concatenate(planes, axis=2)


def _spec(layout: ImageLayout, part: list[Aov], compression: str) -> oiio.ImageSpec:
    """Header of one part, as far as the parts have it in common, and its channels."""
    rows, columns = layout.shape
    types = tuple(_type_of(aov, layout) for aov in part for _ in aov.channels)
    spec = oiio.ImageSpec(columns, rows, len(types), types[0])
    spec.channelformats = types
    spec.channelnames = tuple(name for aov in part for name in aov.channels)
    spec.x, spec.y = layout.window[:2]
    spec.full_x, spec.full_y = 0, 0
    spec.full_width, spec.full_height = layout.resolution
    spec.attribute("compression", compression)
    spec.attribute("oiio:subimagename", "ids" if part[0].kind == "id" else "main")
    for aov in part:
        spec.attribute(f"usdsplat:aov:{aov.name}", aov.meaning)
    # Parts that disagree on one of these two are refused by OpenEXR.
    spec.attribute("PixelAspectRatio", float(layout.pixel_aspect_ratio))
    space = color_space(layout.color_space, where="output color space")
    if space.chromaticities is not None:
        spec.attribute("chromaticities", "float[8]", space.chromaticities)
    return spec


def _label(spec: oiio.ImageSpec, layout: ImageLayout) -> None:
    """Add what describes the picture as a whole: its space, our version, the caller's entries."""
    is_data = color_space(layout.color_space).chromaticities is None
    name = "data" if is_data else layout.color_space
    spec.attribute("oiio:ColorSpace", name)
    spec.attribute("colorInteropID", name)
    spec.attribute("Software", f"usdsplat {usdsplat.__version__}")
    _attach(spec, layout.metadata)


def _attach(spec: oiio.ImageSpec, metadata: Metadata) -> None:
    """Add entries of the caller's."""
    for key, value in metadata.items():
        if isinstance(value, tuple):
            kind = "matrix" if len(value) == 16 else f"float[{len(value)}]"
            spec.attribute(key, kind, tuple(float(number) for number in value))
        else:
            spec.attribute(key, value)


def _type_of(aov: Aov, layout: ImageLayout) -> str:
    """How a channel is kept; "uint", because the name "uint32" would silently become half."""
    if aov.kind == "color":
        return layout.pixel_type or "half"
    return "uint" if aov.kind == "id" else "float"
