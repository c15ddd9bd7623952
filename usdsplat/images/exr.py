"""Write OpenEXR files band by band.

Colour and data share a part and ids have their own, or each AOV has one. Colour may be half; data
channels in the same part stay float32, because EXR has a type per channel. Colour beyond the range
of half is clamped to +-65504, its largest number: an infinite pixel would spread through every
filter.

Ids are uint32 in a separate part, written from uint32 arrays: in a float buffer, every id above
2^24 would change. dwaa and dwab are lossy for every channel named R, G or B. Cryptomatte, whose
numbers must stay exact, is then moved to a separate part with zip.

A file stores its parts one after the other, but a render produces them together. So all parts but
the first are kept in unnamed files beside the target until the first is complete: memory holds one
band, regardless of the picture's size.

Source: OpenEXR's standard attributes; ASWF Color Interop IDs; OpenImageIO's notes on OpenEXR.
"""

from __future__ import annotations

import math
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import numpy.typing as npt
import OpenImageIO as oiio

import usdsplat
from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.images import cryptomatte
from usdsplat.images.aovs import Aov, find_aovs
from usdsplat.images.color import color_space
from usdsplat.images.compression import Compression
from usdsplat.images.labels import is_reproducible
from usdsplat.images.layout import Band, ImageLayout, Metadata
from usdsplat.images.timecode import Timecode
from usdsplat.images.whole_exr import is_whole_exr
from usdsplat.images.writer import ROWS, ImageWriter

Pixels = npt.NDArray[Any]

DEFAULT = "zip"
"""Compression of a layout that names none, and of parts that a lossy one would spoil."""

SHARED = (
    "usdsplat:ids",
    "worldToCamera",
    "worldToNDC",
    "screenWindowCenter",
    "screenWindowWidth",
    "usdsplat:projection",
    "pinholeFocalLength",
    "sensorOverallDimensions",
    "framesPerSecond",
    "timeCode",
)
"""Entries of every part: the prims of ids, the camera and the time. Readers of a single part need
them there."""

PART_NAMES = {"color": "rgba", "Z": "depth"}
"""AOV -> name of its part in a multipart file, if it differs from the AOV's."""


@dataclass(frozen=True, slots=True)
class _Part:
    """AOVs that share a part."""

    name: str
    aovs: tuple[Aov, ...]
    compression: Compression


class ExrWriter(ImageWriter):
    """Writer of an EXR file; see `ImageWriter` for its use.

    Args:
        path: The file; it appears when the context ends without an error.
        layout: Contents of the file; `pixel_type` half (default) or float. All compressions keep
            ids and Cryptomatte exactly.

    Raises:
        UsageError: If EXR cannot have this layout or compression.
        OutputError: If the file cannot be created, on entering the context.
    """

    FORMAT = "openexr"

    def __init__(self, path: Path | str, layout: ImageLayout) -> None:
        compression = Compression.parse(layout.compression or DEFAULT, where=str(path))
        if layout.pixel_type not in (None, "half", "float"):
            raise UsageError(str(path), f"{layout.pixel_type} pixels", "half or float in an EXR")
        found = find_aovs(layout.aovs, where=str(path))
        aovs = tuple(aov.with_rank(layout.crypto_rank) for aov in found)
        self._parts = _parts(aovs, layout, compression)
        self._waiting: list[IO[bytes]] = []
        self._tile_rows: list[Pixels] = []
        specs = tuple(_spec(layout, part) for part in self._parts)
        _label(specs, self._parts, layout.metadata)
        super().__init__(path, layout, specs)

    def __enter__(self) -> Self:
        super().__enter__()
        with ExitStack() as stack:
            stack.push(self._stack)
            folder = Path(self._temporary).parent
            self._waiting = [
                stack.enter_context(tempfile.TemporaryFile(dir=folder)) for _ in self._parts[1:]
            ]
            self._stack = stack.pop_all()
        return self

    def _append(self, y0: int, band: Band) -> None:
        first, *others = [
            _side_by_side([self._stored(aov, band[aov.name]) for aov in part.aovs])
            for part in self._parts
        ]
        self._write_rows(y0, first)
        for pixels, file in zip(others, self._waiting, strict=True):
            self._put_aside(pixels, file)

    def _stored(self, aov: Aov, values: Pixels) -> Pixels:
        """Return the values of an AOV in the file: within the range of its type, NaN as it is, and
        with the layout's depth in empty pixels."""
        if aov.is_depth and self._layout.empty_depth != math.inf:
            return np.where(np.isposinf(values), np.float32(self._layout.empty_depth), values)
        if _type_of(aov, self._layout) != "half":
            return values
        found = np.clip(values, -HALF_MAX, HALF_MAX)
        return found if aov.kind == "color" else np.where(np.isfinite(values), found, values)

    def _write_rows(self, y0: int, pixels: Pixels) -> None:
        """Append rows to the open part: at once, or in whole rows of tiles."""
        size = self._layout.tile_size
        if not size:
            super()._write_rows(y0, pixels)
            return
        x0, top, x1, bottom = self._layout.window
        self._tile_rows.append(pixels)
        end = y0 + len(pixels)
        rows = np.concatenate(self._tile_rows)
        first = end - len(rows)
        last = max(first, bottom if end == bottom else end - (end - top) % size)
        if last > first:
            self._check(self._file.write_tiles(x0, x1, first, last, 0, 1, rows[: last - first]))
        self._tile_rows = [rows[last - first :]] if end > last else []

    def _put_aside(self, pixels: Pixels, file: IO[bytes]) -> None:
        """Store rows of a later part until the parts before it are complete."""
        try:
            file.write(pixels.data)  # not tofile, which does not report all errors
        except OSError as error:
            raise OutputError(
                str(self._path),
                "no space for the temporary file of a later EXR part",
                "a writable place with enough free space",
            ) from error

    def _is_whole(self, path: Path) -> bool:
        return is_whole_exr(path)

    def _finish(self) -> None:
        """Append the stored parts after the first, some rows at a time."""
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


def _parts(
    aovs: tuple[Aov, ...], layout: ImageLayout, compression: Compression
) -> tuple[_Part, ...]:
    """Assign AOVs to parts, in the order of the file."""
    groups: dict[str, list[Aov]] = {}
    for aov in aovs:
        groups.setdefault(_part_name(aov, layout.multipart, compression), []).append(aov)
    # Colour first, ids last: readers of a single part read the first.
    names = sorted(groups, key=lambda name: (name not in ("main", "rgba"), name == "ids"))
    return tuple(_part(name, tuple(groups[name]), compression) for name in names)


def _part_name(aov: Aov, is_multipart: bool, compression: Compression) -> str:
    """Return the name of an AOV's part."""
    if aov.kind == "id":
        return "ids"
    if is_multipart:
        return PART_NAMES.get(aov.name, aov.name)
    return aov.name if _must_be_exact(aov) and compression.is_lossy else "main"


def _part(name: str, aovs: tuple[Aov, ...], compression: Compression) -> _Part:
    """Return a part with a compression that keeps its channels exact where necessary."""
    is_exact = any(map(_must_be_exact, aovs))
    is_spoilt = is_exact and compression.is_lossy
    return _Part(name, aovs, Compression(DEFAULT) if is_spoilt else compression)


def _must_be_exact(aov: Aov) -> bool:
    """Return whether an AOV is data that a lossy compression would treat as colour by its name."""
    return aov.kind == "data" and any(name.endswith((".R", ".G", ".B")) for name in aov.channels)


def _side_by_side(arrays: list[Pixels]) -> Pixels:
    """Return the channels of a part, shape (rows, width, channels), contiguous."""
    planes = [np.atleast_3d(array) for array in arrays]
    return np.ascontiguousarray(planes[0]) if len(planes) == 1 else np.concatenate(planes, axis=2)


def _spec(layout: ImageLayout, part: _Part) -> oiio.ImageSpec:
    """Return the header entries and channels of a part."""
    rows, columns = layout.shape
    types = tuple(_type_of(aov, layout, name) for aov in part.aovs for name in aov.channels)
    spec = oiio.ImageSpec(columns, rows, len(types), types[0])
    spec.channelformats = types
    spec.channelnames = tuple(name for aov in part.aovs for name in aov.channels)
    spec.x, spec.y = layout.window[:2]
    spec.full_x, spec.full_y = 0, 0
    spec.full_width, spec.full_height = layout.resolution
    spec.attribute("compression", str(part.compression))
    if layout.tile_size:
        spec.tile_width, spec.tile_height = layout.tile_size, layout.tile_size
    spec.attribute("oiio:subimagename", part.name)
    for aov in part.aovs:
        spec.attribute(f"usdsplat:aov:{aov.name}", aov.meaning_with(layout.empty_depth))
    # OpenEXR rejects files whose parts differ in one of these two.
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
    """Add metadata of the whole picture: our version, and the caller's entries."""
    specs[0].attribute("Software", f"usdsplat {usdsplat.__version__}")
    if is_reproducible():
        for spec in specs:
            spec.attribute("DateTime", "")  # else OpenImageIO writes the time of now
    _attach(specs[0], entries)
    for spec, part in zip(specs[1:], parts[1:], strict=True):
        layers = tuple(
            f"{cryptomatte.prefix_of(aov.name)}/" for aov in part.aovs if aov.is_cryptomatte
        )
        shared = {
            key: value for key, value in entries.items() if key in SHARED or key.startswith(layers)
        }
        _attach(spec, shared)


def _attach(spec: oiio.ImageSpec, metadata: Metadata) -> None:
    """Add the caller's entries."""
    for key, value in metadata.items():
        if isinstance(value, Fraction):
            spec.attribute(key, oiio.TypeRational, (value.numerator, value.denominator))
        elif isinstance(value, Timecode):
            spec.attribute("smpte:TimeCode", oiio.TypeTimeCode, (value.packed, 0))
        elif isinstance(value, tuple):
            kind = "matrix" if len(value) == 16 else f"float[{len(value)}]"
            spec.attribute(key, kind, tuple(float(number) for number in value))
        else:
            spec.attribute(key, value)


def _type_of(aov: Aov, layout: ImageLayout, channel: str = "") -> str:
    """Return the type of a channel; "uint", because OpenImageIO silently makes half of "uint32"."""
    if aov.kind == "color":
        usual = layout.pixel_type or "half"
        return layout.pixel_types.get("alpha" if channel == "A" else aov.name, usual)
    if aov.kind == "id":
        return "uint"
    is_coded = aov.name.startswith("crypto")  # ids as bits of floating-point numbers
    return "float" if is_coded else layout.pixel_types.get(aov.name, "float")
