"""Keep the splats of nodes of splat trees on a GPU, in pages of one memory.

A node is copied once. It stays until the host releases its splats, or until room is wanted for
others; the least recently used ones leave first. A page holds a PART of a node, so any free pages
hold any node, and nothing is moved.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda, int64

from usdsplat.core.cloud import I32, SplatCloud
from usdsplat.kernels.cuda.device import CudaDevice, in_words
from usdsplat.kernels.cuda.frame.project import PART
from usdsplat.kernels.cuda.jit import kernel

THREADS = 256
SENT = 1 << 12
"""Maximum number of pages that are copied at once."""
RESERVE = 4
"""One page more for each RESERVE ones is allocated, unless it exceeds the limit."""


@kernel
def scatter(sent, pages, words, target):
    """Copy pages of `words` numbers from `sent`, where they follow each other, to their places in
    `target`. Arrays are flat.

    pages: place of each page, i32.
    """
    item = int64(cuda.grid(1))
    if item < pages.shape[0] * words:
        target[int64(pages[item // words]) * words + item % words] = sent[item]


class NodePool:
    """Splats of nodes on one GPU, whose harmonics have the same number of coefficients.

    The memory grows as needed, and is released with the pool.

    Args:
        coefficients: Number of coefficients of the harmonics.
        before_growth: Called before the memory grows, to release the present arrays, which would
            otherwise need memory beside the new ones.
    """

    def __init__(
        self, device: CudaDevice, coefficients: int, before_growth: Callable[[], None]
    ) -> None:
        self._device, self._stream = device, device.stream
        self._before_growth = before_growth
        self._shapes: tuple[tuple[int, ...], ...] = ((3,), (4,), (3,), (), (coefficients, 3))
        self._words = [PART * int(np.prod(shape)) for shape in self._shapes]
        self._held: OrderedDict[int, tuple[weakref.ref[Any], I32]] = OrderedDict()
        """id(positions) -> reference to the positions, and the pages; least recently used first."""
        self._gone: deque[tuple[int, weakref.ref[Any]]] = deque()
        """Entries of `_held` whose positions were released."""
        self._free: list[int] = []
        self._capacity = 0
        self._arrays: tuple[Any, ...] = tuple(
            device.resident((0, *shape), np.float32) for shape in self._shapes
        )
        self._rows = device.resident(0, np.int32)
        self._here: Any = None
        """Pinned memory of the host, whose copy to the GPU ends with `_copied`."""
        self._copied = cuda.event()

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The splats of all pages, as `load.load_floats` takes them. They are other arrays after
        the memory has grown."""
        return *self._arrays, self._rows

    @property
    def page_bytes(self) -> int:
        """Bytes of a page."""
        return 4 * sum(self._words)

    @property
    def bytes(self) -> int:
        """Bytes of all pages."""
        return self._capacity * self.page_bytes

    def pages_of(self, clouds: Sequence[SplatCloud], limit: int) -> list[I32]:
        """Return the pages of clouds, after copying those that are not there. Page k holds the
        splats from k * PART on.

        Args:
            limit: Bytes above which clouds that are not asked for leave first.

        Raises:
            BackendError: If the GPU has too little memory.
        """
        self._forget_gone()
        wanted = {id(each.positions): each for each in clouds}
        missing = {key: each for key, each in wanted.items() if key not in self._held}
        for key in wanted.keys() - missing.keys():
            self._held.move_to_end(key)
        asked = sum(map(_page_count, missing.values()))
        there = sum(len(self._held[key][1]) for key in wanted.keys() - missing.keys())
        if asked > len(self._free):
            self._make_room(asked, there, wanted, limit // self.page_bytes)
        for key, cloud in missing.items():
            count = _page_count(cloud)
            pages = np.array(self._free[len(self._free) - count :][::-1], np.int32)
            del self._free[len(self._free) - count :]
            self._held[key] = self._reference(key, cloud), pages
        self._copy(list(missing.values()), [self._held[key][1] for key in missing])
        return [self._held[id(each.positions)][1] for each in clouds]

    # --- private ---------------------------------------------------------------------------

    def _reference(self, key: int, cloud: SplatCloud) -> weakref.ref[Any]:
        gone = self._gone
        return weakref.ref(cloud.positions, lambda reference: gone.append((key, reference)))

    def _forget_gone(self) -> None:
        """Free the pages of splats that the host released. Other threads may release more."""
        while self._gone:
            key, reference = self._gone.popleft()
            found = self._held.get(key)
            if found is not None and found[0] is reference:
                self._leave(key)

    def _leave(self, key: int) -> None:
        _, pages = self._held.pop(key)
        self._free += pages.tolist()[::-1]

    def _make_room(self, asked: int, there: int, wanted: dict[int, Any], most: int) -> None:
        """Have `asked` free pages: allocate up to `most`, or as many as are needed at once, and let
        others leave.

        Args:
            there: Number of pages of `wanted` that are there.
        """
        needed = self._capacity - len(self._free) + asked
        size = max(min(needed + needed // RESERVE, most), there + asked)
        if size > self._capacity:
            self._grow(size)
        for key in list(self._held):
            if len(self._free) >= asked:
                break
            if key not in wanted:
                self._leave(key)

    def _grow(self, pages: int) -> None:
        self._before_growth()
        old, rows = deque(self._arrays), self._capacity * PART
        self._arrays = ()
        for shape in self._shapes:
            new = self._device.resident((pages * PART, *shape), np.float32)
            if rows:
                with in_words():
                    new[:rows].copy_to_device(old[0], stream=self._stream)
            old.popleft()
            self._arrays = *self._arrays, new
        self._free = [*range(pages - 1, self._capacity - 1, -1), *self._free]
        self._capacity = pages

    def _copy(self, clouds: Sequence[SplatCloud], places: Sequence[I32]) -> None:
        """Copy clouds to their pages, several at once."""
        first = 0
        while first < len(clouds):
            end, count = first + 1, len(places[first])
            while end < len(clouds) and count + len(places[end]) <= SENT:
                count += len(places[end])
                end += 1
            self._send(clouds[first:end], np.concatenate(places[first:end]))
            first = end

    def _send(self, clouds: Sequence[SplatCloud], pages: I32) -> None:
        count = len(pages)
        ends = np.cumsum([count, *(count * words for words in self._words)]).tolist()
        here = self._pinned(ends[-1])
        here[:count] = pages.view(np.float32)
        for part, (first, end) in enumerate(pairwise(ends)):
            rows, at = here[first:end].reshape(count * PART, -1), 0
            for cloud in clouds:
                array = (cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh)
                n = len(cloud)
                rows[at : at + n] = array[part].reshape(n, -1)
                at += _page_count(cloud) * PART
        with in_words():
            there = self._device.borrow("sent nodes", ends[-1], np.float32)
            there[: ends[-1]].copy_to_device(here, stream=self._stream)
            self._copied.record(self._stream)
            placed = there[:count].view(np.int32)
            for target, words, (first, end) in zip(
                self._arrays, self._words, pairwise(ends), strict=True
            ):
                scatter[-(-(end - first) // THREADS), THREADS, self._stream](
                    there[first:end], placed, words, target.reshape(target.size)
                )

    def _pinned(self, size: int) -> npt.NDArray[np.float32]:
        """Return pinned memory of the host, after what it held was copied."""
        with in_words():
            if self._here is None or self._here.size < size:
                self._here = cuda.pinned_array(size, np.float32)
            else:
                self._copied.synchronize()
        found: npt.NDArray[np.float32] = self._here[:size]
        return found


def _page_count(cloud: SplatCloud) -> int:
    return -(-len(cloud) // PART)
