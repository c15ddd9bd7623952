"""Hash the files that a picture is made from, for its header."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence

from usdsplat.core.file_hash import file_hash


def source_hash(files: Sequence[str], clips: Sequence[str] = ()) -> str:
    """Return the SHA-256 of the contents of files, as 64 hexadecimal digits; "" without files.

    The hash is that of the hashes of the files, sorted: it does not depend on their names or their
    places, so that a copy of a show has the same one. Files that have not changed since the last
    call are not read again.

    Args:
        files: Paths. If one cannot be read, the result is "".
        clips: Paths of value clips. Only their names and sizes are hashed: a sequence of captures
            is too large to be read for each picture.
    """
    try:
        contents = [file_hash(path) for path in files]
        digests = sorted([*contents, *map(_name_and_size, clips)])
    except OSError:
        return ""
    return hashlib.sha256("".join(digests).encode()).hexdigest() if digests else ""


def _name_and_size(path: str) -> str:
    """Return the SHA-256 of the name of a file and its size."""
    text = f"{os.path.basename(path)}\n{os.stat(path).st_size}"
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()
