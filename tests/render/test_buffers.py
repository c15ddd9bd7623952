"""Tests of buffers that grow and are reused."""

from __future__ import annotations

import numpy as np

from usdsplat.render.buffers import Buffer, BufferGroup, KernelBuffers, LentMemory, Sizes
from usdsplat.render.frame_buffers import FrameBuffers


class Splats(BufferGroup):
    """Two buffers."""

    rows = Buffer(lambda slots: (slots, 3), np.float32, touched=lambda visible: (visible, 3))
    found = Buffer(lambda blocks: (blocks,), np.int32)


class Lists(KernelBuffers):
    """One declared buffer."""

    PREFIX = "surface "

    starts = Buffer(lambda pairs: (pairs + 1,), np.int64)


def test_sizes_follow_from_the_declaration() -> None:
    """Oracle: elements times bytes, by hand."""
    sizes = Sizes(slots=100, visible=10, blocks=7)
    assert Splats.rows.nbytes(sizes) == 1200
    assert Splats.rows.touched_bytes(sizes) == 120
    assert Splats.found.nbytes(sizes) == Splats.found.touched_bytes(sizes) == 28


def test_memory_is_used_again_and_grows() -> None:
    """Oracle: what was asked of the allocator."""
    asked = []

    def empty(size: int, dtype: np.dtype) -> np.ndarray:
        asked.append((size, dtype))
        return np.empty(size, dtype)

    splats = Splats(empty)
    first = splats.rows(4)
    assert (first.shape, first.dtype, asked) == ((4, 3), np.float32, [(12, np.float32)])
    assert np.shares_memory(splats.rows(2), first) and np.shares_memory(splats.rows(4), first)
    assert len(asked) == 1
    assert splats.rows(5).shape == (5, 3) and asked[1:] == [(15, np.float32)]
    assert splats.allocated() == {"rows": 60}
    for _ in range(3):
        assert splats.rows(0).shape == (0, 3)
    assert asked[2:] == [(0, np.float32)]


def test_contents_are_forgotten_with_the_memory() -> None:
    """Oracle: the definition of `content`."""
    splats = Splats(np.empty)
    splats.rows(4)
    splats.rows.content = "four"
    splats.rows(0), splats.rows(3)
    assert splats.rows.content == "four"
    splats.rows(5)
    assert splats.rows.content is None


def test_two_groups_share_nothing() -> None:
    """Oracle: addresses."""
    first, second = Splats(np.empty), Splats(np.empty)
    assert not np.shares_memory(first.rows(3), second.rows(3))


def test_lent_memory_is_used_again_once_nothing_refers_to_it() -> None:
    """Oracle: addresses; what was allocated."""
    asked = []

    def empty(size: int, dtype: np.dtype) -> np.ndarray:
        asked.append(size)
        return np.empty(size, dtype)

    lent = LentMemory(empty)
    first = lent.take(100)
    assert (first.shape, first.dtype, first.flags.writeable) == ((100,), np.float32, True)
    address, part = first.ctypes.data, first[40:80].reshape(8, 5)[2]
    part[:] = 7
    del first  # a part of it remains
    second = lent.take(100)
    second[:] = 3
    assert not np.shares_memory(part, second) and (part == 7).all()
    del part
    third = lent.take(120)
    assert third.ctypes.data == address and not np.shares_memory(third, second)
    assert asked == [0, 150, 150]
    del second, third
    assert len(lent.take(200)) == 200 and asked[3:] == [300]
    assert len(lent.take(0)) == 0


def test_memory_outlives_who_lent_it() -> None:
    """Oracle: numbers written before."""
    lent = LentMemory(np.empty)
    kept = lent.take(1000)
    kept[:] = 5
    del lent
    others = [np.full(1000, 1, np.float32) for _ in range(20)]
    assert (kept == 5).all() and len(others) == 20


def test_kernels_get_declared_and_other_buffers_by_name() -> None:
    """Oracle: names and bytes of what is allocated."""
    lists = Lists(np.empty)
    starts = lists.get("surface starts", (5,), np.int64)
    assert starts is not None and np.shares_memory(lists.starts(4), starts)
    assert lists.get("keys uint16", (3,), np.uint16).dtype == np.uint16
    assert lists.allocated() == {"starts": 40, "keys_uint16": 6}


def test_every_group_of_a_frame_is_there() -> None:
    """Oracle: the annotations."""
    buffers = FrameBuffers(np.empty)
    for name, group in FrameBuffers.groups().items():
        assert type(getattr(buffers, name)) is group and group.declared()
    assert buffers.allocated() == {}
