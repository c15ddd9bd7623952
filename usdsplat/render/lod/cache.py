"""Keep the splats of nodes of splat trees in memory, and read missing ones in threads."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass, fields

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError, UsdSplatError

THREADS = 4
"""Number of threads that read."""
MIB = 1 << 20

Result = SplatCloud | UsdSplatError


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Request:
    """Splats that are wanted."""

    read: Callable[[], SplatCloud]
    """Read them; raises a UsdSplatError if that is not possible. Other threads call it."""
    size: int
    """Bytes that they take in memory."""


@dataclass(slots=True, eq=False)
class _Entry:
    result: Result
    size: int
    used: float
    """Time of the last use [s]."""


class NodeCache:
    """Splats by key, with a limit on their memory and on the time without use.

    It may be used by several threads.

    Args:
        clock: Function that returns the time [s].
    """

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._entries: OrderedDict[Hashable, _Entry] = OrderedDict()
        self._bytes = 0
        """Sum of the sizes of the entries."""
        self._reading: dict[Hashable, Future[Result]] = {}
        self._ahead: set[Hashable] = set()
        """Keys that are read although nobody waits for them."""
        self._pool: ThreadPoolExecutor | None = None

    def __contains__(self, key: Hashable) -> bool:
        """Return whether the splats of a key are in memory."""
        return key in self._entries

    @property
    def bytes(self) -> int:
        """Bytes of all splats in memory."""
        with self._lock:
            return self._bytes

    def get(
        self,
        wanted: Mapping[Hashable, Request],
        *,
        limit: int,
        lifetime: float,
        waits: bool = True,
        keep: Collection[Hashable] = (),
    ) -> dict[Hashable, Result]:
        """Return splats, or the error of those that cannot be read.

        Others are dropped if they were not wanted for `lifetime` [s], and before that, the least
        recently used first, if all would exceed the limit.

        Args:
            wanted: What to return, by keys that stand for the content, the most urgent first.
            limit: Maximum number of bytes.
            lifetime: See above.
            waits: Whether to wait until all are read. Otherwise the result has those in memory, and
                the others are read in the meantime.
            keep: Keys of what is not dropped either.

        Raises:
            UsageError: If what is wanted exceeds the limit, or the cache is closed meanwhile.
        """
        needed = sum(each.size for each in wanted.values())
        if needed > limit:
            expected = f"at least {-(-needed // MIB)} MiB, a larger --lod-error or a --splat-budget"
            raise UsageError("--node-memory", f"{limit // MIB} MiB", expected)
        found: dict[Hashable, Result] = {}
        with self._lock:
            now = self._clock()
            for key in wanted.keys() & self._entries.keys():
                entry = self._entries[key]
                entry.used, found[key] = now, entry.result
                self._entries.move_to_end(key)
            missing = wanted.keys() - found.keys()
            self._make_room(
                {*wanted, *keep}, limit - sum(wanted[key].size for key in missing), now, lifetime
            )
            pending = {key: self._submit(key, wanted[key]) for key in wanted if key in missing}
            if not waits:
                self._ahead |= missing
                return found
            self._ahead -= missing
        for key, future in pending.items():
            try:
                found[key] = future.result()
            except CancelledError:
                raise UsageError("engine", "one that was closed", "an open one") from None
        return found

    def cancel_others(self, keys: Collection[Hashable]) -> None:
        """Cancel what nobody waits for, unless it is being read or one of `keys`."""
        with self._lock:
            for key in self._ahead - set(keys):
                future = self._reading.get(key)
                if future is None or future.cancel():
                    self._reading.pop(key, None)
                    self._ahead.discard(key)

    def close(self) -> None:
        """Drop everything and end the threads. The cache can be used again afterwards."""
        with self._lock:
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)
        with self._lock:
            self._entries.clear()
            self._bytes = 0
            self._reading.clear()
            self._ahead.clear()

    # --- private ---------------------------------------------------------------------------

    def _make_room(
        self, kept: Collection[Hashable], room: int, now: float, lifetime: float
    ) -> None:
        """Drop entries that are old, or that do not fit into `room` bytes, but those of `kept`."""
        dropped = []
        for key, entry in self._entries.items():  # the least recently used first
            if key in kept:
                continue
            if now - entry.used <= lifetime and self._bytes <= room:
                break
            dropped.append(key)
            self._bytes -= entry.size
        for key in dropped:
            del self._entries[key]

    def _submit(self, key: Hashable, request: Request) -> Future[Result]:
        """Read in a thread, unless one is reading the same."""
        if key not in self._reading:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="node")
            self._reading[key] = self._pool.submit(self._read, key, request)
        return self._reading[key]

    def _finish(self, key: Hashable) -> None:
        self._reading.pop(key, None)
        self._ahead.discard(key)

    def _read(self, key: Hashable, request: Request) -> Result:
        result: Result
        try:
            result = request.read()
            size = _size(result)
        except UsdSplatError as error:
            result, size = error, 0
        except BaseException:
            with self._lock:
                self._finish(key)
            raise
        with self._lock:
            self._finish(key)
            if (before := self._entries.pop(key, None)) is not None:
                self._bytes -= before.size
            self._bytes += size
            self._entries[key] = _Entry(result, size, self._clock())
        return result


def _size(cloud: SplatCloud) -> int:
    """Return the bytes of the arrays of a cloud."""
    arrays = (getattr(cloud, field.name) for field in fields(cloud))
    return sum(array.nbytes for array in arrays if array is not None)
