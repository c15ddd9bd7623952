"""Read the files of a SOG from a zip archive or a folder, with untrusted names and sizes."""

from __future__ import annotations

import os
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from usdsplat.core.errors import FormatError
from usdsplat.formats.sog.meta import META

# Other methods may unpack any amount into memory.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, EOFError, OSError),  # OSError: offsets before the start
    *(ValueError, OverflowError, RuntimeError),  # RuntimeError: methods that zipfile does not know
)
_ENCRYPTED = 0x1


class SogFiles(ABC):
    """The files of a SOG; `source` names it in error messages."""

    def __init__(self, source: str, total_bytes: int) -> None:
        self.source = source
        self.total_bytes = total_bytes
        """Size of the archive, or of all files of the folder [byte]."""

    def read(self, name: str, limit: int) -> bytes:
        """Read the file `name`, of at most `limit` bytes.

        Raises:
            FormatError: If the name contains a folder, or the file is missing, too long or damaged.
        """
        if "/" in name or "\\" in name or ":" in name or "\0" in name or name in ("", ".", ".."):
            raise FormatError(self.source, f"file name {name[:60]!r}", "a name without folders")
        data = self._read(name, limit + 1)
        if len(data) > limit:
            raise FormatError(f"{self.source}: {name}", f"over {limit} bytes", "no more")
        return data

    @abstractmethod
    def paths(self, names: Iterable[str]) -> tuple[Path, ...]:
        """Return the files on disk that hold these files of the SOG, each once."""

    @abstractmethod
    def _read(self, name: str, most: int) -> bytes:
        """Read up to `most` bytes of a file whose name is checked."""


class _Folder(SogFiles):
    """A SOG in a folder."""

    def __init__(self, folder: Path) -> None:
        sizes = [entry.stat().st_size for entry in folder.iterdir() if entry.is_file()]
        super().__init__(str(folder), sum(sizes))
        self._folder = folder

    def paths(self, names: Iterable[str]) -> tuple[Path, ...]:
        return tuple(self._folder / name for name in dict.fromkeys(names))

    def _read(self, name: str, most: int) -> bytes:
        path = self._folder / name
        if not os.path.isfile(path):  # unlike Path.is_file, accepts names of any length
            raise FormatError(self.source, f"no file {name[:60]!r}", "one in the folder")
        with path.open("rb") as file:
            return file.read(most)


class _Archive(SogFiles):
    """A SOG in a zip file; nothing is extracted to disk."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        super().__init__(str(path), path.stat().st_size)
        self._path = path
        self._archive = archive
        self._names = [info.filename for info in archive.infolist()]

    def paths(self, names: Iterable[str]) -> tuple[Path, ...]:
        return (self._path,)

    def _read(self, name: str, most: int) -> bytes:
        found = self._names.count(name)
        if found != 1:
            raise FormatError(self.source, f"{found} entries {name[:60]!r}", "one in the archive")
        info = self._archive.getinfo(name)
        if info.compress_type not in _METHODS or info.flag_bits & _ENCRYPTED:
            where = f"{self.source}: {name}"
            raise FormatError(
                where,
                "an entry that is encrypted, or compressed by another method",
                "stored or deflated",
            )
        with _damage_as_format_error(self.source), self._archive.open(info) as file:
            return file.read(most)


@contextmanager
def open_sog(path: Path) -> Iterator[SogFiles]:
    """Open an archive, a folder, or the folder of a `meta.json`.

    Raises:
        FormatError: If the archive is damaged.
    """
    if path.is_dir() or path.name.lower() == META:
        yield _Folder(path if path.is_dir() else path.parent)
        return
    with _damage_as_format_error(str(path)):
        archive = zipfile.ZipFile(path)
    with archive:
        yield _Archive(path, archive)


@contextmanager
def _damage_as_format_error(source: str) -> Iterator[None]:
    """Convert the exceptions that zipfile raises on damaged archives to FormatError."""
    try:
        yield
    except _DAMAGE as error:
        raise FormatError(source, f"a damaged archive ({error})", "a zip file") from error
