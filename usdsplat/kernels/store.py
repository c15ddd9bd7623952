"""Where compiled kernels are kept between processes: a folder of files, each named by its key.

A key is the hash of all that an entry was made of, so an entry is never wrong, only missing. Files
are written beside their place and renamed, so that processes which start together do not meet; each
begins with the hash of the rest, so that a damaged one is missing too.

The folder is USDSPLAT_CACHE_DIR, or `usdsplat` in the user's cache folder. It may be deleted at any
time, and may be read-only: what it has is used, and what cannot be added to it is compiled again by
the next process.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import sys
from contextlib import suppress
from pathlib import Path

VARIABLE = "USDSPLAT_CACHE_DIR"
DIGEST = 32
"""[byte] At the beginning of each file."""

_chosen: Path | None = None
_refusal = ""


def folder() -> Path | None:
    """Return the folder; None where the user has no home and names no folder."""
    if _chosen is not None:
        return _chosen
    if os.environ.get(VARIABLE):
        return Path(os.path.abspath(os.path.expanduser(os.environ[VARIABLE])))
    try:
        return _users_caches() / "usdsplat" / "kernels"
    except RuntimeError:  # no home directory at all
        return None


def use(path: Path) -> None:
    """Keep kernels in the folder `path` for the rest of this process."""
    global _chosen
    _chosen = path


def key_of(*parts: str) -> str:
    """Return the key of an entry that is made of `parts`."""
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def has(key: str) -> bool:
    """Return whether an entry seems to be there; its contents are not read."""
    path = _path(key)
    return path is not None and path.is_file()


def load(key: str) -> bytes | None:
    """Return the bytes kept under `key`; None where there are none, or damaged ones."""
    path = _path(key)
    if path is None:
        return None
    try:
        content = path.read_bytes()
    except OSError:
        return None
    data = content[DIGEST:]
    return data if content[:DIGEST] == hashlib.sha256(data).digest() else None


def save(key: str, data: bytes) -> bool:
    """Keep `data` under `key`. Return False where it cannot be written; `refusal` then says why."""
    global _refusal
    path = _path(key)
    if path is None:
        _refusal = f"no home directory and no {VARIABLE}"
        return False
    temporary = path.with_name(f".new-{os.getpid()}-{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:  # as others may read as the user's umask lets them
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(temporary, path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        _refusal = f"{folder()}: {(error.strerror or str(error)).lower()}"
        return False
    return True


def refusal() -> str:
    """Return what was found where something could not be kept in this process; "" where all was."""
    return _refusal


# --- private -------------------------------------------------------------------------------


def _path(key: str) -> Path | None:
    root = folder()
    return None if root is None else root / key[:2] / key[2:]


def _users_caches() -> Path:
    """Return the folder in which this platform keeps a user's caches."""
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home())))
    return Path.home() / ".cache"
