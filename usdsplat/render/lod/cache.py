"""Keep the splats of nodes of splat trees in memory, and read missing ones in threads."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from types import MappingProxyType

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
        """Keys of the reads whose results no caller waits for."""
        self._dropped: set[Hashable] = set()
        """Keys of the reads whose results are not kept."""
        self.most: int | None = None
        """Maximum number of bytes of what is kept beside what a call wants; None for its limit."""
        self.reads = 0
        """Number of finished reads whose results no caller waited for."""
        self.on_read: Callable[[], None] = lambda: None
        """Called after each of these, by the thread that read."""
        self._pool: ThreadPoolExecutor | None = None

    def __contains__(self, key: Hashable) -> bool:
        """Return whether the splats of a key are in memory."""
        return key in self._entries

    @property
    def is_reading(self) -> bool:
        """Whether any read is running or waits for a thread."""
        return bool(self._reading)

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
        ahead: Mapping[Hashable, Request] = MappingProxyType({}),
    ) -> dict[Hashable, Result]:
        """Return splats, or the error of those that cannot be read.

        Others are dropped if they were not wanted for `lifetime` [s], and before that, the least
        recently used first, if all would exceed the limit.

        Args:
            wanted: What to return, by keys that stand for the content, the most urgent first.
            limit: Maximum number of bytes of `wanted`, and of what is kept beside both.
            lifetime: See above.
            ahead: What to read without waiting for it, or to keep, in the same form. What an
                earlier call left to read is cancelled, unless it is being read.

        Raises:
            UsageError: If what is wanted exceeds the limit, or the cache is closed meanwhile.
        """
        check_limit(wanted.values(), limit)
        found: dict[Hashable, Result] = {}
        with self._lock:
            now = self._clock()
            for key in (wanted.keys() | ahead.keys()) & self._entries.keys():
                entry = self._entries[key]
                entry.used = now
                self._entries.move_to_end(key)
                if key in wanted:
                    found[key] = entry.result
            self._cancel_ahead()
            missing = {key: each for key, each in wanted.items() if key not in found}
            later = {key: each for key, each in ahead.items() if key not in self._entries}
            coming = sum(each.size for each in (later | missing).values())
            most = limit if self.most is None else min(limit, self.most)
            self._make_room({*wanted, *ahead}, most - coming, now, lifetime)
            self._ahead -= missing.keys()
            self._dropped -= wanted.keys() | ahead.keys()
            pending = {key: self._submit(key, each) for key, each in missing.items()}
            for key, each in later.items():
                if key not in self._reading:
                    self._submit(key, each)
                    self._ahead.add(key)
        for key, future in pending.items():
            try:
                found[key] = future.result()
            except CancelledError:
                raise UsageError("engine", "one that was closed", "an open one") from None
        return found

    def drop(self, is_dropped: Callable[[Hashable], bool]) -> None:
        """Drop the splats of some keys, also those that are being read."""
        with self._lock:
            for key in [key for key in self._entries if is_dropped(key)]:
                self._bytes -= self._entries.pop(key).size
            for key in [key for key in self._reading if is_dropped(key)]:
                if key in self._ahead and self._reading[key].cancel():
                    self._finish(key)
                else:
                    self._dropped.add(key)

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
            self._dropped.clear()

    # --- private ---------------------------------------------------------------------------

    def _cancel_ahead(self) -> None:
        """Cancel the reads that have not begun and whose results no caller waits for."""
        for key in list(self._ahead):
            if self._reading[key].cancel():
                self._finish(key)

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
        self._dropped.discard(key)

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
            is_ahead = key in self._ahead
            is_kept = key not in self._dropped
            self._finish(key)
            if (before := self._entries.pop(key, None)) is not None:
                self._bytes -= before.size
            if is_kept:
                self._bytes += size
                self._entries[key] = _Entry(result, size, self._clock())
            self.reads += is_ahead
        if is_ahead:
            self.on_read()
        return result


def check_limit(wanted: Iterable[Request], limit: int) -> None:
    """Raise a UsageError if splats exceed a limit of memory [byte]."""
    needed = sum(each.size for each in wanted)
    if needed > limit:
        expected = f"at least {-(-needed // MIB)} MiB, a larger --lod-error or a --splat-budget"
        raise UsageError("--node-memory", f"{limit // MIB} MiB", expected)


def _size(cloud: SplatCloud) -> int:
    """Return the bytes of the arrays of a cloud."""
    arrays = (getattr(cloud, field.name) for field in fields(cloud))
    return sum(array.nbytes for array in arrays if array is not None)
