"""How kernels are compiled: flags, and a cache that notices when any kernel changes.

Numba's own cache looks at the file of the function it caches, not at the functions that one calls.
So the cache folder is keyed by a hash of every kernel source that a kernel may call: edit one
formula, and all that might use it is compiled again. Where no folder can be written, kernels are
compiled afresh in each process.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

config: Any = numba.core.config

FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}
"""No division checks, multiply-add contracted. Nothing is re-associated and NaN keeps its meaning,
so a loop gives the same bits whether LLVM vectorises it or not."""


def _cache_root() -> Path:
    """The user's cache folder by each platform's custom."""
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home())))
    return Path.home() / ".cache"


def _open_cache(folder: Path) -> Path | None:
    """The cache of the kernels in one folder of sources, created; None where nothing can be
    written. Kernels call those of their own folder and of the folder above."""
    digest = hashlib.sha256(numba.__version__.encode())
    for each in dict.fromkeys((Path(__file__).parent, folder)):
        for source in sorted(each.glob("*.py")):
            digest.update(source.name.encode() + source.read_bytes())
    try:
        cache = _cache_root() / "usdsplat" / f"kernels-{digest.hexdigest()[:16]}"
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=cache):
            pass
    except (OSError, RuntimeError):  # RuntimeError: no home directory at all
        return None
    return cache


_CACHES: dict[Path, Path | None] = {}
"""Folder of sources -> where its compiled kernels are kept, or None: a property of the process."""


def cache_of(folder: Path) -> Path | None:
    """Where the compiled kernels of a folder of sources are kept, or None."""
    if folder not in _CACHES:
        _CACHES[folder] = _open_cache(folder)
    return _CACHES[folder]


CACHE = cache_of(Path(__file__).parent)
"""Where the kernels of this folder are kept, or None."""


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """njit with our cache folder, and the caller's own put back: it is one setting per process."""
    cache = cache_of(Path(function.__code__.co_filename).parent)
    before = config.CACHE_DIR
    try:
        if cache is not None:
            config.CACHE_DIR = str(cache)
        return numba.njit(cache=cache is not None, **FLAGS, **options)(function)
    finally:
        config.CACHE_DIR = before


def scalar(function: Callable[..., Any]) -> Any:
    """Mathematics of one element, inlined into the loops that call it so that they vectorise."""
    return numba.njit(forceinline=True, **FLAGS)(function)


def exact(function: Callable[..., Any]) -> Any:
    """`scalar` without contraction: the same bits in every loop that it is inlined into, and
    whether the loop was compiled by this process or loaded; for what decisions hang on."""
    return numba.njit(forceinline=True, error_model="numpy", fastmath={"nsz"})(function)


def routine(function: Callable[..., Any]) -> Any:
    """What loops call; `lanes.apart` keeps it from being inlined into them."""
    return numba.njit(**FLAGS)(function)


def serial(function: Callable[..., Any]) -> Any:
    """A loop for one thread. It does not hold the GIL."""
    return _compile(function, {"nogil": True})


def parallel(function: Callable[..., Any]) -> Any:
    """A loop for all threads of the device; `prange` marks what may run at once."""
    return _compile(function, {"nogil": True, "parallel": True})
