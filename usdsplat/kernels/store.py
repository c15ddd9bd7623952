"""Store compiled kernels in a folder that all processes share: one file per entry, named by its
key.

A key is the hash of everything that an entry depends on, so an entry is never out of date. A file
is written under a temporary name and renamed, so concurrent processes never see an incomplete one.
It begins with the hash of its contents; a damaged file counts as missing.

The folder is USDSPLAT_CACHE_DIR, or `usdsplat/kernels` in the user's cache folder. It may be
deleted at any time. If it is read-only, existing entries are read, and missing ones are compiled
again by each process.
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
"""Size of the hash at the beginning of each file [byte]."""

_chosen: Path | None = None
_refusal = ""


def folder() -> Path | None:
    """Return the folder; None if the user has no home directory and VARIABLE is not set."""
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
    """Return whether the file of an entry exists; it is not checked for damage."""
    path = _path(key)
    return path is not None and path.is_file()


def load(key: str) -> bytes | None:
    """Return the bytes stored under `key`; None if they are missing, unreadable or damaged."""
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
    """Store `data` under `key`. Return False if it cannot be written; `refusal` then says why."""
    global _refusal
    path = _path(key)
    if path is None:
        _refusal = f"no home directory and no {VARIABLE}"
        return False
    temporary = path.with_name(f".new-{os.getpid()}-{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:  # readable for others as the user's umask allows
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(temporary, path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        _refusal = f"{folder()}: {(error.strerror or str(error)).lower()}"
        return False
    return True


def refusal() -> str:
    """Return why `save` last failed here, as the "found" part of an error; "" if it never did."""
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
