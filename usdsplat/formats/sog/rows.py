"""Read ranges of rows of SOG files, each of which can only be unpacked whole."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.options import READ_OPTIONS
from usdsplat.formats.sog.decoding import SogCodes, read_codes, survey
from usdsplat.formats.sog.files import SogFiles, open_sog
from usdsplat.formats.sog.meta import META

HELD = 128 << 20
"""Memory of the codes of files that a reader keeps, besides those of the last file [byte]."""

_Key = tuple[str, int, int]


def is_sog(path: str) -> bool:
    """Return whether the name is that of a SOG, an archive or `meta.json`."""
    name = os.path.basename(path).lower()
    return name == META or name.endswith(".sog")


def count_and_degree(path: str) -> tuple[int, int]:
    """Return the number of splats of a SOG, and the degree of its harmonics; no splat is decoded.

    Raises:
        FormatError: If it is no regular file, or its metadata is invalid.
        OSError: If it cannot be read.
    """
    with _opened(path) as files:
        sog = survey(files)
        return sog.meta.count, sog.degree


def file_bytes(path: str) -> int:
    """Return the size of an archive, or of all files in the folder of a `meta.json` [byte].

    Raises:
        FormatError: If it is no regular file, or the archive is damaged.
        OSError: If it cannot be read.
    """
    with _opened(path) as files:
        return files.total_bytes


def stamp(path: str) -> tuple[int, int]:
    """Return two numbers that change when a SOG is written: time and size of an archive, or those
    of all files in the folder of a `meta.json`. They have a meaning within one process only.

    Raises:
        OSError: If there is no such file, or the folder cannot be listed.
    """
    state = os.stat(path)
    if os.path.basename(path).lower() != META:
        return state.st_mtime_ns, state.st_size
    with os.scandir(os.path.dirname(path) or ".") as entries:
        states = [(entry.name, entry.stat()) for entry in entries if entry.is_file()]
    files = sorted((name, each.st_mtime_ns, each.st_size) for name, each in states)
    return hash(tuple(files)), sum(size for _, _, size in files)


@contextmanager
def _opened(path: str) -> Iterator[SogFiles]:
    """Open a SOG that a stage names.

    Raises:
        FormatError: If it is no regular file: to open a pipe would wait for ever.
    """
    if not os.path.isfile(path):
        raise FormatError(path, "no regular file", "a SOG file")
    with open_sog(Path(path)) as files:
        yield files


class SogRows:
    """Reader of rows of SOG files, for several threads.

    Codes of the files that were read last stay in memory, up to HELD bytes, because the nodes of a
    tree have many small ranges of one file.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._reading: dict[_Key, threading.Lock] = {}
        self._held: OrderedDict[_Key, SogCodes] = OrderedDict()

    def read(self, path: str, first: int, count: int, degree: int) -> SplatCloud:
        """Decode rows of a file.

        Args:
            path: An archive, or the `meta.json` of a folder.
            first: First row.
            count: Number of rows.
            degree: Degree of the result, at least that of the file; higher coefficients are 0.

        Raises:
            FormatError: If the file is damaged, does not have these rows, has harmonics of a higher
                degree, or a number is not finite.
            OSError: If it cannot be read.
        """
        codes = self._codes(path)
        if not 0 <= first <= first + count <= len(codes):
            raise FormatError(path, f"{len(codes)} splats", f"rows {first} to {first + count}")
        if codes.degree > degree:
            raise FormatError(path, f"harmonics of degree {codes.degree}", f"at most {degree}")
        builder = CloudBuilder(path, count, degree, READ_OPTIONS)
        codes.decode([(first, first + count)], builder, 0)
        return builder.cloud()[0]

    def count(self, path: str) -> int:
        """Return the number of splats of a file. One that was read last is not read again.

        Raises:
            FormatError: As for `read`.
            OSError: As for `read`.
        """
        return len(self._codes(path))

    def _codes(self, path: str) -> SogCodes:
        """Return the codes of a file; threads that ask for the same file wait for one of them."""
        key = path, *stamp(path)
        with self._lock:
            reading = self._reading.setdefault(key, threading.Lock())
        with reading:
            with self._lock:
                if key in self._held:
                    self._held.move_to_end(key)
                    return self._held[key]
            with _opened(path) as files:
                codes = read_codes(survey(files))
            with self._lock:
                self._held[key] = codes
                while len(self._held) > 1 and sum(c.size for c in self._held.values()) > HELD:
                    self._reading.pop(self._held.popitem(last=False)[0], None)
            return codes
