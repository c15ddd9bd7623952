"""Unpacking that stops where the file's own counts say, however much more there is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import BinaryIO, cast

from usdsplat.core.errors import FormatError

TRUSTED_COUNT = 1 << 19
"""Splats that a compressed file of any size may claim (degree 4: 180 MB in memory)."""
BYTES_PER_SPLAT = 2
"""Above `TRUSTED_COUNT`, bytes of file that each splat must have: real captures take 7 or more."""

_INPUT = 1 << 16
_OUTPUT = 1 << 20
_GZIP = 31  # window bits: a header of gzip, and the longest window
_MAX_WINDOW = 1 << 27  # zstd's own default limit


def check_count(source: str, count: int, file_bytes: int) -> None:
    """Refuse counts that a file of this size holds only if it was made to fill memory.

    Raises:
        FormatError: If `count` is past `TRUSTED_COUNT` and below `BYTES_PER_SPLAT`.
    """
    most = max(TRUSTED_COUNT, file_bytes // BYTES_PER_SPLAT)
    if count > most:
        raise FormatError(source, f"{count} splats in {file_bytes} bytes", f"at most {most}")


class Inflater(ABC):
    """A compressed stream read forward, never further than asked; `source` names it in errors."""

    def __init__(self, source: str) -> None:
        self._source = source

    @abstractmethod
    def _next(self, limit: int) -> bytes:
        """At most `limit` further bytes; none only at the end of the stream."""

    def read(self, size: int, what: str) -> bytes:
        """Exactly `size` bytes; memory grows with what arrives, not with `size`.

        Raises:
            FormatError: If the stream is damaged or ends before; `what` says what is missing.
        """
        return b"".join(self.pieces(size, _OUTPUT, what))

    def pieces(self, size: int, step: int, what: str) -> Iterator[bytes]:
        """`size` bytes in pieces of `step`, the last one shorter.

        Raises:
            FormatError: If the stream is damaged or ends before; `what` says what is missing.
        """
        for start in range(0, size, step):
            wanted = min(step, size - start)
            piece = self.read_up_to(wanted)
            if len(piece) < wanted:
                raise FormatError(self._source, f"{start + len(piece)} bytes of {what}", f"{size}")
            yield piece

    def read_up_to(self, size: int) -> bytes:
        """`size` bytes, or as many as there are before the end of the stream."""
        found: list[bytes] = []
        left = size
        while left and (piece := self._next(min(left, _OUTPUT))):
            found.append(piece)
            left -= len(piece)
        return found[0] if len(found) == 1 else b"".join(found)

    def expect_end(self, what: str) -> None:
        """Check that nothing follows `what`.

        Raises:
            FormatError: If the stream goes on, or its checksum is wrong.
        """
        if self._next(1):
            raise FormatError(self._source, f"more data after {what}", "the end of the stream")


class Gunzip(Inflater):
    """The first member of a gzip file."""

    def __init__(self, source: str, file: BinaryIO) -> None:
        super().__init__(source)
        self._file = file
        from isal import isal_zlib  # zlib's interface, and twice as fast

        self._error = cast(type[Exception], isal_zlib.error)  # its stubs say an instance
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
                raise FormatError(self._source, "gzip data that breaks off", "a whole gzip stream")
        return b""


class Unzstd(Inflater):
    """One zstd frame."""

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
