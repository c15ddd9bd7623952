"""PlayCanvas's SOG, versions 1 and 2: lossless WebP images of codes, one pixel per splat.

A zip archive, or a folder with `meta.json`. 16-bit positions on a logarithmic scale, 8-bit codes
into tables for the rest, harmonics from a palette. Lossy: see `ERROR_BOUNDS`.

Source: PlayCanvas, "The SOG Format"; for version 1 the reader of splat-transform. The document says
"rub"; the files that its tools write hold the axes of the capture they came from.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, SH_DEGREES
from usdsplat.core.encoding import decode_smallest_three, sigmoid
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.formats import webp
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.filling import Filling, blocks
from usdsplat.formats.inflate import check_count
from usdsplat.formats.options import READING, Reading
from usdsplat.formats.sog_files import META, SogFiles, open_sog
from usdsplat.formats.sog_meta import Meta, Section, parse_meta

SUFFIXES: tuple[str, ...] = (".sog", f"/{META}")

ERROR_BOUNDS = {
    "positions": "1/65535 of the range of sign(x) ln(1 + |x|)",
    "scales": "an interval of the file's table of 256 logarithms",
    "rotations": "1.5 degrees",
    "opacities": "1/255",
    "sh": "degree 0: an interval of the file's table of 256; above: the nearest of the palette",
}

_META_LIMIT = 1 << 20
_IMAGE_OVERHEAD = 1 << 16
_PIXEL_BYTES = 5  # a lossless image that cannot be packed takes 4 and a little
_SPARE_PIXELS = 1 << 16
_PALETTE_COLUMNS = 64
_PALETTE_ROWS = 1024
_ROTATION_TAG = 252  # alpha of a rotation: this and the index of the largest component

_IMAGES = {
    "means": ("means", "upper"),
    "scales": ("scales",),
    "quats": ("quats",),
    "sh0": ("sh0",),
    "shN": ("", "labels"),
}
"""Section -> what its images hold; all but the palette ("") have a pixel per splat."""

Codes = npt.NDArray[np.uint8]


def recognises(path: Path, head: bytes) -> bool:
    """Whether `path` is a zip file, `meta.json`, or a folder that holds one."""
    is_folder = path.is_dir() and (path / META).is_file()
    return is_folder or path.name.lower() == META or head.startswith(b"PK\x03\x04")


def read(path: Path, how: Reading = READING) -> Capture:
    """Read splats.

    Raises:
        FormatError: If a file is missing or damaged, an image has another size than the splats or
            the palette need, or `meta.json` has impossible values.
    """
    with open_sog(path) as files:
        meta = parse_meta(files.source, files.read(META, _META_LIMIT))
        check_count(files.source, meta.count, files.total_bytes)
        images = _read_images(files, meta)
        tables = _read_tables(files, meta)
        paths = files.paths([META, *(name for s in meta.sections.values() for name in s.files)])
        _check_labels(files.source, images, tables)
    filling = Filling(str(path), meta.count, tables.degree, how)
    for rows in blocks(meta.count):
        _decode(filling, rows, {name: codes[rows] for name, codes in images.items()}, tables)
        filling.settle(rows)
        how.progress.step(f"reading {path}", rows.stop, meta.count)
    cloud, notes = filling.cloud()
    return Capture(
        cloud=cloud,
        format=f"SOG {meta.version}",
        files=paths,
        frame="rdf",
        antialiased=meta.antialiased,
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *notes),
    )


@dataclass(frozen=True, slots=True)
class _Tables:
    """What codes stand for."""

    lower: F64
    upper: F64
    """Of sign(x) ln(1 + |x|) by axis, shape (3,)."""
    scales: F32
    """By code and axis, shape (256, 3)."""
    dc: F32
    """By code and channel, shape (256, 3)."""
    opacities: F32
    """By code, shape (256,)."""
    palette: F32
    """Harmonics above degree 0 by label, shape (labels, coefficients, 3)."""

    @property
    def degree(self) -> int:
        return SH_DEGREES[self.palette.shape[1] + 1]


def _read_images(files: SogFiles, meta: Meta) -> dict[str, Codes]:
    """Codes of every splat by section, shape (count, 4); the high bytes of means are "upper"."""
    images = {}
    for name, section in meta.sections.items():
        for kind, file in zip(_IMAGES[name], section.files, strict=True):
            if kind:
                images[kind] = _image(files, file, meta.count)
    return images


def _image(files: SogFiles, name: str, count: int) -> Codes:
    """The first `count` pixels of an image that has little more."""
    most = 2 * count + _SPARE_PIXELS
    data = files.read(name, _PIXEL_BYTES * most + _IMAGE_OVERHEAD)
    where = f"{files.source}: {name}"
    width, height = webp.image_size(where, data)
    if not count <= width * height <= most:
        raise FormatError(where, f"{width} x {height} pixels", f"room for {count} splats")
    return webp.decode(where, data)[:count]


def _read_tables(files: SogFiles, meta: Meta) -> _Tables:
    """Ranges and tables of `meta.json`, and the palette."""
    means, scales, dc = (meta.sections[name] for name in ("means", "scales", "sh0"))
    if meta.version == 1:
        size_table, dc_table = _lerps(scales, 3), _lerps(dc, 4)
        opacities = sigmoid(dc_table[:, 3])
    else:
        size_table, dc_table = _codebook(scales), _codebook(dc)
        opacities = np.arange(256) / 255
    with np.errstate(over="ignore"):  # settling refuses what is infinite and in use
        return _Tables(
            lower=means.numbers("mins", 3),
            upper=means.numbers("maxs", 3),
            scales=np.exp(size_table).astype(np.float32),
            dc=dc_table[:, :3].astype(np.float32),
            opacities=opacities.astype(np.float32),
            palette=_palette(files, meta),
        )


def _codebook(section: Section) -> F64:
    """Version 2: one table of 256 numbers for three channels, shape (256, 3)."""
    return np.repeat(section.numbers("codebook", 256)[:, None], 3, axis=1)


def _lerps(section: Section, channels: int) -> F64:
    """Version 1: a range for each channel, shape (256, channels)."""
    lower, upper = (section.numbers(key, channels) for key in ("mins", "maxs"))
    t = np.arange(256)[:, None] / 255
    return lower * (1 - t) + upper * t


def _palette(files: SogFiles, meta: Meta) -> F32:
    """Harmonics above degree 0 that labels stand for, shape (labels, coefficients, 3)."""
    section = meta.sections.get("shN")
    if section is None:
        return np.empty((0, 0, 3), np.float32)
    where = f"{files.source}: {section.files[0]}"
    largest = _PALETTE_COLUMNS * _PALETTE_ROWS * (coefficient_count(MAX_DEGREE) - 1)
    data = files.read(section.files[0], _PIXEL_BYTES * largest + _IMAGE_OVERHEAD)
    width, height = webp.image_size(where, data)
    widths = {_PALETTE_COLUMNS * (k - 1): k - 1 for k in SH_DEGREES if k > 1}
    coefficients = widths.get(width, 0)
    if meta.version == 2:
        bands = section.whole_number("bands", 1, MAX_DEGREE)
        coefficients = coefficients if SH_DEGREES[coefficients + 1] == bands else 0
    if not coefficients or height > _PALETTE_ROWS:
        expected = f"64 labels x 3, 8, 15 or 24 by at most {_PALETTE_ROWS}, as its bands say"
        raise FormatError(where, f"{width} x {height} pixels", expected)
    values = _lerps(section, 1) if meta.version == 1 else _codebook(section)
    with np.errstate(over="ignore"):
        table = values[:, 0].astype(np.float32)
    return table[webp.decode(where, data)[:, :3]].reshape(-1, coefficients, 3)


def _check_labels(source: str, images: dict[str, Codes], tables: _Tables) -> None:
    """Refuse splats whose harmonics the palette lacks."""
    if "labels" in images:
        beyond = np.flatnonzero(_labels(images["labels"]) >= len(tables.palette))
        if len(beyond):
            label = _labels(images["labels"][beyond[:1]])[0]
            found = f"palette entry {label} of splat {beyond[0]}"
            raise FormatError(source, found, f"one below {len(tables.palette)}")


def _labels(image: Codes) -> npt.NDArray[np.uint16]:
    """Palette entries, low byte in red and high byte in green."""
    return image[:, 0] + image[:, 1] * np.uint16(256)


def _decode(filling: Filling, rows: slice, codes: dict[str, Codes], tables: _Tables) -> None:
    """Decode some splats."""
    channel = np.arange(3)
    steps = codes["means"][:, :3] + codes["upper"][:, :3] * np.uint16(256)
    logarithms = tables.lower + (tables.upper - tables.lower) * (steps / 65535)
    with np.errstate(over="ignore"):
        filling.positions[rows] = np.copysign(np.expm1(np.abs(logarithms)), logarithms)
    filling.rotations[rows] = _rotations(codes["quats"])
    filling.scales[rows] = tables.scales[codes["scales"][:, :3], channel]
    filling.sh[rows, 0] = tables.dc[codes["sh0"][:, :3], channel]
    filling.opacities[rows] = tables.opacities[codes["sh0"][:, 3]]
    if "labels" in codes:
        filling.sh[rows, 1:] = tables.palette[_labels(codes["labels"])]


def _rotations(codes: Codes) -> F32:
    """Three components and, in alpha, which one is missing; anything else there is the identity."""
    tagged = codes[:, 3] >= _ROTATION_TAG
    largest = np.where(tagged, codes[:, 3] - _ROTATION_TAG, 0)
    turns = decode_smallest_three(largest, codes[:, :3], top=255)
    return np.where(tagged[:, None], turns, np.array([1, 0, 0, 0], np.float32))
