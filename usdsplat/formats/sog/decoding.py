"""Pixels of a SOG's images to splats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, SH_DEGREES
from usdsplat.core.encoding import SMALL_LIMIT, dequantize, sigmoid
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.formats import webp
from usdsplat.formats.cloud_builder import CloudBuilder, blocks, in_parallel, threads
from usdsplat.formats.inflate import check_count
from usdsplat.formats.sog.files import SogFiles
from usdsplat.formats.sog.meta import (
    META,
    META_LIMIT,
    PALETTE_COLUMNS,
    ROTATION_TAG,
    Meta,
    Section,
    parse_meta,
)

_IMAGE_OVERHEAD = 1 << 16
_PIXEL_BYTES = 5  # a lossless image that cannot be packed takes 4 and a little
_SPARE_PIXELS = 1 << 16
_PALETTE_ROWS = 1024
_BLOCK = 1 << 16  # splats decoded at a time: with fewer, threads wait for each other

_IMAGES = {
    "means": ("means", "upper"),
    "scales": ("scales",),
    "quats": ("quats",),
    "sh0": ("sh0",),
    "shN": ("palette", "labels"),
}
"""Section -> what its images hold; all but the palette have a pixel per splat."""

_SMALL = dequantize(np.arange(256), -SMALL_LIMIT, SMALL_LIMIT, 255)
"""Component of a rotation by code."""
_PLACES = np.array([[3, 0, 1, 2], [0, 3, 1, 2], [0, 1, 3, 2], [0, 1, 2, 3]])
"""Where w, x, y and z stand, by the largest of them, among the three others and it."""

Codes = npt.NDArray[np.uint8]


Range = tuple[int, int]
"""Splats from the first number up to the second."""


@dataclass(frozen=True, slots=True)
class Sog:
    """A SOG whose word on itself is read, and none of its splats."""

    files: SogFiles
    meta: Meta
    degree: int
    """Of its harmonics."""


@dataclass(frozen=True, slots=True)
class _Tables:
    """What codes stand for."""

    positions: F32
    """By code and axis, shape (65536, 3)."""
    scales: F32
    """By code and axis, shape (256, 3)."""
    dc: F32
    """By code and channel, shape (256, 3)."""
    opacities: F32
    """By code, shape (256,)."""
    palette: F32
    """Harmonics by label, those of degree 0 empty, shape (labels, coefficients, 3)."""

    def are_finite(self) -> bool:
        """Whether they hold no infinity, in use or not."""
        held = (self.positions, self.scales, self.dc, self.opacities, self.palette)
        return all(bool(np.isfinite(table).all()) for table in held)


def survey(files: SogFiles) -> Sog:
    """Read `meta.json`, and of the palette what tells its degree.

    Raises:
        FormatError: If it has impossible values, or promises more splats than the files can hold.
    """
    meta = parse_meta(files.source, files.read(META, META_LIMIT))
    check_count(files.source, meta.count, files.total_bytes)
    degree = _packed_palette(files, meta)[2] if "shN" in meta.sections else 0
    return Sog(files, meta, degree)


def decode(
    sog: Sog, ranges: Sequence[Range], builder: CloudBuilder, row: int, told: Callable[[int], None]
) -> None:
    """Decode splats of a SOG into rows of a cloud, and settle these.

    Args:
        sog: What `survey` found.
        ranges: The splats, one range or more.
        builder: Arrays of a degree that is no less; what is above this one's becomes 0.
        row: The row that the first splat fills.
        told: Called with the number of the row that is next.

    Raises:
        FormatError: If an image is missing or damaged or has another size than the splats need, a
            table is not as long as it should be, or a number is not finite.
    """
    images = _read_images(sog)
    tables = _read_tables(sog, images.pop("palette", None))
    _check_labels(sog.files.source, images, tables)
    if len(ranges) == 1:
        chosen: slice | npt.NDArray[np.intp] = slice(*ranges[0])
    else:
        chosen = np.concatenate([np.arange(*each) for each in ranges])
    images = {name: codes[chosen] for name, codes in images.items()}
    is_settled = tables.are_finite()  # nothing else can come of them, and rotations are units

    def work(rows: slice) -> None:
        filled = slice(row + rows.start, row + rows.stop)
        _decode(builder, filled, {name: codes[rows] for name, codes in images.items()}, tables)
        if not is_settled:
            builder.settle(filled)

    count = len(images["means"])
    in_parallel(count, work, rows=_BLOCK)
    told(row + count)


def _read_images(sog: Sog) -> dict[str, Codes]:
    """Codes of every splat by section, shape (count, 4); the high bytes of means are "upper".

    Those of the "palette" have a row for each of its pixels.
    """
    found = {}
    for name, section in sog.meta.sections.items():
        for kind, file in zip(_IMAGES[name], section.files, strict=True):
            if kind == "palette":
                found[kind] = _packed_palette(sog.files, sog.meta)[:2]
            else:
                found[kind] = _image_data(sog.files, file, sog.meta.count)
    with threads() as workers:
        images = workers.map(lambda image: webp.decode(*image), found.values())
        unpacked = dict(zip(found, images, strict=True))
    return {k: v if k == "palette" else v[: sog.meta.count] for k, v in unpacked.items()}


def _image_data(files: SogFiles, name: str, count: int) -> tuple[str, bytes]:
    """An image of `count` pixels or little more, still packed, after the words that name it."""
    most = 2 * count + _SPARE_PIXELS
    data = files.read(name, _PIXEL_BYTES * most + _IMAGE_OVERHEAD)
    where = f"{files.source}: {name}"
    width, height = webp.image_size(where, data)
    if not count <= width * height <= most:
        raise FormatError(where, f"{width} x {height} pixels", f"room for {count} splats")
    return where, data


def _read_tables(sog: Sog, palette: Codes | None) -> _Tables:
    """Ranges and tables of `meta.json`, and what the codes of the palette stand for."""
    sections = sog.meta.sections
    means, scales, dc = (sections[name] for name in ("means", "scales", "sh0"))
    if sog.meta.version == 1:
        size_table, dc_table = _lerps(scales, 3), _lerps(dc, 4)
        opacities = sigmoid(dc_table[:, 3])
    else:
        size_table, dc_table = _codebook(scales), _codebook(dc)
        opacities = np.arange(256) / 255
    lower, upper = means.numbers("mins", 3), means.numbers("maxs", 3)
    logarithms = lower + (upper - lower) * (np.arange(1 << 16)[:, None] / 65535)
    with np.errstate(over="ignore"):  # settling refuses what is infinite and in use
        return _Tables(
            positions=np.copysign(np.expm1(np.abs(logarithms)), logarithms).astype(np.float32),
            scales=np.exp(size_table).astype(np.float32),
            dc=dc_table[:, :3].astype(np.float32),
            opacities=opacities.astype(np.float32),
            palette=_palette(sog, palette),
        )


def _codebook(section: Section) -> F64:
    """Version 2: one table of 256 numbers for three channels, shape (256, 3)."""
    return np.repeat(section.numbers("codebook", 256)[:, None], 3, axis=1)


def _lerps(section: Section, channels: int) -> F64:
    """Version 1: a range for each channel, shape (256, channels)."""
    lower, upper = (section.numbers(key, channels) for key in ("mins", "maxs"))
    t = np.arange(256)[:, None] / 255
    return lower * (1 - t) + upper * t


def _packed_palette(files: SogFiles, meta: Meta) -> tuple[str, bytes, int]:
    """The image of the palette, still packed, after the words that name it; and the degree of its
    harmonics, by its width, which version 2 confirms."""
    section = meta.sections["shN"]
    where = f"{files.source}: {section.files[0]}"
    largest = PALETTE_COLUMNS * _PALETTE_ROWS * (coefficient_count(MAX_DEGREE) - 1)
    data = files.read(section.files[0], _PIXEL_BYTES * largest + _IMAGE_OVERHEAD)
    width, height = webp.image_size(where, data)
    widths = {PALETTE_COLUMNS * (k - 1): degree for k, degree in SH_DEGREES.items() if degree}
    degree = widths.get(width, 0)
    if meta.version == 2 and degree != section.whole_number("bands", 1, MAX_DEGREE):
        degree = 0
    if not degree or height > _PALETTE_ROWS:
        expected = f"64 labels x 3, 8, 15 or 24 by at most {_PALETTE_ROWS}, as its bands say"
        raise FormatError(where, f"{width} x {height} pixels", expected)
    return where, data, degree


def _palette(sog: Sog, codes: Codes | None) -> F32:
    """Harmonics that labels stand for, shape (labels, coefficients, 3)."""
    if codes is None:
        return np.empty((0, 1, 3), np.float32)
    section = sog.meta.sections["shN"]
    values = _lerps(section, 1) if sog.meta.version == 1 else _codebook(section)
    with np.errstate(over="ignore"):
        table = values[:, 0].astype(np.float32)
    rest = coefficient_count(sog.degree) - 1
    palette = np.zeros((len(codes) // rest, rest + 1, 3), np.float32)
    for rows in blocks(len(palette)):
        texels = codes[rows.start * rest : rows.stop * rest, :3]
        palette[rows, 1:] = table.take(texels).reshape(-1, rest, 3)
    return palette


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


def _decode(builder: CloudBuilder, rows: slice, codes: dict[str, Codes], tables: _Tables) -> None:
    """Decode some splats."""
    steps = codes["means"][:, :3] + codes["upper"][:, :3] * np.uint16(256)
    _look_up(tables.positions, steps, builder.positions[rows])
    _look_up(tables.scales, codes["scales"][:, :3], builder.scales[rows])
    np.take(tables.opacities, codes["sh0"][:, 3], out=builder.opacities[rows], mode="clip")
    builder.rotations[rows] = _rotations(codes["quats"])
    sh = builder.sh[rows]
    kept = tables.palette.shape[1]
    if "labels" not in codes:
        sh[:, 1:] = 0
    elif kept == sh.shape[1]:
        np.take(tables.palette, _labels(codes["labels"]), axis=0, out=sh, mode="clip")
    else:
        sh[:, :kept] = tables.palette[_labels(codes["labels"])]
        sh[:, kept:] = 0
    _look_up(tables.dc, codes["sh0"][:, :3], sh[:, 0])


def _look_up(table: F32, codes: npt.NDArray[np.unsignedinteger], out: F32) -> None:
    """Write into `out`, by row, the entries of each channel, of which `table` has a column."""
    for channel in range(3):
        out[:, channel] = table[:, channel].take(codes[:, channel])


def _rotations(codes: Codes) -> F32:
    """Unit quaternions of three components and, in alpha, which one is missing; anything else there
    is the identity."""
    tagged = codes[:, 3] >= ROTATION_TAG
    largest = codes[:, 3] - np.uint8(ROTATION_TAG)
    parts = _SMALL.take(codes)
    if not tagged.all():
        largest[~tagged] = 0
        parts[~tagged] = 0
    small = parts[:, :3]
    squared = np.einsum("ni,ni->n", small, small)
    parts[:, 3] = np.sqrt(np.maximum(1 - squared, 0))
    if squared.max(initial=0) > 1:  # no encoder writes that
        small /= np.sqrt(np.maximum(squared, 1))[:, None]
    flat = _PLACES.take(largest, axis=0) + np.arange(0, parts.size, 4)[:, None]
    return parts.reshape(-1).take(flat)
