"""Write files atomically: to a temporary sibling, renamed when it is complete."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from usdsplat.core import interrupt
from usdsplat.core.errors import OutputError, UsdSplatError

Existing = Literal["error", "resume", "replace"]
"""Treatment of existing results: raise an error, keep and continue them, or replace them."""

announce: Callable[[str, bool], None] | None = None
"""Function that is called with a temporary path and True before the path is made, and with the path
and False after it was removed. Another process can then remove it if this one is killed."""

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@contextmanager
def atomic_path(target: Path | str) -> Iterator[Path]:
    """Yield a path to write to; it becomes `target` on success and is deleted on any error.

    The path is a hidden, unique sibling that ends in the whole name of the target, so writers that
    choose a format by suffix (".exr", ".compressed.ply") choose the same one. An existing file at
    `target` stays untouched until the rename. A symbolic link is followed, not replaced.

    Raises:
        OutputError: If the folder is missing or not writable, if `target` exists and is not a plain
            file, or if the disk becomes full.
        Interrupted: If the process was asked to end, see `core.interrupt`.
    """
    final = Path(os.path.realpath(target))
    _check(target, final)
    temporary = final.with_name(f".{os.getpid()}-{secrets.token_hex(4)}.{final.name}")
    if announce is not None:
        announce(str(temporary), True)
    try:
        yield temporary
        interrupt.check()
        os.replace(temporary, final)
    except UsdSplatError:
        raise
    except OSError as error:
        if error.errno not in _NO_ROOM and error.filename != str(temporary):
            raise
        found = error.strerror or str(error)
        raise OutputError(str(target), found, "a writable place with enough free space") from error
    finally:
        # Also on Ctrl-C. After the rename the temporary file no longer exists.
        temporary.unlink(missing_ok=True)
        if announce is not None:
            announce(str(temporary), False)


def _check(target: Path | str, final: Path) -> None:
    """Raise an error early for a target that would fail, or be damaged, at the rename."""
    if not final.parent.is_dir():
        raise OutputError(str(target), f"no folder {final.parent}", "an existing folder")
    if not os.access(final.parent, os.W_OK | os.X_OK):
        raise OutputError(str(target), "a folder without write permission", "a writable folder")
    if final.exists() and not final.is_file():
        raise OutputError(str(target), "something that is not a plain file", "a file or a new name")
