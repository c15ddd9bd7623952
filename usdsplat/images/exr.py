"""OpenEXR files, written band by band: colour and data in one part, ids in another; or many parts.

Colour may be half; data channels beside it stay float32 in the same part, because EXR keeps a type
for each channel. Colour that half cannot hold is clamped to +-65504, its largest number: an
infinite pixel would spread through every filter that the picture goes through.

Ids are uint32 in a part of their own, written from uint32 arrays: on the way through a float buffer
every id above 2^24 would change. dwaa and dwab lose a little wherever a channel is called R, G or
B, whatever it holds, so Cryptomatte, whose numbers must not change by a bit, leaves their part for
one with zip.

A file takes one part after the other and a render makes them side by side, so all but the first
wait in unnamed files beside the target until the first is complete: memory holds one band, whatever
the size of the picture.

Source: OpenEXR's standard attributes; ASWF Color Interop IDs; OpenImageIO's notes on OpenEXR.
"""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Self

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
"""Those that keep float32 data as it is, for which parts with Cryptomatte leave the last two."""
LOSSY = ("dwaa", "dwab")

SHARED = (
    "usdsplat:ids",
    "worldToCamera",
    "worldToNDC",
    "screenWindowCenter",
    "screenWindowWidth",
)
"""Entries that every part has: what ids stand for and where the camera is. Readers that look at one
part only need them there."""

PART_NAMES = {"color": "rgba", "Z": "depth"}
"""AOV -> its part in a file of many, where that is not the AOV's name."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Some AOVs that are kept together."""

    name: str
    aovs: tuple[Aov, ...]
    compression: str


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
        self._parts = _parts(aovs, layout, compression)
        self._waiting: list[IO[bytes]] = []
        specs = tuple(_spec(layout, part) for part in self._parts)
        _label(specs, self._parts, layout.metadata)
        super().__init__(path, layout, specs)

    def __enter__(self) -> Self:
        super().__enter__()
        with ExitStack() as stack:
            stack.push(self._stack)
            folder = self._temporary.parent
            self._waiting = [
                stack.enter_context(tempfile.TemporaryFile(dir=folder)) for _ in self._parts[1:]
            ]
            self._stack = stack.pop_all()
        return self

    def _append(self, y0: int, band: Band) -> None:
        first, *others = [
            _side_by_side([self._within_range(aov, band[aov.name]) for aov in part.aovs])
            for part in self._parts
        ]
        self._write_rows(y0, first)
        for pixels, file in zip(others, self._waiting, strict=True):
            self._put_aside(pixels, file)

    def _within_range(self, aov: Aov, values: Pixels) -> Pixels:
        """Values that the channels of an AOV can hold; NaN stays NaN."""
        is_half = _type_of(aov, self._layout) == "half"
        return np.clip(values, -HALF_MAX, HALF_MAX) if is_half else values

    def _put_aside(self, pixels: Pixels, file: IO[bytes]) -> None:
        """Let rows of a later part wait until the parts before it are complete."""
        try:
            pixels.tofile(file)
        except OSError as error:
            raise OutputError(
                str(self._path), "no room for later parts beside it", "a place with room to write"
            ) from error

    def _finish(self) -> None:
        """Copy the parts that wait behind the first, some rows at a time."""
        _, top, _, bottom = self._layout.window
        width = self._layout.shape[1]
        for i, file in enumerate(self._waiting, start=1):
            self._open_next_part(self._specs[i])
            dtype = np.uint32 if self._parts[i].aovs[0].kind == "id" else np.float32
            channels = self._specs[i].nchannels
            file.seek(0)
            for y0 in range(top, bottom, ROWS):
                rows = min(ROWS, bottom - y0)
                pixels = np.fromfile(file, dtype, rows * width * channels)
                self._write_rows(y0, pixels.reshape(rows, width, channels))


def _parts(aovs: tuple[Aov, ...], layout: ImageLayout, compression: str) -> tuple[_Part, ...]:
    """Who shares a part with whom, in the order of the file."""
    groups: dict[str, list[Aov]] = {}
    for aov in aovs:
        groups.setdefault(_part_name(aov, layout.multipart, compression), []).append(aov)
    # Colour leads and ids come last: readers that know one part only look at the first.
    names = sorted(groups, key=lambda name: (name not in ("main", "rgba"), name == "ids"))
    return tuple(_part(name, tuple(groups[name]), compression) for name in names)


def _part_name(aov: Aov, is_multipart: bool, compression: str) -> str:
    """The part that an AOV goes to."""
    if aov.kind == "id":
        return "ids"
    if is_multipart:
        return PART_NAMES.get(aov.name, aov.name)
    return aov.name if _must_be_exact(aov) and compression in LOSSY else "main"


def _part(name: str, aovs: tuple[Aov, ...], compression: str) -> _Part:
    """A part, with a compression that its channels can bear."""
    is_exact = any(map(_must_be_exact, aovs))
    return _Part(name, aovs, "zip" if is_exact and compression in LOSSY else compression)


def _must_be_exact(aov: Aov) -> bool:
    """Whether a lossy compression would change data, which it takes by name for colour."""
    return aov.kind == "data" and any(name.endswith((".R", ".G", ".B")) for name in aov.channels)


def _side_by_side(arrays: list[Pixels]) -> Pixels:
    """The channels of one part, shape (rows, width, channels), contiguous."""
    planes = [np.atleast_3d(array) for array in arrays]
    return np.ascontiguousarray(planes[0]) if len(planes) == 1 else np.concatenate(planes, axis=2)


def _spec(layout: ImageLayout, part: _Part) -> oiio.ImageSpec:
    """Header of one part, as far as the parts have it in common, and its channels."""
    rows, columns = layout.shape
    types = tuple(_type_of(aov, layout) for aov in part.aovs for _ in aov.channels)
    spec = oiio.ImageSpec(columns, rows, len(types), types[0])
    spec.channelformats = types
    spec.channelnames = tuple(name for aov in part.aovs for name in aov.channels)
    spec.x, spec.y = layout.window[:2]
    spec.full_x, spec.full_y = 0, 0
    spec.full_width, spec.full_height = layout.resolution
    spec.attribute("compression", part.compression)
    spec.attribute("oiio:subimagename", part.name)
    for aov in part.aovs:
        spec.attribute(f"usdsplat:aov:{aov.name}", aov.meaning)
    # Parts that disagree on one of these two are refused by OpenEXR.
    spec.attribute("PixelAspectRatio", float(layout.pixel_aspect_ratio))
    chromaticities = color_space(layout.color_space, where="output color space").chromaticities
    if chromaticities is not None:
        spec.attribute("chromaticities", "float[8]", chromaticities)
    is_said = chromaticities is not None or layout.color_space == "unknown"
    has_color = is_said and any(aov.kind == "color" for aov in part.aovs)
    name = layout.color_space if has_color else "data"
    spec.attribute("oiio:ColorSpace", name)
    spec.attribute("colorInteropID", name)
    return spec


def _label(specs: tuple[oiio.ImageSpec, ...], parts: tuple[_Part, ...], entries: Metadata) -> None:
    """Add what describes the picture as a whole: our version, and the caller's entries."""
    specs[0].attribute("Software", f"usdsplat {usdsplat.__version__}")
    _attach(specs[0], entries)
    for spec, part in zip(specs[1:], parts[1:], strict=True):
        shared = set(SHARED)
        if any(map(_must_be_exact, part.aovs)):
            shared.update(key for key in entries if key.startswith("cryptomatte/"))
        _attach(spec, {key: value for key, value in entries.items() if key in shared})


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
