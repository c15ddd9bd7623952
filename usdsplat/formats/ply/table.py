"""Read the rows of one element of a PLY file in blocks, in any encoding.

The counts of the header are checked against the size of the file before anything is read.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from io import FileIO
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import FormatError
from usdsplat.formats.cloud_builder import in_parallel
from usdsplat.formats.ply.header import Element, Header

Block = npt.NDArray[np.void]

BLOCK_BYTES = 1 << 20
"""Size of a block in the file [byte]: fits the cache while it is decoded."""

_LINE_LIMIT = 1 << 16


def open_table(path: Path, header: Header, name: str) -> Table:
    """Open the element called `name`, after checking that the file can hold its rows.

    Raises:
        FormatError: If the element is missing, has list properties, follows an element of unknown
            size, or if the file is too short.
    """
    element = header.element(name)
    if element is None:
        raise FormatError(str(path), f"no element {name}", "one in the header")
    if element.has_list:
        raise FormatError(str(path), f"a list property in element {name}", "numbers only")
    kind = BinaryTable if header.byte_order else TextTable
    return kind(path, header, element)


class Table(ABC):
    """The rows of an element, which have a fixed size."""

    dtype: np.dtype[np.void]
    """Type of the blocks: one field per property, native byte order."""

    def __init__(self, path: Path, header: Header, element: Element) -> None:
        self._path = path
        self._header = header
        self._element = element
        self._before = header.elements[: header.elements.index(element)]
        self.types = element.types
        self.count = element.count
        self._first = 0
        self.rows_per_block = max(1, BLOCK_BYTES // max(1, element.row_bytes))
        needed = header.size + self._smallest()
        size = path.stat().st_size
        if needed > size:
            found = f"{size} bytes"
            expected = f"at least {needed} for {element.count} rows of element {element.name}"
            raise FormatError(str(path), found, expected)

    @abstractmethod
    def _smallest(self) -> int:
        """Return the minimum size of the data up to the end of these rows [byte]."""

    @abstractmethod
    def _pieces(self, rows: int) -> Generator[Block]:
        """Yield blocks of `rows` rows, the last one shorter."""

    def blocks(self, rows: int | None = None) -> Iterator[tuple[slice, Block]]:
        """Yield (slice of rows, block); a block is valid until the next one is requested.

        Args:
            rows: Rows per block; `rows_per_block` by default.

        Raises:
            FormatError: If the rows end early, or contain text that is not a number.
        """
        start = 0
        with closing(self._pieces(rows or self.rows_per_block)) as pieces:
            for block in pieces:
                yield slice(start, start + len(block)), block
                start += len(block)

    def visit(self, work: Callable[[slice, Block], None], told: Callable[[int], None]) -> None:
        """Call `work` with (slice of rows, block) for all rows.

        A block is valid until the call of `work` returns.

        Rows of a fixed size are read and processed in threads.

        Args:
            work: May be called by several threads at once.
            told: Receives the number of finished rows, in the caller's thread.

        Raises:
            FormatError: As for `blocks`.
            Exception: The first that `work` raised, in the order of the rows.
        """
        for rows, block in self.blocks():
            work(rows, block)
            told(rows.stop)

    def part(self, first: int, last: int) -> Table:
        """Return a table of the rows `first` to `last` only, counted from 0; binary files only."""
        part = copy.copy(self)
        part._first, part.count = first, last - first
        return part

    def remarks(self) -> tuple[str, ...]:
        """Return a note if the file is longer than its header declares, else nothing."""
        total = self._header.size
        for element in self._header.elements:
            if element.has_list or not self._header.byte_order:
                return ()  # the length is unknown without reading all of it
            total += element.count * element.row_bytes
        surplus = self._path.stat().st_size - total
        return (f"ignored {surplus} bytes after the last element",) if surplus > 0 else ()

    def whole(self) -> Block:
        """Read all rows at once, for small elements."""
        if not self.count:
            return np.empty(0, self.dtype)
        return next(iter(self.blocks(self.count)))[1]

    def _short(self, found: int) -> FormatError:
        what = f"{found} rows of element {self._element.name}"
        return FormatError(str(self._path), what, str(self.count))


class BinaryTable(Table):
    """Binary rows, in either byte order."""

    def __init__(self, path: Path, header: Header, element: Element) -> None:
        for earlier in header.elements[: header.elements.index(element)]:
            if earlier.has_list:
                found = f"a list property in element {earlier.name}"
                expected = f"rows of fixed size before element {element.name}"
                raise FormatError(str(path), found, expected)
        fields = [(name, header.byte_order + code) for name, code in element.types.items()]
        self._stored = np.dtype(fields)
        self.dtype = self._stored.newbyteorder("=")
        super().__init__(path, header, element)

    def _smallest(self) -> int:
        return self._offset() + self.count * self._stored.itemsize

    def _offset(self) -> int:
        return sum(earlier.count * earlier.row_bytes for earlier in self._before)

    def visit(self, work: Callable[[slice, Block], None], told: Callable[[int], None]) -> None:
        # Idle buffers, taken and returned by threads.
        buffers: list[Block] = []

        def read_and_work(rows: slice) -> None:
            buffer = buffers.pop() if buffers else self._buffer(self.rows_per_block)
            with self._path.open("rb", buffering=0) as file:
                work(rows, self._read(file, rows, buffer))
            buffers.append(buffer)

        in_parallel(self.count, read_and_work, rows=self.rows_per_block, told=told)

    def _pieces(self, rows: int) -> Generator[Block]:
        buffer = self._buffer(rows)
        with self._path.open("rb", buffering=0) as file:
            for start in range(0, self.count, rows):
                yield self._read(file, slice(start, min(start + rows, self.count)), buffer)

    def _buffer(self, rows: int) -> Block:
        return np.empty(min(rows, self.count), self._stored)

    def _read(self, file: FileIO, rows: slice, buffer: Block) -> Block:
        """Read some rows, into `buffer` if the byte order allows."""
        block = buffer[: rows.stop - rows.start]
        start = (self._first + rows.start) * self._stored.itemsize
        file.seek(self._header.size + self._offset() + start)
        if file.readinto(block.view(np.uint8).data) < block.nbytes:
            raise self._short(rows.start)  # the file was truncated in the meantime
        return block.astype(self.dtype, copy=False)


class TextTable(Table):
    """Text rows, one line of decimal numbers each; float64 holds every PLY type exactly."""

    def __init__(self, path: Path, header: Header, element: Element) -> None:
        self.dtype = np.dtype([(name, "f8") for name in element.types])
        super().__init__(path, header, element)

    def _smallest(self) -> int:
        # A number takes a digit and a separator; the last line may lack its end.
        numbers = sum(e.count * len(e.types) for e in (*self._before, self._element))
        return max(0, 2 * numbers - 1)

    def _pieces(self, rows: int) -> Generator[Block]:
        lines = self._lines()
        skipped = sum(earlier.count for earlier in self._before if earlier.types)
        for _ in islice(lines, skipped):
            pass
        for start in range(0, self.count, rows):
            piece = list(islice(lines, min(rows, self.count - start)))
            if len(piece) < min(rows, self.count - start):
                raise self._short(start + len(piece))
            yield self._parse(piece, start)

    def _lines(self) -> Iterator[bytes]:
        """Yield the lines of the data that are not blank."""
        with self._path.open("rb") as file:
            file.seek(self._header.size)
            while line := file.readline(_LINE_LIMIT):
                if len(line) == _LINE_LIMIT:
                    raise FormatError(str(self._path), f"a line of {_LINE_LIMIT} bytes", "a row")
                if not line.isspace():
                    yield line

    def _parse(self, lines: list[bytes], start: int) -> Block:
        name, width = self._element.name, len(self._element.types)
        where = f"{self._path}: rows of element {name} from {start} on"
        try:
            numbers = np.loadtxt(lines, np.float64, comments=None, ndmin=2, encoding="latin-1")
        except ValueError as error:
            found = "text that is not a number, or rows of different lengths"
            raise FormatError(where, found, f"{width} numbers a row") from error
        if numbers.shape[1] != width:
            raise FormatError(where, f"{numbers.shape[1]} numbers a row", str(width))
        return numbers.view(self.dtype)[:, 0]
