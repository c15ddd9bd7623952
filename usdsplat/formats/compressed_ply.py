"""PlayCanvas's compressed PLY: chunks of 256 splats, each coded within the bounds of its chunk.

16 bytes a splat, 61 with harmonics of degree 3.

Source: splat-transform and SuperSplat, which write it. Element `chunk` holds bounds, `vertex` four
words of 32 bits, `sh` a byte for each coefficient. Lossy: see `ERROR_BOUNDS`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.encoding import decode_smallest_three, dequantize
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import rgb_to_dc
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.filling import Filling, blocks
from usdsplat.formats.options import READING, Reading
from usdsplat.formats.ply_columns import harmonics
from usdsplat.formats.ply_header import read_header
from usdsplat.formats.ply_table import Block, Table, open_table

SUFFIXES: tuple[str, ...] = (".compressed.ply",)

ERROR_BOUNDS = {
    "positions": "1/2046 of the chunk's extent",
    "scales": "1/2046 of the chunk's range of logarithms",
    "rotations": "0.2 degrees",
    "opacities": "1/510",
    "sh": "degree 0: 1/510 of the chunk's range; above: 1/64 within +-4",
}

CHUNK = 256
"""Splats that share bounds."""

_WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_AXES = ("x", "y", "z")
_RGB = ("r", "g", "b")
_BLOCK_ROWS = 64 * CHUNK

_CODES = np.arange(256, dtype=np.float32)
_HARMONICS = (np.where(_CODES % 255 == 0, _CODES / 255, (_CODES + 0.5) / 256) - 0.5) * 8
"""Value of each byte of element sh: the outermost mean +-4, others the middle of their interval."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file that starts with `head` is a PLY file with packed splats."""
    header = head.partition(b"end_header")[0]
    return header.startswith(b"ply") and b"element chunk" in header and b"packed_" in header


def read(path: Path, how: Reading = READING) -> Capture:
    """Read packed splats.

    Raises:
        FormatError: If elements or properties are missing or do not fit each other, or a bound is
            not finite.
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
    bounds = _bounds(source, chunk, vertex.count)
    filling = Filling(source, vertex.count, degree, how)
    for rows, block in vertex.blocks(_BLOCK_ROWS):
        _unpack(filling, rows, block, bounds)
    for rows, block in sh.blocks() if sh and degree else ():
        codes = np.stack([block[name] for name in rest], axis=1)
        filling.sh[rows, 1:] = _HARMONICS[codes.astype(np.uint8)].reshape(len(block), -1, 3)
    for rows in blocks(vertex.count):
        filling.settle(rows)
        how.progress.step(f"reading {source}", rows.stop, vertex.count)
    cloud, notes = filling.cloud()
    return Capture(
        cloud=cloud,
        format="compressed PLY",
        files=(path,),
        frame="rdf",
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *notes, *vertex.remarks()),
    )


def _require(source: str, table: Table, names: tuple[str, ...], code: str, element: str) -> None:
    """Check that a table has the properties `names`, all of type `code`."""
    for name in names:
        if table.types.get(name) != code:
            found = f"no {np.dtype(code).name} property {name} in element {element}"
            raise FormatError(source, found, "one")


def _bounds(source: str, chunk: Table, count: int) -> dict[str, F32]:
    """Columns of element chunk, complete and finite; colours range over 0 to 1 unless it says."""
    expected = -(-count // CHUNK)
    if chunk.count != expected:
        raise FormatError(source, f"{chunk.count} chunks for {count} splats", str(expected))
    stored = chunk.whole()
    bounds = {}
    for side, default in (("min_", 0), ("max_", 1)):
        for name in (*_AXES, *("scale_" + axis for axis in _AXES), *_RGB):
            if side + name in chunk.types:
                with np.errstate(over="ignore", invalid="ignore"):  # refused below
                    bounds[side + name] = stored[side + name].astype(np.float32)
            elif name in _RGB and "min_r" not in chunk.types:
                bounds[side + name] = np.full(expected, default, np.float32)
            else:
                raise FormatError(source, f"no property {side}{name} in element chunk", "one")
    for name, values in bounds.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            where = f"{source}: property {name} of chunk {bad[0]}"
            raise FormatError(where, str(values[bad[0]]), "a finite number")
    return bounds


def _unpack(filling: Filling, rows: slice, block: Block, bounds: dict[str, F32]) -> None:
    """Decode the words of some splats."""
    chunk = np.arange(rows.start, rows.stop) // CHUNK
    place, turn, size, paint = (block[name].astype(np.uint32) for name in _WORDS)
    for axis, name in enumerate(_AXES):
        lower, upper = bounds["min_" + name][chunk], bounds["max_" + name][chunk]
        filling.positions[rows, axis] = _lerp(place, axis, lower, upper)
        lower, upper = bounds["min_scale_" + name][chunk], bounds["max_scale_" + name][chunk]
        with np.errstate(over="ignore"):  # settling names what is infinite
            filling.scales[rows, axis] = np.exp(_lerp(size, axis, lower, upper))
    codes = np.stack([turn >> 20 & 1023, turn >> 10 & 1023, turn & 1023], axis=1)
    filling.rotations[rows] = decode_smallest_three(turn >> 30, codes, top=1023)
    for channel, name in enumerate(_RGB):
        lower, upper = bounds["min_" + name][chunk], bounds["max_" + name][chunk]
        rgb = dequantize(paint >> (24 - 8 * channel) & 255, lower, upper, 255)
        filling.sh[rows, 0, channel] = rgb_to_dc(rgb)
    filling.opacities[rows] = dequantize(paint & 255, 0.0, 1.0, 255)


def _lerp(words: npt.NDArray[np.uint32], axis: int, lower: F32, upper: F32) -> F32:
    """Value of the 11, 10 or 11 bits of an axis between bounds."""
    shift, top = ((21, 2047), (11, 1023), (0, 2047))[axis]
    return dequantize(words >> shift & top, lower, upper, top)
