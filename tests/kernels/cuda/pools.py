"""Checks of nodes in a GPU's memory, for tests on a GPU and on the simulator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.kernels.cuda.frames import cloud_of, group_of, view_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import take
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.groups import FrameNodes
from usdsplat.kernels.cuda.frame.picture import FramePicture
from usdsplat.kernels.cuda.frame.pool import NodePool
from usdsplat.kernels.cuda.frame.project import PART
from usdsplat.kernels.fading import WHOLE

NAMES = ("positions", "rotations", "scales", "opacities", "sh")
ALL = 1 << 40
"""No limit."""


def read(device: CudaDevice, pool: NodePool, pages: Any, n: int) -> SplatCloud:
    """The splats of pages."""
    rows = np.concatenate([np.arange(PART) + PART * page for page in pages])[:n]
    arrays = zip(NAMES, pool.arrays, strict=False)
    return SplatCloud(**{name: device.fetch(array)[rows] for name, array in arrays})


def assert_same(found: SplatCloud, expected: SplatCloud) -> None:
    for name in NAMES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def check_content(device: CudaDevice, sizes: tuple[int, ...], degree: int) -> None:
    """Nodes that arrive one after the other, while the memory grows."""
    grown: list[int] = []
    pool = NodePool(device, (degree + 1) ** 2, lambda: grown.append(pool.bytes))
    clouds = [cloud_of(n, degree, seed=n) for n in sizes]
    sizes_before = []
    for count in range(1, len(clouds) + 1):
        before, size = pool.arrays[0], pool.bytes
        pages = pool.pages_of(clouds[:count], ALL)
        sizes_before += [size] if pool.arrays[0] is not before else []
        for each, cloud in zip(pages, clouds, strict=False):
            assert_same(read(device, pool, each, len(cloud)), cloud)
    assert grown == sizes_before
    taken = np.concatenate(pages)
    assert len(np.unique(taken)) == len(taken)
    assert pool.bytes >= pool.page_bytes * len(taken)
    again = pool.pages_of(clouds, ALL)
    np.testing.assert_array_equal(np.concatenate(again), taken)


def check_room(device: CudaDevice, monkeypatch: Any) -> None:
    """Four nodes of a page each, in room for three."""
    pool = NodePool(device, 1, lambda: None)
    sent: list[int] = []
    send = pool._send
    monkeypatch.setattr(
        pool, "_send", lambda some, pages: (sent.extend(map(id, some)), send(some, pages))
    )
    limit = 3 * pool.page_bytes
    clouds = [cloud_of(20 + k, seed=k) for k in range(4)]

    def ask(*numbers: int) -> list[int]:
        """Which ones are copied for these."""
        sent.clear()
        some = [clouds[k] for k in numbers]
        for each, cloud in zip(pool.pages_of(some, limit), some, strict=True):
            assert_same(read(device, pool, each, len(cloud)), cloud)
        return [k for k in range(4) if id(clouds[k]) in sent]

    assert ask(0, 1) == [0, 1]
    assert ask(2) == [2]
    assert ask(0) == []
    assert ask(3) == [3]  # in the place of 1
    assert ask(0, 2, 3) == []
    assert ask(1, 3) == [1]  # in the place of 0
    assert ask(2) == []
    assert pool.bytes == limit
    del clouds[2]  # its room is free again
    clouds.append(cloud_of(30, seed=9))
    assert ask(3) == [3]
    assert ask(1, 2) == []
    assert ask(0, 1, 2, 3) == [0]  # at once: more than the limit
    assert pool.bytes == 4 * pool.page_bytes


def check_picture(device: CudaDevice, n: int) -> None:
    """Nodes in two instances, beside a field, in one of two cuts, with the same launches."""
    cloud, field = cloud_of(n, 1, seed=4), cloud_of(n // 2, seed=5)
    cloud.positions[:, 2] = np.round(cloud.positions[:, 2], 1)  # ties
    parts = [take(cloud, np.arange(first, min(n, first + n // 3))) for first in range(0, n, n // 3)]
    shifts = np.tile(np.eye(4), (3, 1, 1))
    shifts[1, :3, 3] = -0.4, 0.1, 0.0
    shifts[2, :3, 3] = 0.3, -0.2, 0.5
    view = view_of(shifts)
    view = replace(view, cameras=np.repeat(view.cameras, 2), conversions=np.zeros((2, 14), "f4"))
    drawn = FramePicture(device)
    pool = NodePool(device, 4, drawn.release)
    pages = pool.pages_of(parts, ALL)
    for numbers in (range(len(parts)), (2, 0)):
        table = [
            (PART * page, min(PART, len(parts[k]) - PART * number), instance, WHOLE)
            for k in numbers
            for instance in (0, 1)
            for number, page in enumerate(pages[k].tolist())
        ]
        rows = np.zeros((2 * sum(map(len, pages)) + 3, 4), np.int32)
        rows[: len(table)] = table
        nodes = FrameNodes(splats=pool.arrays, instances=2, all_parts=len(rows), degree=1)
        groups = [nodes, group_of(device, field)]
        recorded = drawn._first
        found = device.fetch(drawn.draw(groups, replace(view, parts=rows))).copy()
        assert recorded in (None, drawn._first)
        some = [group_of(device, parts[k], instances=2) for k in numbers]
        order = [m for _ in numbers for m in (0, 1)] + [2]
        wide = view_of(shifts[order])
        several = replace(
            wide,
            cameras=np.repeat(wide.cameras, len(some) + 1),
            conversions=np.zeros((len(some) + 1, 14), "f4"),
        )
        other = FramePicture(device)
        wanted = device.fetch(other.draw([*some, group_of(device, field)], several))
        np.testing.assert_array_equal(found, wanted)
        assert drawn.visible == other.visible > 0
