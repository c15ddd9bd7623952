"""Hash files, each once as long as it does not change."""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache


def file_hash(path: str) -> str:
    """Return the SHA-256 of the content of a file, as 64 hexadecimal digits. A file whose size and
    time are those of an earlier call is not read again.

    Raises:
        OSError: If it cannot be read.
    """
    status = os.stat(path)
    return _digest(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=4096)
def _digest(path: str, _size: int, _time: int) -> str:
    """Return the SHA-256 of a file. Size and time are only part of the cache's key."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
