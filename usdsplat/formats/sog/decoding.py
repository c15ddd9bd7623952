"""Decode the pixels of a SOG's images into splats."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
_PIXEL_BYTES = 5  # incompressible lossless images take slightly more than 4
_SPARE_PIXELS = 1 << 16
_PALETTE_ROWS = 1024
# Splats decoded at a time: with fewer, threads wait for each other.
_BLOCK = 1 << 16
_IMAGES = {
    "means": ("means", "upper"),
    "scales": ("scales",),
    "quats": ("quats",),
    "sh0": ("sh0",),
    "shN": ("palette", "labels"),
}
"""Section -> contents of its images; all but the palette have a pixel per splat."""

_SMALL = dequantize(np.arange(256), -SMALL_LIMIT, SMALL_LIMIT, 255)
"""Quaternion component by code."""
_PLACES = np.array([[3, 0, 1, 2], [0, 3, 1, 2], [0, 1, 3, 2], [0, 1, 2, 3]])
"""Positions of w, x, y and z among (three stored components, the largest), by the largest."""

Codes = npt.NDArray[np.uint8]


Range = tuple[int, int]
"""Range of splats: index of the first, and index after the last."""


@dataclass(frozen=True, slots=True)
class Sog:
    """A SOG file with parsed metadata; splats are not decoded yet."""

    files: SogFiles
    meta: Meta
    degree: int
    """Degree of its harmonics."""


@dataclass(frozen=True, slots=True)
class _Tables:
    """Values by code."""

    positions: F32
    """Positions by code and axis, shape (65536, 3)."""
    scales: F32
    """Scales by code and axis, shape (256, 3)."""
    dc: F32
    """DC coefficients by code and channel, shape (256, 3)."""
    opacities: F32
    """Opacities by code, shape (256,)."""
    palette: F32
    """Harmonics by label, shape (labels, coefficients, 3); degree 0 is unused."""

    def are_finite(self) -> bool:
        """Return whether all entries, used or not, are finite."""
        held = (self.positions, self.scales, self.dc, self.opacities, self.palette)
        return all(bool(np.isfinite(table).all()) for table in held)


def survey(files: SogFiles) -> Sog:
    """Read `meta.json`, and the degree of the harmonics from the size of the palette.

    Raises:
        FormatError: If it has invalid values, or claims more splats than the files can hold.
    """
    meta = parse_meta(files.source, files.read(META, META_LIMIT))
    check_count(files.source, meta.count, files.total_bytes)
    degree = _packed_palette(files, meta)[2] if "shN" in meta.sections else 0
    return Sog(files, meta, degree)


@dataclass(frozen=True, slots=True, eq=False)
class SogCodes:
    """The codes of all splats of a SOG in memory, some 24 bytes each."""

    degree: int
    """Degree of the harmonics."""
    _images: dict[str, Codes]
    _tables: _Tables
    _is_settled: bool
    """Whether all values of the tables are finite."""

    def __len__(self) -> int:
        """Return the number of splats."""
        return len(self._images["means"])

    @property
    def size(self) -> int:
        """Memory of the codes and tables [byte]."""
        codes = sum(each.nbytes for each in self._images.values())
        return codes + self._tables.positions.nbytes + self._tables.palette.nbytes

    def decode(self, ranges: Sequence[Range], builder: CloudBuilder, row: int) -> int:
        """Decode splats into rows of a cloud, and settle them.

        Args:
            ranges: The splats, one range or more.
            builder: Cloud under construction, of at least the same degree; higher coefficients
                become 0.
            row: The row that the first splat fills.

        Returns:
            The next row.

        Raises:
            FormatError: If a number is not finite.
        """
        if len(ranges) == 1:
            chosen: slice | npt.NDArray[np.intp] = slice(*ranges[0])
        else:
            chosen = np.concatenate([np.arange(*each) for each in ranges])
        images = {name: codes[chosen] for name, codes in self._images.items()}

        def work(rows: slice) -> None:
            filled = slice(row + rows.start, row + rows.stop)
            some = {name: codes[rows] for name, codes in images.items()}
            _decode(builder, filled, some, self._tables)
            if not self._is_settled:
                builder.settle(filled)

        count = len(images["means"])
        in_parallel(count, work, rows=_BLOCK)
        return row + count


def read_codes(sog: Sog) -> SogCodes:
    """Read the codes of all splats of a surveyed SOG.

    Raises:
        FormatError: If an image is missing, damaged or of the wrong size, or a table has the wrong
            length.
    """
    images = _read_images(sog)
    tables = _read_tables(sog, images.pop("palette", None))
    _check_labels(sog.files.source, images, tables)
    # Then all values are finite; rotations are unit.
    return SogCodes(sog.degree, images, tables, tables.are_finite())


def read_sizes(sog: Sog) -> tuple[F32, F32]:
    """Read the scales of all splats, shape (n, 3), and their opacities, shape (n,), and no more.

    Raises:
        FormatError: As for `read_codes`.
    """
    images = _read_images(sog, ("scales", "sh0"))
    sizes, _, opacities = _value_tables(sog.meta)
    scales = np.empty((sog.meta.count, 3), np.float32)
    _look_up(sizes, images["scales"], scales)
    return scales, opacities.take(images["sh0"][:, 3])


def limits(meta: Meta) -> tuple[F64, F64, float]:
    """Return the box that contains the centres of all splats, two corners, and their largest scale.

    Raises:
        FormatError: If the values of `meta.json` are invalid.
    """
    means = meta.sections["means"]
    ends = np.stack([means.numbers(key, 3) for key in ("mins", "maxs")])
    with np.errstate(over="ignore"):
        corners = np.copysign(np.expm1(np.abs(ends)), ends)
    return corners.min(axis=0), corners.max(axis=0), float(_value_tables(meta)[0].max())


def _read_images(sog: Sog, wanted: Collection[str] = _IMAGES.keys()) -> dict[str, Codes]:
    """Read the codes of every splat by section, shape (count, 4); high bytes of means are "upper".

    Codes of the "palette" have a row for each of its pixels. Only the `wanted` sections are read.
    """
    found = {}
    for name, section in sog.meta.sections.items():
        if name not in wanted:
            continue
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
    """Return (name for errors, WebP data) of an image of at least `count` pixels."""
    most = 2 * count + _SPARE_PIXELS
    data = files.read(name, _PIXEL_BYTES * most + _IMAGE_OVERHEAD)
    where = f"{files.source}: {name}"
    width, height = webp.image_size(where, data)
    if not count <= width * height <= most:
        raise FormatError(where, f"{width} x {height} pixels", f"room for {count} splats")
    return where, data


def _read_tables(sog: Sog, palette: Codes | None) -> _Tables:
    """Return the values of all codes, from the ranges and tables of `meta.json`."""
    means = sog.meta.sections["means"]
    sizes, dc, opacities = _value_tables(sog.meta)
    lower, upper = means.numbers("mins", 3), means.numbers("maxs", 3)
    logarithms = lower + (upper - lower) * (np.arange(1 << 16)[:, None] / 65535)
    with np.errstate(over="ignore"):  # `settle` reports infinities that are used
        return _Tables(
            positions=np.copysign(np.expm1(np.abs(logarithms)), logarithms).astype(np.float32),
            scales=sizes,
            dc=dc,
            opacities=opacities,
            palette=_palette(sog, palette),
        )


def _value_tables(meta: Meta) -> tuple[F32, F32, F32]:
    """Return scales and DC coefficients, shape (256, 3), and opacities, shape (256,), by code."""
    scales, dc = meta.sections["scales"], meta.sections["sh0"]
    if meta.version == 1:
        size_table, dc_table = _lerps(scales, 3), _lerps(dc, 4)
        opacities = sigmoid(dc_table[:, 3])
    else:
        size_table, dc_table = _codebook(scales), _codebook(dc)
        opacities = np.arange(256) / 255
    with np.errstate(over="ignore"):  # `settle` reports infinities that are used
        sizes = np.exp(size_table).astype(np.float32)
        return sizes, dc_table[:, :3].astype(np.float32), opacities.astype(np.float32)


def _codebook(section: Section) -> F64:
    """Return the values of version 2: one table of 256 for three channels, shape (256, 3)."""
    return np.repeat(section.numbers("codebook", 256)[:, None], 3, axis=1)


def _lerps(section: Section, channels: int) -> F64:
    """Return the values of version 1: a range for each channel, shape (256, channels)."""
    lower, upper = (section.numbers(key, channels) for key in ("mins", "maxs"))
    t = np.arange(256)[:, None] / 255
    return lower * (1 - t) + upper * t


def _packed_palette(files: SogFiles, meta: Meta) -> tuple[str, bytes, int]:
    """Return (name for errors, WebP data, degree of the harmonics) of the palette.

    The degree follows from its width; in version 2 it must match "bands"."""
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
        expected = (
            f"a width of 64 x 3, 8, 15 or 24 to match its bands, and a height of {_PALETTE_ROWS} "
            "or less"
        )
        raise FormatError(where, f"{width} x {height} pixels", expected)
    return where, data, degree


def _palette(sog: Sog, codes: Codes | None) -> F32:
    """Return the harmonics by label, shape (labels, coefficients, 3)."""
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
    """Raise an error if a splat refers to a missing palette entry."""
    if "labels" in images:
        beyond = np.flatnonzero(_labels(images["labels"]) >= len(tables.palette))
        if len(beyond):
            label = _labels(images["labels"][beyond[:1]])[0]
            found = f"palette entry {label} of splat {beyond[0]}"
            raise FormatError(source, found, f"one below {len(tables.palette)}")


def _labels(image: Codes) -> npt.NDArray[np.uint16]:
    """Return palette indices: low byte in red, high byte in green."""
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
    """Look up `codes` of three channels in the columns of `table` and write them to `out`."""
    for channel in range(3):
        out[:, channel] = table[:, channel].take(codes[:, channel])


def _rotations(codes: Codes) -> F32:
    """Return unit quaternions from three components and the index of the largest in alpha.

    Any other alpha value gives the identity."""
    tagged = codes[:, 3] >= ROTATION_TAG
    largest = codes[:, 3] - np.uint8(ROTATION_TAG)
    parts = _SMALL.take(codes)
    if not tagged.all():
        largest[~tagged] = 0
        parts[~tagged] = 0
    small = parts[:, :3]
    squared = np.einsum("ni,ni->n", small, small)
    parts[:, 3] = np.sqrt(np.maximum(1 - squared, 0))
    if squared.max(initial=0) > 1:  # not written by any encoder
        small /= np.sqrt(np.maximum(squared, 1))[:, None]
    flat = _PLACES.take(largest, axis=0) + np.arange(0, parts.size, 4)[:, None]
    return parts.reshape(-1).take(flat)
