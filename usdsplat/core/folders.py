"""Make the folders of output files, and remove them if no file comes to lie there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from usdsplat.core.errors import OutputError


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder and its missing parents. On an error in the context, remove those again.

    Raises:
        OutputError: If a folder cannot be made.
    """
    missing = [each for each in (folder, *folder.parents) if not os.path.exists(each)]
    made: list[Path] = []
    try:
        for each in reversed(missing):
            _make(each)
            made.append(each)
        yield
    except BaseException:
        for each in reversed(made):
            with suppress(OSError):  # another process may have written there in the meantime
                each.rmdir()
        raise


def check_folder(folder: Path) -> None:
    """Raise an error unless files can be written in a folder, or it can be made.

    Raises:
        OutputError: If a folder above is a file, or nothing can be written there.
    """
    there = next((each for each in (folder, *folder.parents) if os.path.exists(each)), folder)
    if not os.path.isdir(there):
        raise OutputError(str(folder), f"a file, {there}", "a place where a folder can be made")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(str(folder), "a folder without write permission", "a writable folder")


def _make(folder: Path) -> None:
    """Make a folder whose parent exists."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise OutputError(str(folder), found, "a place where a folder can be made") from error
