"""Folders of temporary files that are no part of a result."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from usdsplat.core import output


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield a folder that only the user can read; it is removed with its files at the end.

    Raises:
        OSError: If there is no place for temporary files.
    """
    folder = Path(tempfile.gettempdir(), f"usdsplat-{os.getpid()}-{secrets.token_hex(8)}")
    if output.announce is not None:
        output.announce(str(folder), True)
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if output.announce is not None:
            output.announce(str(folder), False)
