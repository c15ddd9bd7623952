"""Draw one colour picture of splats: the order of the launches, and their buffers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice, in_words
from usdsplat.kernels.cuda.frame import blend, order, project, tiles
from usdsplat.kernels.cuda.frame.graph import record
from usdsplat.kernels.cuda.frame.groups import FrameGroup, FrameNodes, FrameView
from usdsplat.kernels.cuda.ties import MERGERS, MERGING, TIES
from usdsplat.kernels.project import RECORD

THREADS = 256
WAVES = 132 * 16
"""Number of blocks that fills any GPU; loops process the remaining items."""
STEPS = 8
"""Number of sizes between successive powers of two for which a sort is recorded."""
LEAST = 1 << 12
"""Smallest such size."""
KEPT = 8
"""Number of recorded second halves that are kept."""
ALIGNED = 256
"""Alignment of each array of a view [byte]."""
ROOM = 1 << 18
"""Initial capacity of records."""

TOTALS = 5
"""Number of counters of a picture: splats; pairs; splats of many tiles; 1 if there are too many
pairs; long runs."""


class FramePicture:
    """Fused rendering of pictures on one device, which keeps its buffers between them."""

    def __init__(self, device: CudaDevice) -> None:
        self._device, self._stream = device, device.stream
        self._primitives = device.primitives
        """Recorded launches use its memory, even after the device is closed."""
        self._key: tuple[Any, ...] = ()
        self._groups: tuple[FrameGroup | FrameNodes, ...] = ()
        self._buffers: dict[str, Any] = {}
        self._first: Callable[[], None] | None = None
        self._second: dict[tuple[int, int], Callable[[], None]] = {}
        self._sent: tuple[Any, Any] = (None, None)
        self._staged: tuple[tuple[Any, ...], ...] = ()
        self._room = 0
        self._totals = cuda.pinned_array(TOTALS, np.int32)
        self._counted = cuda.event()
        self._guess: tuple[int, int] | None = None
        self.visible, self.pairs = 0, 0
        """Number of visible splats, and of pairs of splat and tile, in the last picture."""
        self.waited = 0.0
        """Time that the host has waited for the two numbers so far [s]."""

    def draw(self, groups: Sequence[FrameGroup | FrameNodes], view: FrameView) -> Any:
        """Draw a picture. The image stays on the device and is valid until the next picture.

        The second half is launched before its two numbers are known, with those of the last
        picture. It is launched again if they were too small.

        Returns:
            Premultiplied colour and coverage, shape (height, width, 4) f32; None if there are more
            than MOST_PAIRS pairs of splat and tile.

        Raises:
            BackendError: If the GPU's driver or compiler fails.
        """
        with in_words():
            return self._draw(groups, view)

    def _draw(self, groups: Sequence[FrameGroup | FrameNodes], view: FrameView) -> Any:
        self._adopt(tuple(groups), view)
        for array, (host, _) in zip(view.arrays, self._staged, strict=True):
            host[...] = array
        while True:
            self._begin()
            self._counted.record(self._stream)
            guess = self._guess
            if guess is not None:
                self._finish(*guess)
            asked = time.perf_counter()
            self._counted.synchronize()
            self.waited += time.perf_counter() - asked
            self.visible, self.pairs = int(self._totals[0]), int(self._totals[1])
            if self.visible <= self._room:
                break
            self._grow(self.visible)
        if self._totals[3]:
            self._guess = None
            return None
        size = min(size_of(self.visible), self._room), size_of(self.pairs)
        if guess is None or size[0] > guess[0] or size[1] > guess[1]:
            self._finish(*size)
        elif 2 * size[0] > guess[0] and 2 * size[1] > guess[1]:
            size = guess  # use recorded launches that are not much too large
        self._guess = size
        return self._buffers["image"]

    @property
    def bytes(self) -> int:
        """Size of the buffers on the device without splats [byte]."""
        return sum(int(array.nbytes) for array in self._buffers.values())

    def release(self) -> None:
        """Release the arrays of the groups, and the recorded launches that contain their
        addresses."""
        self._key, self._groups = (), ()
        self._forget()

    # --- buffers of the scene --------------------------------------------------------------

    def _adopt(self, groups: tuple[FrameGroup | FrameNodes, ...], view: FrameView) -> None:
        """Allocate buffers for new fields or a new size of the picture."""
        grid = view.grid[0]
        width, height = int(grid["x1"] - grid["x0"]), int(grid["y1"] - grid["y0"])
        own = tuple(group.key for group in groups)
        key = (own, width, height, int(grid["columns"]), int(grid["rows"]))
        if key == self._key:
            return
        self._key, self._groups = key, groups  # the groups' arrays stay alive, and so their ids
        self._forget()
        self._columns, tile_count = int(grid["columns"]), int(grid["columns"] * grid["rows"])
        self._tile_count = tile_count
        self._parts = sum(group.all_parts for group in groups)
        self._stage(view)
        self._get("image", (height, width, 4), np.float32)
        self._get("starts", (tile_count + 1,), np.int32)
        blocks = max(1, sum(group.all_blocks for group in groups))
        self._get("closed", (blocks,), np.uint8)
        self._buffers["closed"].copy_to_device(np.zeros(blocks, np.uint8), self._stream)
        self._get("marks", (self._parts * project.WORDS,), np.uint32)
        for name in ("found", "sums"):
            self._get(name, (self._parts + 1,), np.int32)
        self._buffers["found"].copy_to_device(np.zeros(self._parts + 1, np.int32), self._stream)
        self._get("totals", (TOTALS,), np.int32)
        self._get("span", (2,), np.float32)
        if not self._room:
            self._grow(min(ROOM, self._parts * project.PART))

    def _stage(self, view: FrameView) -> None:
        """Allocate one buffer for the values that change from picture to picture, which is copied
        at once."""
        sizes = [-(-array.nbytes // ALIGNED) * ALIGNED for array in view.arrays]
        ends = np.cumsum(sizes)
        host = cuda.pinned_array(int(ends[-1]), np.uint8)
        there = self._empty((int(ends[-1]),), np.uint8)
        staged = []
        for array, end, size in zip(view.arrays, ends, sizes, strict=True):
            part = slice(int(end - size), int(end - size) + array.nbytes)
            staged.append(
                tuple(each[part].view(array.dtype).reshape(array.shape) for each in (host, there))
            )
        self._sent, self._staged = (host, there), tuple(staged)

    def _grow(self, visible: int) -> None:
        """Allocate buffers for a number of records, with a reserve."""
        self._forget()
        self._room = size_of(visible + visible // 8)
        for name in ("records", "keys", "rows", "counts", "numbers", "names"):
            self._buffers.pop(name, None)
        self._get("records", (self._room * RECORD,), np.float32)
        self._get("keys", (self._room,), np.float32)
        self._get("names", (self._room,), np.int64)
        for name in ("rows", "counts", "numbers"):
            self._get(name, (self._room,), np.int32)
        numbers = np.arange(self._room, dtype=np.int32)
        self._buffers["numbers"].copy_to_device(numbers, self._stream)

    def _forget(self) -> None:
        """Drop the recorded launches, which contain addresses, when a buffer moves."""
        self._first = self._guess = None
        self._second.clear()

    # --- a picture -------------------------------------------------------------------------

    def _begin(self) -> None:
        """Launch the first half, up to the two numbers."""
        if self._first is None:
            self._first = record(self._stream, self._see)
        else:
            self._first()

    def _see(self) -> None:
        b, stream = self._buffers, self._stream
        self._sent[1].copy_to_device(self._sent[0], stream)
        cameras, matrices, sights, conversions, grid, table = (there for _, there in self._staged)
        first = instance = block = row = 0
        spans: list[tuple[int, FrameGroup | FrameNodes, int, int, Any]] = []
        for number, group in enumerate(self._groups):
            if isinstance(group, FrameNodes):
                parts: Any = table[row : row + group.all_parts]
                see, count, row = project.SEE_NODES, 0, row + group.all_parts
            else:
                parts, see, count = group.parts, project.SEE[group.is_packed], group.count
                if group.boxes.shape[0]:
                    project.cull[_blocks(group.all_blocks), THREADS, stream](
                        cameras, matrices, number, instance, group.instances, block, group.boxes,
                        b["closed"],
                    )  # fmt: skip
            see[group.all_parts, project.PART, stream](
                cameras, matrices, number, instance, first, block, parts, count, b["closed"],
                group.splats, b["marks"], b["found"], b["totals"], b["span"],
            )  # fmt: skip
            spans.append((number, group, instance, first, parts))
            first, instance = first + group.all_parts, instance + group.instances
            block += group.all_blocks
        self._primitives.running_sum(b["found"], b["sums"], self._parts + 1)
        for number, group, instance, first, parts in spans:
            place = project.PLACE_NODES
            if isinstance(group, FrameGroup):
                place = project.PLACE[group.is_packed, group.degree > 0]
            place[group.all_parts, project.PART, stream](
                cameras, matrices, sights, conversions, number, instance, first, parts,
                group.degree, group.splats, b["marks"], b["found"], b["sums"],
                self._room, b["records"], b["keys"], b["rows"], b["names"],
                b["span"], b["totals"],
            )  # fmt: skip
        tiles.count[WAVES, THREADS, stream](b["totals"], grid, b["records"], b["counts"])
        b["totals"].copy_to_host(self._totals, stream)

    def _finish(self, m: int, p: int) -> None:
        """Launch the second half, with capacity for m splats and p pairs."""
        size = m, p
        if size in self._second:
            self._second[size]()
            return
        self._make_lists(m, p)
        if len(self._second) >= KEPT:
            self._second.pop(next(iter(self._second)))
        variant = blend.variant(self.pairs, self.visible, math.prod(self._key[1:3]))
        self._second[size] = record(self._stream, lambda: self._lists_and_image(m, p, variant))

    def _make_lists(self, m: int, p: int) -> None:
        """Allocate the buffers of the second half. Drop all recorded launches if one moves."""
        tile_type = np.uint16 if self._tile_count < 1 << 16 else np.uint32
        shapes = {
            "narrow": (m, np.uint32), "sorted narrow": (m, np.uint32),
            "order": (m, np.int32), "settled": (m, np.int32),
            "ordered counts": (m + 1, np.int32), "places": (m + 1, np.int32),
            "tiles": (p, tile_type), "sorted tiles": (p, tile_type),
            "pairs": (p, np.int32), "sorted pairs": (p, np.int32),
            "crowded": (m, np.int32), "long runs": (m // TIES + 1, np.int32),
        }  # fmt: skip
        before = {name: id(self._buffers.get(name)) for name in shapes}
        for name, (size, dtype) in shapes.items():
            self._get(name, (size,), dtype, exactly=False)
        if any(id(self._buffers[name]) != before[name] for name in shapes):
            self._second.clear()

    def _lists_and_image(self, m: int, p: int, variant: tuple[int, bool]) -> None:
        b, stream, primitives = self._buffers, self._stream, self._primitives
        grid, totals = self._staged[4][1], b["totals"]
        pair_tiles, pair_splats = b["tiles"][:p], b["pairs"][:p]
        bits = order.bits_of(m)
        order.narrow[_blocks(m), THREADS, stream](
            totals,
            b["keys"].view(np.uint32)[:m],
            b["span"].view(np.uint32),
            bits,
            b["narrow"][:m],
        )
        primitives.sort_pairs(
            b["narrow"], b["numbers"], b["sorted narrow"], b["order"], m, end_bit=bits
        )
        ties = (
            totals, b["sorted narrow"][:m], b["order"], b["keys"], b["names"], b["counts"],
            b["settled"], b["ordered counts"][: m + 1], b["long runs"],
        )  # fmt: skip
        order.settle_ties[_blocks(m + 1), THREADS, stream](*ties)
        order.settle_long[MERGING, MERGERS, stream](*ties)
        primitives.running_sum(b["ordered counts"], b["places"], m + 1)
        nothing = self._tile_count
        lists = (
            totals, grid, b["records"], b["settled"], b["places"][: m + 1], self._columns, nothing,
            pair_tiles, pair_splats, b["crowded"],
        )  # fmt: skip
        tiles.fill[_blocks(m), THREADS, stream](*lists)
        tiles.fill_many[WAVES, THREADS, stream](*lists)
        primitives.sort_pairs(
            b["tiles"], b["pairs"], b["sorted tiles"], b["sorted pairs"], p,
            end_bit=nothing.bit_length(),
        )  # fmt: skip
        tiles.bound[_blocks(nothing + 1), THREADS, stream](totals, b["sorted tiles"], b["starts"])
        kernel, threads = blend.make_blend(*variant)
        kernel[self._tile_count, threads, stream](
            grid, b["starts"], b["sorted pairs"], b["records"], b["image"]
        )

    # --- buffers ---------------------------------------------------------------------------

    def _get(self, name: str, shape: tuple[int, ...], dtype: Any, *, exactly: bool = True) -> Any:
        """Return the buffer `name`, allocated again if it does not fit."""
        found = self._buffers.get(name)
        fits = found is not None and (
            found.dtype == np.dtype(dtype)
            and (found.shape == shape if exactly else found.shape[0] >= shape[0])
        )
        if not fits:
            self._buffers.pop(name, None)
            self._buffers[name] = self._empty(shape, dtype)
        return self._buffers[name]

    def _empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return self._device.resident(shape, dtype)


def size_of(count: int) -> int:
    """Return the next size for which launches are recorded, at least `count`."""
    if count <= LEAST:
        return LEAST
    step = 1 << (count.bit_length() - 1 - int(math.log2(STEPS)))
    return -(-count // step) * step


def _blocks(count: int) -> int:
    return -(-count // THREADS)
