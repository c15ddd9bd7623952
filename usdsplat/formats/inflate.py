"""Decompress gzip and zstd streams up to a size that the file's own counts imply."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import BinaryIO, cast

from usdsplat.core.errors import FormatError

TRUSTED_COUNT = 1 << 19
"""Number of splats that any compressed file may claim (degree 4: 180 MB in memory)."""
BYTES_PER_SPLAT = 2
"""Above `TRUSTED_COUNT`, minimum number of file bytes per splat; real captures take 7 or more."""

_INPUT = 1 << 16
_OUTPUT = 1 << 20
_GZIP = 31  # window bits: gzip header and the longest window
_MAX_WINDOW = 1 << 27  # zstd's own default limit


def check_count(source: str, count: int, file_bytes: int) -> None:
    """Raise an error for a count that only a file made to exhaust memory would have.

    Raises:
        FormatError: If `count` exceeds `TRUSTED_COUNT` and one splat per `BYTES_PER_SPLAT` bytes.
    """
    most = max(TRUSTED_COUNT, file_bytes // BYTES_PER_SPLAT)
    if count > most:
        raise FormatError(source, f"{count} splats in {file_bytes} bytes", f"at most {most}")


class Inflater(ABC):
    """A compressed stream that is read forward and never further than requested.

    `source` names it in error messages."""

    def __init__(self, source: str) -> None:
        self._source = source

    @abstractmethod
    def _next(self, limit: int) -> bytes:
        """Return at most `limit` further bytes; none only at the end of the stream."""

    def read(self, size: int, what: str) -> bytes:
        """Read exactly `size` bytes; memory grows with the data that arrives, not with `size`.

        Raises:
            FormatError: If the stream is damaged or ends before; `what` names the missing data.
        """
        return b"".join(self.pieces(size, _OUTPUT, what))

    def pieces(self, size: int, step: int, what: str) -> Iterator[bytes]:
        """Yield `size` bytes in pieces of `step`, the last one shorter.

        Raises:
            FormatError: If the stream is damaged or ends before; `what` names the missing data.
        """
        for start in range(0, size, step):
            wanted = min(step, size - start)
            piece = self.read_up_to(wanted)
            if len(piece) < wanted:
                raise FormatError(self._source, f"{start + len(piece)} bytes of {what}", f"{size}")
            yield piece

    def read_up_to(self, size: int) -> bytes:
        """Read `size` bytes, or fewer at the end of the stream."""
        found: list[bytes] = []
        left = size
        while left and (piece := self._next(min(left, _OUTPUT))):
            found.append(piece)
            left -= len(piece)
        return found[0] if len(found) == 1 else b"".join(found)

    def expect_end(self, what: str) -> None:
        """Raise an error if data follows `what`.

        Raises:
            FormatError: If the stream continues, or its checksum is wrong.
        """
        if self._next(1):
            raise FormatError(self._source, f"more data after {what}", "the end of the stream")


class Gunzip(Inflater):
    """The first member of a gzip file."""

    def __init__(self, source: str, file: BinaryIO) -> None:
        super().__init__(source)
        self._file = file
        # Zlib's interface at twice the speed.
        from isal import isal_zlib

        # Its type stubs wrongly declare an instance.
        self._error = cast(type[Exception], isal_zlib.error)
        self._stream = isal_zlib.decompressobj(wbits=_GZIP)

    def _next(self, limit: int) -> bytes:
        while not self._stream.eof:
            data = self._stream.unconsumed_tail or self._file.read(_INPUT)
            try:
                piece: bytes = self._stream.decompress(data, limit)
            except self._error as error:
                raise FormatError(self._source, f"damaged gzip data ({error})", "gzip") from error
            if piece:
                return piece
            if not data:
                raise FormatError(self._source, "truncated gzip data", "a complete gzip stream")
        return b""


class Unzstd(Inflater):
    """A zstd frame."""

    def __init__(self, source: str, data: bytes) -> None:
        import zstandard

        super().__init__(source)
        self._error = zstandard.ZstdError
        unpacker = zstandard.ZstdDecompressor(max_window_size=_MAX_WINDOW)
        self._stream = unpacker.stream_reader(data)

    def _next(self, limit: int) -> bytes:
        try:
            return self._stream.read(limit)
        except self._error as error:
            raise FormatError(self._source, f"damaged zstd data ({error})", "zstd") from error
