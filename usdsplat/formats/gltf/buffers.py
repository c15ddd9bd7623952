"""Read the buffers of a glTF document: in the .glb, in files beside it, or in data URIs."""

from __future__ import annotations

import base64
import binascii
import stat
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

from usdsplat.core.errors import FormatError

DATA_URI = "data:"


@dataclass(frozen=True, slots=True)
class BufferSpec:
    """A buffer as the document describes it."""

    uri: str | None
    """A file beside the document or a data URI; None for the binary chunk of a .glb."""
    size: int
    """[byte]"""


@dataclass(frozen=True, slots=True)
class BinaryChunk:
    """Location of the binary chunk in a .glb file."""

    start: int
    size: int
    """[byte]"""


@dataclass(frozen=True, slots=True)
class _Opened:
    read: Callable[[int, int], bytes]
    """Function (offset, size) -> bytes."""
    size: int


class Buffers:
    """The buffers of a document, opened on first use; any thread may read."""

    def __init__(
        self, path: Path, specs: Sequence[BufferSpec], chunk: BinaryChunk | None, files: ExitStack
    ) -> None:
        self._path = path
        self._specs = specs
        self._chunk = chunk
        self._files = files
        self._opened: dict[int, _Opened] = {}
        self._lock = threading.Lock()
        self.paths: list[Path] = [path]
        """Files that were read, starting with the document."""

    def size(self, index: int) -> int:
        """Return the declared size of buffer `index` [byte]; opens it.

        Raises:
            FormatError: If the buffer does not exist, cannot be opened, or is shorter than
            declared.
        """
        where = f"{self._path}: buffer {index}"
        if index >= len(self._specs):
            raise FormatError(where, "none", f"one of {len(self._specs)} buffers")
        spec = self._specs[index]
        if index not in self._opened:
            self._opened[index] = self._open(where, spec)
        present = self._opened[index].size
        if spec.size > present:
            raise FormatError(where, f"{present} bytes", f"{spec.size}, as declared")
        return spec.size

    def read(self, index: int, offset: int, size: int) -> bytes:
        """Read bytes of a buffer. The caller has called `size` for it, and the range lies within.

        Raises:
            FormatError: If the file was truncated in the meantime.
        """
        with self._lock:
            data = self._opened[index].read(offset, size)
        if len(data) < size:
            found = f"{len(data)} bytes at {offset} of buffer {index}"
            raise FormatError(str(self._path), found, str(size))
        return data

    def _open(self, where: str, spec: BufferSpec) -> _Opened:
        if spec.uri is None:
            if self._chunk is None:
                raise FormatError(where, "no uri and no binary chunk", "one of them")
            return _in_file(self._enter(self._path), self._chunk.start, self._chunk.size)
        if spec.uri.startswith(DATA_URI):
            data = _decoded(where, spec.uri)
            return _Opened(lambda offset, size: data[offset : offset + size], len(data))
        beside = _beside(where, self._path.parent, spec.uri)
        try:
            state = beside.stat()
            if not stat.S_ISREG(state.st_mode):  # opening a pipe may block, a device has no end
                raise FormatError(where, "neither file nor folder", "a file beside the document")
            opened = _in_file(self._enter(beside), 0, state.st_size)
        except OSError as error:
            found = f"{spec.uri[:60]!r}: {(error.strerror or str(error)).lower()}"
            raise FormatError(where, found, "a readable file beside the document") from error
        if beside not in self.paths:
            self.paths.append(beside)
        return opened

    def _enter(self, path: Path) -> BinaryIO:
        return self._files.enter_context(path.open("rb", buffering=0))


@contextmanager
def open_buffers(
    path: Path, specs: Sequence[BufferSpec], chunk: BinaryChunk | None = None
) -> Iterator[Buffers]:
    """Open the buffers of the document at `path`; files are closed on exit."""
    with ExitStack() as files:
        yield Buffers(path, specs, chunk, files)


def _in_file(file: BinaryIO, start: int, size: int) -> _Opened:
    def read(offset: int, count: int) -> bytes:
        file.seek(start + offset)
        return file.read(count)

    return _Opened(read, size)


def _decoded(where: str, uri: str) -> bytes:
    head, comma, body = uri.partition(",")
    if not comma or not head.endswith(";base64"):
        raise FormatError(where, f"data URI {head[:60]!r}", "base64")
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as error:
        raise FormatError(where, f"damaged base64 ({error})", "base64") from error


def _beside(where: str, folder: Path, uri: str) -> Path:
    """Return the file that a relative URI names; raise an error if it may leave the folder."""
    name = unquote(uri)
    parts = name.split("/")
    # A colon may start a URI scheme or name a drive; unprintable names cannot be files.
    stray = any(sign in name for sign in "\\:\0?#") or not name.isprintable()
    if stray or any(part in ("", ".", "..") for part in parts):
        raise FormatError(where, f"uri {uri[:60]!r}", "a file in the folder of the document")
    return folder.joinpath(*parts)
