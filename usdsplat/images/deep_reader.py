"""Read deep EXR files as arrays, some rows at a time.

This module reads scanline and tiled parts with any compression of deep files (none, rle, zips)
itself, because OpenImageIO passes samples to Python one by one: for 1920x1080 with 15 samples a
pixel that takes 22 s, and this module 2 s (none) or 3 s (zips; `benchmarks/deep.py`). Memory is not
allocated by a header alone: data is decompressed to the size that its counts imply, and counts to
the size of their row or tile.

Source: OpenEXR's "File Layout".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError
from usdsplat.images import thread_count
from usdsplat.images.exr_bytes import (
    NONE,
    RLE,
    ZIPS,
    Box,
    read_box,
    read_channels,
    read_exactly,
    read_headers,
    unpacked,
    values,
)

I64 = npt.NDArray[np.int64]

LARGEST = {NONE: 1, RLE: 64, ZIPS: 1032}
"""Largest ratio of decompressed to compressed bytes, by compression: a run of 128 bytes takes two,
and 1032 is the limit of deflate."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DeepImage:
    """A deep picture; samples are ordered by row, pixel, then as in the file."""

    window: Box
    """Data window (x0, y0, x1, y1) [pixel], end exclusive."""
    display_window: Box
    """Display window (x0, y0, x1, y1) [pixel], end exclusive."""
    offsets: I64
    """Pixel i, row-major in the window, has samples offsets[i] to offsets[i + 1]; shape
    (h*w + 1,)."""
    depth: F32
    """Planar camera depth, shape (n,)."""
    depth_back: F32
    """Far end of a sample, shape (n,); equals `depth` without a channel ZBack."""
    color: F32
    """Premultiplied RGBA, shape (n, 4); 0 for channels that the file lacks."""


def read_deep(path: Path | str) -> DeepImage:
    """Read the first deep part of a file.

    Raises:
        FormatError: If it is not a deep EXR, has no Z or A, or is damaged.
        OSError: If it cannot be read.
    """
    with DeepFile(path) as file:
        _, y0, _, y1 = file.window
        offsets, arrays = file.rows(y0, y1, ("Z", "ZBack", "R", "G", "B", "A"))
        nothing = np.zeros(offsets[-1], np.float32)
        return DeepImage(
            window=file.window,
            display_window=file.display_window,
            offsets=offsets,
            depth=arrays["Z"],
            depth_back=arrays.get("ZBack", arrays["Z"]),
            color=np.stack([arrays.get(name, nothing) for name in "RGBA"], axis=1),
        )


class DeepFile:
    """The first deep part of an open EXR; a context manager.

    Raises:
        FormatError: If it is not a deep EXR, or has no Z or A.
        OSError: If it cannot be read.
    """

    def __init__(self, path: Path | str) -> None:
        self._where = str(path)
        self._file: BinaryIO = Path(path).open("rb")  # noqa: SIM115 - closed by `close`
        try:
            self._read_header()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def rows(
        self,
        y0: int,
        y1: int,
        names: tuple[str, ...],
        *,
        columns: tuple[int, int] | None = None,
    ) -> tuple[I64, dict[str, F32]]:
        """Read the samples of some rows of the data window.

        Args:
            y0: First row [pixel].
            y1: The row after the last; both within `window`.
            names: Channels to read; those that the file lacks are omitted.
            columns: First column and the one after the last, within `window`; None for all. Of
                other columns, only what is decoded at the same time is held.

        Returns:
            Offsets of the samples of each pixel, shape (rows * columns + 1,); and values by
            channel, shape (n,).

        Raises:
            FormatError: If the file is damaged.
        """
        names = tuple(name for name in names if name in self._channels)
        (width, height), (left, top, right, _) = self._tile, self.window
        begin, end = columns or (left, right)
        bands = range((y0 - top) // height, -(-(y1 - top) // height))
        across = range((begin - left) // width, -(-(end - left) // width))
        places = [(column, band) for band in bands for column in across]
        unpacked_tiles = self._unpacked(places, names, (begin, end))
        lines: list[_Line] = []
        for band in bands:
            tiles = list(islice(unpacked_tiles, len(across)))
            first = top + band * height
            for i in range(max(0, y0 - first), min(len(tiles[0]), y1 - first)):
                lines.extend(lines_of[i] for lines_of in tiles)
        offsets = np.zeros((y1 - y0) * (end - begin) + 1, np.int64)
        np.cumsum(np.concatenate([line.counts for line in lines]), out=offsets[1:])
        return offsets, {
            name: np.concatenate([line.values[name] for line in lines]) for name in names
        }

    @property
    def band_rows(self) -> int:
        """Number of rows of a tile; 1 in a scanline file."""
        return self._tile[1]

    def samples_by_band(self) -> list[int]:
        """Return the number of samples in each row of tiles, as the chunks' headers state it.

        Raises:
            FormatError: If the file is damaged.
        """
        sample = sum(dtype.itemsize for dtype in self._channels.values())
        columns = range(self._across)
        bands = range(-(-(self.window[3] - self.window[1]) // self._tile[1]))
        return [sum(self._sizes(column, band)[2] // sample for column in columns) for band in bands]

    def _read_header(self) -> None:
        where = self._where
        self._size = self._file.seek(0, 2)
        self._file.seek(0)
        parts, self._has_numbers = read_headers(self._file, where)
        kinds = [part.get("type", ("", b""))[1] for part in parts]
        deep = [i for i, kind in enumerate(kinds) if kind in (b"deepscanline", b"deeptile")]
        if not deep:
            raise FormatError(where, "no deep part", "a deep EXR file")
        self._part = deep[0]
        part = parts[self._part]
        self._channels = read_channels(part, where)
        if not {"Z", "A"} <= self._channels.keys():
            raise FormatError(where, f"channels {', '.join(self._channels)}", "Z and A among them")
        (self._compression,) = values(part, "compression", "<B", where)
        if self._compression not in (NONE, RLE, ZIPS):
            raise FormatError(where, f"compression {self._compression}", "none, rle or zips")
        self.window = read_box(part, "dataWindow", where)
        self.display_window = read_box(part, "displayWindow", where)
        x0, y0, x1, y1 = self.window
        self._tile = (x1 - x0, 1)
        self._is_tiled = kinds[self._part] == b"deeptile"
        if self._is_tiled:
            self._tile = values(part, "tiles", "<IIB", where)[:2]
            if min(self._tile) == 0:
                raise FormatError(where, "tiles without pixels", "tiles of one pixel or more")
        self._across = -(-(x1 - x0) // self._tile[0])
        count = self._across * -(-(y1 - y0) // self._tile[1])
        for i, other in enumerate(parts[: self._part + 1]):
            (chunks,) = values(other, "chunkCount", "<i", where)
            table = read_exactly(self._file, 8 * chunks, where)
            if i == self._part and chunks < count:
                raise FormatError(where, f"{chunks} chunks", f"{count} for its data window")
        self._chunks = struct.unpack_from(f"<{count}Q", table)

    def _sizes(self, column: int, band: int) -> tuple[int, ...]:
        """Return the sizes of a chunk's table, of its samples, and of these decompressed [byte].

        The file is then at its table.
        """
        where, file = self._where, self._file
        file.seek(min(self._chunks[band * self._across + column], self._size))
        row = self.window[1] + band
        expected: tuple[int, ...] = (column, band, 0, 0) if self._is_tiled else (row,)
        if self._has_numbers:
            expected = (self._part, *expected)
        place = f"<{len(expected)}i"
        if struct.unpack(place, read_exactly(file, 4 * len(expected), where)) != expected:
            raise FormatError(where, "a chunk with wrong coordinates", "a complete EXR file")
        sizes = struct.unpack("<QQQ", read_exactly(file, 24, where))
        if sizes[2] > min(sizes[1], self._size) * LARGEST[self._compression]:
            raise FormatError(where, "invalid sample counts", "a complete EXR file")
        return sizes

    def _unpacked(
        self, places: list[tuple[int, int]], names: tuple[str, ...], columns: tuple[int, int]
    ) -> Iterator[list[_Line]]:
        """Yield the rows of tiles, a few of which are read and decoded at a time.

        Args:
            places: Column and row of each tile.
            columns: See `rows`.
        """
        threads = thread_count()
        with ThreadPoolExecutor(threads) as pool:
            for first in range(0, len(places), 2 * threads):
                chunks = [self._chunk(*place) for place in places[first : first + 2 * threads]]
                yield from pool.map(lambda chunk: self._lines(chunk, names, columns), chunks)

    def _chunk(self, column: int, band: int) -> _Chunk:
        """Read a tile; a row of a scanline file is a tile of the window's width."""
        where, file = self._where, self._file
        x0, y0, x1, y1 = self.window
        width = min(self._tile[0], x1 - x0 - column * self._tile[0])
        height = min(self._tile[1], y1 - y0 - band * self._tile[1])
        table_size, packed_size, size = self._sizes(column, band)
        table = read_exactly(file, table_size, where)
        left = x0 + column * self._tile[0]
        return _Chunk((height, width), left, table, read_exactly(file, packed_size, where), size)

    def _lines(
        self, chunk: _Chunk, names: tuple[str, ...], columns: tuple[int, int]
    ) -> list[_Line]:
        """Decode a chunk: row by row, and in each row channel by channel.

        Args:
            columns: See `rows`.
        """
        where = self._where
        height, width = chunk.shape
        wanted = 4 * width * height
        # For a cropped tile, OpenEXR writes an uncompressed table of a whole tile's length.
        table = unpacked(chunk.table[:wanted], wanted, self._compression, where)
        ends = np.frombuffer(table, "<i4").reshape(height, width).astype(np.int64)
        counts = np.diff(ends, axis=1, prepend=0)
        sample = sum(dtype.itemsize for dtype in self._channels.values())
        if (counts < 0).any() or chunk.size != sample * ends[:, -1].sum():
            raise FormatError(where, "invalid sample counts", "a complete EXR file")
        raw = unpacked(chunk.samples, chunk.size, self._compression, where)
        found = []
        at = 0
        begin, end = max(columns[0] - chunk.left, 0), min(columns[1] - chunk.left, width)
        for row in counts:
            n, skipped, kept = (int(part.sum()) for part in (row, row[:begin], row[begin:end]))
            channels = {}
            for name, dtype in self._channels.items():
                if name in names:
                    some = np.frombuffer(raw, dtype, kept, at + skipped * dtype.itemsize)
                    channels[name] = some.astype(np.float32)
                at += n * dtype.itemsize
            found.append(_Line(row[begin:end], channels))
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Chunk:
    """A tile in its compressed form."""

    shape: tuple[int, int]
    """Number of rows and columns."""
    left: int
    """First column [pixel]."""
    table: bytes
    samples: bytes
    size: int
    """Size of the decompressed samples [byte]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """A row of a tile, decoded."""

    counts: I64
    values: dict[str, F32]
