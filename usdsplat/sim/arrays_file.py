"""Store arrays in one file, uncompressed and aligned to 64 bytes, so that they can be mapped.

    8 bytes   "USDSPLA1"
    8 bytes   length of the header [byte], little-endian
    4 bytes   CRC-32 of the header
    header    JSON: `meta`, and for each array its name, dtype, shape, offset and CRC-32
    arrays    C order

Arrays that are the same object in memory are stored once, and are the same object again when they
are read.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import FormatError
from usdsplat.core.output import output_file

Array = npt.NDArray[Any]

MAGIC = b"USDSPLA1"
ALIGNMENT = 64
_PREFIX = struct.Struct("<8sQI")


def save_arrays(
    target: Path, arrays: Mapping[str, Array], meta: Mapping[str, Any], *, checked: bool = True
) -> None:
    """Write arrays to a file. An existing file is replaced as a whole or not at all.

    Args:
        target: Path of the file.
        arrays: Arrays by name, of any shape and any dtype but object.
        meta: Anything that JSON can hold.
        checked: Compute checksums of the arrays. A file without them can only be read with
            `checked=False`.

    Raises:
        OutputError: If the file cannot be written.
    """
    stored: dict[int, int] = {}
    unique: list[Array] = []
    entries: list[dict[str, Any]] = []
    for name, array in arrays.items():
        if id(array) not in stored:
            stored[id(array)] = len(unique)
            unique.append(np.asarray(array, order="C"))
        entries.append({"name": name, "block": stored[id(array)]})
    blocks: list[dict[str, Any]] = []
    offset = 0
    for array in unique:
        if array.dtype.hasobject:
            raise ValueError(f"{target}: found an array of objects, expected numbers")
        crc = _crc(array) if checked else None
        blocks.append(
            {"dtype": array.dtype.str, "shape": array.shape, "offset": offset, "crc": crc}
        )
        offset += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
    header = json.dumps({"meta": dict(meta), "arrays": entries, "blocks": blocks}).encode()
    with output_file(target) as output, output.open() as file:
        file.write(_PREFIX.pack(MAGIC, len(header), zlib.crc32(header)))
        file.write(header)
        start = _start(len(header))
        for block, array in zip(blocks, unique, strict=True):
            file.seek(start + block["offset"])
            file.write(_bytes(array))
        file.truncate(start + offset)


def load_arrays(
    source: Path, *, mapped: bool = False, checked: bool = True
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read a file that `save_arrays` wrote.

    Args:
        source: Path of the file.
        mapped: Return read-only views of the file; it is read when they are used.
        checked: Verify the checksums of the arrays. That of the header is always verified.

    Returns:
        The arrays by name, bit for bit, and `meta`.

    Raises:
        FormatError: If the file is damaged or of another kind.
    """
    try:
        with source.open("rb") as file:
            found, length, crc = _PREFIX.unpack(file.read(_PREFIX.size))
            size = source.stat().st_size
            header = file.read(length) if found == MAGIC and length < size else b""
        if not header or zlib.crc32(header) != crc:
            raise ValueError("a header")
        content = json.loads(header)
        whole = np.memmap(source, np.uint8, "r").view(np.ndarray) if mapped else None
        blocks = [_block(source, block, _start(length), size, whole) for block in content["blocks"]]
    except (ValueError, KeyError, struct.error) as error:
        raise _damaged(source) from error
    if checked and any(
        _crc(block) != entry["crc"] for block, entry in zip(blocks, content["blocks"], strict=True)
    ):
        raise _damaged(source)
    return {entry["name"]: blocks[entry["block"]] for entry in content["arrays"]}, content["meta"]


def _block(
    source: Path, entry: Mapping[str, Any], start: int, size: int, whole: Array | None
) -> Array:
    """Read one array of the file, or return a view of the mapped bytes of the whole file."""
    dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
    first, count = start + entry["offset"], math.prod(shape)
    if first + count * dtype.itemsize > size:
        raise ValueError("the end of the file")
    if not count:
        return np.empty(shape, dtype)
    if whole is not None:
        return whole[first : first + count * dtype.itemsize].view(dtype).reshape(shape)
    return np.fromfile(source, dtype, count, offset=first).reshape(shape)


def _start(header: int) -> int:
    """Return the offset of the first array."""
    return -(-(_PREFIX.size + header) // ALIGNMENT) * ALIGNMENT


def _bytes(array: Array) -> memoryview:
    return array.reshape(-1).view(np.uint8).data


def _crc(array: Array) -> int:
    return zlib.crc32(_bytes(array))


def _damaged(source: Path) -> FormatError:
    return FormatError(str(source), "a damaged file", "a complete one")
