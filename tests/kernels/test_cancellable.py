"""Tests of launches in parts: they have the bits of whole ones, and end between any two parts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.everything import CASES, drawn
from tests.render.rendering import lens, random_cloud, random_transform, scene_of, view_of
from usdsplat.core.cancel import Cancelled, CancelToken
from usdsplat.kernels import cancellable, light_lanes, sort
from usdsplat.kernels.cancellable import CancellableCpu
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.launch import Kernel
from usdsplat.kernels.lighting import illuminate
from usdsplat.kernels.project import BLOCK
from usdsplat.render.renderer import Renderer
from usdsplat.render.settings import RenderSettings
from usdsplat.render.spatial_order import LEAST


class Count(CancelToken):
    """Counts the questions, and cancels after some of them."""

    def __init__(self, most: int = 1 << 30) -> None:
        super().__init__()
        self.asked, self.most = 0, most

    def check(self) -> None:
        self.asked += 1
        if self.asked > self.most:
            self.cancel()
        super().check()


@pytest.fixture
def small(monkeypatch):
    """The smallest parts."""
    for name in ("BLOCKS", "TILES", "ROWS"):
        monkeypatch.setattr(cancellable, name, 1)


@pytest.mark.parametrize("name", CASES)
def test_parts_of_a_picture_have_the_bits_of_the_whole(small, name):
    """Oracle: the plain device. All AOVs and settings, with surfaces, crops, trees and holdouts."""
    case, token = CASES[name], Count()
    device = CancellableCpu(CpuDevice(threads=1), token)
    ours = drawn(device, case, size=(90, 70), splats=150)
    theirs = drawn(CpuDevice(threads=1), case, size=(90, 70), splats=150)
    assert token.asked > 30
    for each, array in theirs.items():
        np.testing.assert_array_equal(ours[each], array, err_msg=each)


def pictures(device, count=3):
    """Views of two instances of a field of many blocks, which is ordered from the third on."""
    cloud = random_cloud(4, n=LEAST + BLOCK // 2)
    scene = scene_of((cloud, np.eye(4)), (cloud, random_transform(2)))
    eye, renderer = lens(), Renderer(device)
    for k in range(count):
        settings = RenderSettings(splat_budget=0 if k else 2 * LEAST)
        eye.world_to_camera[0, 3] = 0.1 * k
        view = view_of(eye)
        (band,) = renderer.render(scene, view, settings, ("color", "depth"))
        yield band.arrays["color"].copy(), band.arrays["depth"].copy()


@pytest.mark.parametrize("most", [1, 3, 1 << 20])
def test_blocks_of_a_large_field_are_projected_a_few_at_a_time(small, monkeypatch, most):
    """Oracle: the plain device, before and after the field is ordered in memory."""
    monkeypatch.setattr(cancellable, "BLOCKS", most)
    token = Count()
    ours = list(pictures(CancellableCpu(CpuDevice(threads=1), token)))
    for found, expected in zip(ours, pictures(CpuDevice(threads=1)), strict=True):
        for ours_of, theirs_of in zip(found, expected, strict=True):
            np.testing.assert_array_equal(ours_of, theirs_of)


def test_nothing_is_launched_after_a_token_is_cancelled(small):
    """Oracle: counted: the question that raises is the last one."""
    whole = Count()
    list(pictures(CancellableCpu(CpuDevice(threads=1), whole), 1))
    assert whole.asked > 2 * LEAST // BLOCK
    for most in (0, whole.asked // 3, whole.asked - 1):
        token = Count(most)
        with pytest.raises(Cancelled):
            list(pictures(CancellableCpu(CpuDevice(threads=1), token), 1))
        assert token.asked == most + 1


def test_parts_need_no_further_compiled_kernels(small):
    """Oracle: Numba's list of compiled forms, after whole launches and after those in parts."""
    case = CASES["rays and surfaces"]
    forms = []
    for device in (CpuDevice(threads=1), CancellableCpu(CpuDevice(threads=1), CancelToken())):
        list(pictures(device))
        drawn(device, case, size=(90, 70), splats=150)
        loops = (each for kernel in cancellable.PARTS for each in loops_of(kernel))
        forms.append([len(each.signatures) for each in loops])
    assert forms[0] == forms[1] and all(forms[0])


def test_a_depth_sort_ends_between_its_steps():
    """Oracle: counted: once before the sort, and before both steps of each of its three passes."""
    count, chunks = 1000, 3
    keys = np.random.default_rng(2).random(count, dtype=np.float32) * 1e9
    work = np.empty((2, count), np.uint32), np.empty((2, count), np.int32)
    histogram = np.empty((chunks, sort.DIGITS), np.int64)
    visible = np.arange(count, dtype=np.int32)
    token = Count()
    device = CancellableCpu(CpuDevice(threads=1), token)
    half = device.run(sort.depth_order, visible, count, keys, chunks, work, histogram)
    np.testing.assert_array_equal(work[1][half], np.argsort(keys, kind="stable"))
    assert token.asked == 7


@pytest.mark.parametrize("rows", [1, 7, 1000])
def test_splats_of_equal_depth_are_sorted_in_one_part(monkeypatch, rows):
    """Oracle: the whole launch, of runs of equal keys that are longer than a part."""
    monkeypatch.setattr(cancellable, "ROWS", rows)
    rng = np.random.default_rng(3)
    bits = np.sort(rng.integers(0, 40, 500).astype(np.uint32))
    slots, sources = rng.permutation(500).astype(np.int32), rng.permutation(500).astype(np.int32)
    firsts, found = np.array([0, 200, 350]), []
    token = Count()
    for device in (CpuDevice(threads=1), CancellableCpu(CpuDevice(threads=1), token)):
        found.append(slots.copy())
        device.run(sort.settle, bits, found[-1], 500, sources, firsts, np.empty(500, np.int64))
    np.testing.assert_array_equal(found[1], found[0])
    assert (found[0] != slots).any() and token.asked >= min(40, 500 // rows)


def loops_of(kernel):
    """The compiled loops of a kernel."""
    if kernel is light_lanes.shine:
        several = light_lanes.locate, light_lanes.group, light_lanes.pass_tiles, illuminate
        return [loop for each in several for loop in loops_of(each)]
    return kernel._loops.values() if isinstance(kernel, Kernel) else (kernel,)
