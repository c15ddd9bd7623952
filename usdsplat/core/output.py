"""Results appear whole or not at all: a temporary sibling, renamed when it is complete."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from usdsplat.core.errors import OutputError, UsdSplatError

Existing = Literal["error", "resume", "replace"]
"""What becomes of results that exist already: they are an error, are kept and continued, or are
replaced."""

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG}


@contextmanager
def atomic_path(target: Path | str) -> Iterator[Path]:
    """Yield a path to write; it becomes `target` on success and disappears on any error.

    The path is a hidden, unique sibling that keeps the whole name of the target at its end, so
    writers that choose a format by suffix (".exr", ".compressed.ply") choose the same one. An older
    file at `target` is untouched until the rename. A link is followed, never replaced.

    Raises:
        OutputError: If the folder is missing or not writable, if `target` exists and is not a plain
            file, or if the disk fills up meanwhile.
    """
    final = Path(os.path.realpath(target))
    _check(target, final)
    temporary = final.with_name(f".{os.getpid()}-{secrets.token_hex(4)}.{final.name}")
    try:
        yield temporary
        os.replace(temporary, final)
    except UsdSplatError:
        raise
    except OSError as error:
        if error.errno not in _NO_ROOM and error.filename != str(temporary):
            raise
        found = error.strerror or str(error)
        raise OutputError(str(target), found, "a place with room to write") from error
    finally:
        # BaseException included: Ctrl-C leaves no litter. After the rename there is none to remove.
        temporary.unlink(missing_ok=True)


def _check(target: Path | str, final: Path) -> None:
    """Refuse early what would fail, or harm something, at the rename."""
    if not final.parent.is_dir():
        raise OutputError(str(target), f"no folder {final.parent}", "an existing folder")
    if not os.access(final.parent, os.W_OK | os.X_OK):
        raise OutputError(str(target), "a folder without write permission", "a writable folder")
    if final.exists() and not final.is_file():
        raise OutputError(str(target), "something that is not a plain file", "a file or a new name")
