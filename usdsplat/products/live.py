"""Frames of a running simulation, kept as values until they are drawn or authored.

A simulation puts frames in from its thread; a picture takes the one of its time, whose arrays the
engine draws without a way through USD; and whoever needs them on the stage takes them all.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.live_clouds import LiveClouds

ARRAYS = ("positions", "rotations", "scales", "opacities", "sh", "ids")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LiveFrame:
    """Clouds of one frame, and the memory that they take beside the frame before."""

    live: LiveClouds
    bytes: int


class LiveHistory:
    """The frames that are not on the stage yet, oldest first; used by several threads.

    Args:
        rest: The captures by path, whose arrays do not count as memory of frames.
    """

    def __init__(self, rest: Mapping[str, SplatCloud]) -> None:
        self._frames: deque[LiveFrame] = deque()
        self._guard = threading.Lock()
        self._last = dict(rest)

    @property
    def times(self) -> tuple[float, ...]:
        """Times of the frames [time code]."""
        with self._guard:
            return tuple(each.live.time for each in self._frames)

    @property
    def bytes(self) -> int:
        """Memory of the frames [byte]."""
        with self._guard:
            return sum(each.bytes for each in self._frames)

    def put(self, live: LiveClouds) -> None:
        """Add the next frame. Arrays that it shares with the frame before, or has from the capture,
        do not count as its memory."""
        size = sum(_added(self._last.get(path), each) for path, each in live.clouds.items())
        self._last = dict(live.clouds)
        with self._guard:
            self._frames.append(LiveFrame(live=live, bytes=size))

    def at(self, time: float | None) -> LiveClouds | None:
        """Return the frame of a time; None if there is none."""
        with self._guard:
            found = (each.live for each in reversed(self._frames) if each.live.time == time)
            return next(found, None)

    def take(self) -> Iterator[LiveFrame]:
        """Yield all frames, oldest first, and release each."""
        while True:
            with self._guard:
                if not self._frames:
                    return
                frame = self._frames.popleft()
            yield frame

    def forget(self) -> None:
        """Release the oldest frame."""
        with self._guard:
            self._frames.popleft()


def _added(before: SplatCloud | None, cloud: SplatCloud) -> int:
    """Return the bytes of the arrays that are not those of the frame before."""
    found: int = 0
    for name in ARRAYS:
        array: npt.NDArray[Any] | None = getattr(cloud, name)
        if array is not None and not (before is not None and array is getattr(before, name)):
            found += np.asarray(array).nbytes
    return found
