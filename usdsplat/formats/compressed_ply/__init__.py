"""PlayCanvas's compressed PLY: chunks of 256 splats, quantised within the bounds of the chunk.

16 bytes a splat, 61 with harmonics of degree 3. Splats are written in Morton order, so that chunks
are small. Lossy: see `ERROR_BOUNDS`. Ids and velocities are not stored.

Source: splat-transform and SuperSplat, which write degrees up to 3. Element `chunk` holds bounds,
`vertex` four 32-bit words, `sh` one byte per coefficient: see `codec`.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import repeat
from pathlib import Path

import numpy as np

from usdsplat.core import morton
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.core.output import output_file
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder, in_parallel
from usdsplat.formats.compressed_ply.codec import (
    CHUNK,
    U8,
    U32,
    Rows,
    decode_harmonics,
    decode_words,
    encode,
    ranges_of,
)
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.formats.ply.columns import harmonics
from usdsplat.formats.ply.header import read_header
from usdsplat.formats.ply.table import Block, Table, open_table

SUFFIXES: tuple[str, ...] = (".compressed.ply",)
FRAME = "rdf"
MAX_DEGREE = 3
"""Other readers support no higher degree, although the format could hold it."""

ERROR_BOUNDS = {
    "positions": "1/2046 of the chunk's extent",
    "scales": "1/2046 of the chunk's range of logarithms",
    "rotations": "0.27 degrees",
    "opacities": "1/510",
    "sh": "degree 0: 1/510 of the chunk's range; above: 1/64 within +-3.97, 1/32 up to +-4",
}

Names = tuple[str, ...]

_WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_BOUNDS = tuple(
    f"{side}_{name}"
    for attribute in (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b"))
    for side in ("min", "max")
    for name in attribute
)
"""Properties of element chunk, in the order of the codec's bounds."""

_FILE_ROWS = 1024 * CHUNK
"""Number of splats read or written at a time."""
_WORK_ROWS = 32 * CHUNK
"""Number of splats that a thread decodes or encodes at a time: they fit its cache."""


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file that starts with `head` is a PLY file with packed splats."""
    header = head.partition(b"end_header")[0]
    return header.startswith(b"ply") and b"element chunk" in header and b"packed_" in header


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read packed splats.

    Raises:
        FormatError: If elements or properties are missing or inconsistent, or a bound is not
            finite.
    """
    header = read_header(path)
    source = str(path)
    vertex, chunk = (open_table(path, header, name) for name in ("vertex", "chunk"))
    _require(source, vertex, _WORDS, "u4", "vertex")
    sh = open_table(path, header, "sh") if header.element("sh") else None
    degree, rest = harmonics(source, sh.types) if sh else (0, ())
    if sh:
        _require(source, sh, rest, "u1", "sh")
        if sh.count != vertex.count:
            raise FormatError(source, f"{sh.count} rows of element sh", str(vertex.count))
    ranges = ranges_of(_bounds(source, chunk, vertex.count))
    builder = CloudBuilder(source, vertex.count, degree, how)
    coded = sh.blocks(_FILE_ROWS) if sh and degree else repeat(None)
    for (rows, block), piece in zip(vertex.blocks(_FILE_ROWS), coded, strict=False):
        here = ranges[..., rows.start // CHUNK :]
        _fill(builder, rows, block, here, _bytes(piece[1], len(rest)) if piece else None)
        how.progress.step(f"reading {source}", rows.stop, vertex.count)
    cloud, notes = builder.cloud()
    return Capture(
        cloud=cloud,
        format="compressed PLY",
        files=(path,),
        frame="rdf",
        frame_source="assumed",
        antialiased=header.is_antialiased,
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *notes, *vertex.remarks()),
    )


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write packed splats in Morton order.

    Args:
        cloud: Splats; logarithms of scales are clamped to +-20 and harmonics above degree 0 to +-4.
        path: Target, replaced when the file is complete.
        how: Whether the header notes that the splats are meant for the antialiased projection.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        OutputError: If the target cannot be written.
    """
    order = morton.order(cloud.positions)
    rest = 3 * (cloud.sh.shape[1] - 1)
    header = _header(len(cloud), rest, how)
    bounds = np.empty((-(-len(cloud) // CHUNK), 3, 2, 3), "<f4")
    first_word = len(header) + bounds.nbytes
    first_byte = first_word + 4 * len(_WORDS) * len(cloud)
    with output_file(path) as output, output.open() as file:
        for start in range(0, len(cloud), _FILE_ROWS):
            rows = order[start : start + _FILE_ROWS]
            words = np.empty((len(rows), len(_WORDS)), "<u4")
            codes = np.empty((len(rows), rest), np.uint8)
            _encode(cloud, rows, words, bounds[start // CHUNK :], codes)
            file.seek(first_word + 4 * len(_WORDS) * start)
            file.write(words.data)
            file.seek(first_byte + rest * start)
            file.write(codes.data)
            how.progress.step(f"writing {path}", start + len(rows), len(cloud))
        file.seek(0)
        file.write(header)
        file.write(bounds.data)
    return ERROR_BOUNDS


def _require(source: str, table: Table, names: tuple[str, ...], code: str, element: str) -> None:
    """Raise an error unless a table has the properties `names`, all of type `code`."""
    for name in names:
        if table.types.get(name) != code:
            found = f"no {np.dtype(code).name} property {name} in element {element}"
            raise FormatError(source, found, "one")


def _bounds(source: str, chunk: Table, count: int) -> F32:
    """Return the bounds of all chunks in the codec's form; colours default to 0 to 1.

    Raises:
        FormatError: If the number of chunks is wrong, or a bound is missing or not finite.
    """
    expected = -(-count // CHUNK)
    if chunk.count != expected:
        raise FormatError(source, f"{chunk.count} chunks for {count} splats", str(expected))
    stored = chunk.whole()
    bounds = np.empty((expected, len(_BOUNDS)), np.float32)
    for column, name in enumerate(_BOUNDS):
        if name in chunk.types:
            with np.errstate(over="ignore", invalid="ignore"):  # rejected below
                bounds[:, column] = stored[name]
        elif name[-1] in "rgb" and "min_r" not in chunk.types:
            bounds[:, column] = name.startswith("max")
        else:
            raise FormatError(source, f"no property {name} in element chunk", "one")
    bad = np.argwhere(~np.isfinite(bounds.T))
    if len(bad):
        column, row = bad[0]
        where = f"{source}: property {_BOUNDS[column]} of chunk {row}"
        raise FormatError(where, str(bounds[row, column]), "a finite number")
    return bounds.reshape(-1, 3, 2, 3)


def _fill(builder: CloudBuilder, rows: slice, block: Block, ranges: F32, codes: U8 | None) -> None:
    """Decode the splats of consecutive chunks on all processors.

    Args:
        builder: Filled at `rows`.
        rows: Rows of the splats.
        block: Rows of element vertex of these splats.
        ranges: Ranges of the chunks, from the first of these splats on.
        codes: Codes of their harmonics, shape (n, 3, k); None without harmonics.
    """

    def work(part: slice) -> None:
        here = slice(rows.start + part.start, rows.start + part.stop)
        if codes is not None:
            decode_harmonics(builder.sh[here], codes[part])
        words = np.stack([block[name][part] for name in _WORDS])
        chunks = ranges[..., part.start // CHUNK : -(-part.stop // CHUNK)]
        decode_words(builder, here, words.astype(np.uint32, copy=False).view(np.int32), chunks)

    in_parallel(len(block), work, rows=_WORK_ROWS)


def _bytes(block: Block, count: int) -> U8:
    """Return the `count` harmonics codes of each row, channel first, shape (n, 3, count / 3)."""
    wanted = [(f"f_rest_{i}", "|u1") for i in range(count)]
    if block.dtype.descr != wanted:  # text, another order, or further properties
        block = block[[name for name, _ in wanted]].astype(wanted)
    return block.view(np.uint8).reshape(len(block), 3, -1)


def _header(count: int, rest: int, how: WriteOptions) -> bytes:
    """Return the header of a file of `count` splats with `rest` coefficients above degree 0."""
    lines = ["ply", "format binary_little_endian 1.0", "comment Generated by usdsplat"]
    if how.antialiased:
        lines.append("comment SplatRenderMode: mip")
    lines += [f"element chunk {-(-count // CHUNK)}", *(f"property float {n}" for n in _BOUNDS)]
    lines += [f"element vertex {count}", *(f"property uint {name}" for name in _WORDS)]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return "\n".join([*lines, "end_header\n"]).encode()


def _encode(cloud: SplatCloud, order: Rows, words: U32, bounds: F32, codes: U8) -> None:
    """Encode the splats `order`, which form whole chunks, on all processors.

    Args:
        cloud: All splats.
        order: Indices of the splats to encode, shape (n,).
        words: Filled with the rows of element vertex, shape (n, 4).
        bounds: Filled with the bounds of the chunks, from the first one on.
        codes: Filled with the rows of element sh, shape (n, k).
    """

    def work(part: slice) -> None:
        chunks = slice(part.start // CHUNK, -(-part.stop // CHUNK))
        words[part], bounds[chunks], codes[part] = encode(cloud, order[part])

    in_parallel(len(order), work, rows=_WORK_ROWS)
