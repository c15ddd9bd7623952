"""Tests of a GPU that fails while it draws."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.rendering import lens, random_cloud, scene_of, settings_of, view_of
from usdsplat.core.errors import BackendError
from usdsplat.kernels.device import CpuDevice
from usdsplat.render.deep_memory import DeepSize
from usdsplat.render.renderer import Renderer

AOVS = ("color", "depth", "elementId")
SAID = "device cuda: found CudaAPIError (too hot), expected a GPU that works"


class Failing(CpuDevice):
    """What is called a GPU, computes as the CPU does, and fails after so many launches."""

    name = "cuda"

    def __init__(self, launches: int) -> None:
        super().__init__()
        self.left, self.is_closed = launches, False

    def run(self, kernel, *args):
        """Launch, or fail."""
        self.left -= 1
        if self.left < 0:
            raise BackendError("device cuda", "CudaAPIError (too hot)", "a GPU that works")
        return super().run(kernel, *args)

    def close(self) -> None:
        self.is_closed = True


def drawn(renderer, scene):
    bands = renderer.render(scene, view_of(lens()), settings_of(), AOVS, band_pixels=150 * 40)
    parts = [(band.y0, band.y1, {k: v.copy() for k, v in band.arrays.items()}) for band in bands]
    ends = [y1 for _, y1, _ in parts]
    assert [y0 for y0, _, _ in parts] == [0, *ends[:-1]] and len(parts) > 2
    return {name: np.concatenate([each[name] for _, _, each in parts]) for name in AOVS}


@pytest.mark.parametrize("launches", [0, 3, 12, 20])
def test_the_cpu_draws_what_is_still_to_come(launches) -> None:
    """Before the first band or between two. Oracle: the CPU's picture, bit for bit, of that which
    follows too; the sentence says why."""
    scene = scene_of((random_cloud(3), np.eye(4)))
    expected = drawn(Renderer(CpuDevice()), scene)
    device = Failing(launches)
    renderer = Renderer(device, falls_back=True)
    for _ in range(2):
        found = drawn(renderer, scene)
        for name in AOVS:
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    assert renderer.device == "cpu" and device.is_closed
    assert renderer.remark == f"{SAID}; the CPU is used"


@pytest.mark.parametrize("launches", [0, 30, 150, 400])
def test_the_cpu_merges_the_deep_samples_that_are_still_to_come(launches) -> None:
    """Where strips are as high as they fit. Oracle: the CPU's picture, bit for bit."""
    scene = scene_of((random_cloud(3), np.eye(4)))
    settings = settings_of(samples=5, sorting="rayHitDistance")
    size = DeepSize(band_pixels=5000, entries=40_000)

    def deep(renderer):
        strips = list(
            renderer.render_deep(scene, view_of(lens()), settings, ("primId",), size=size)
        )
        ends = [y1 for _, y1, _ in strips]
        assert [y0 for y0, _, _ in strips] == [0, *ends[:-1]] and ends[-1] == 110
        assert len(strips) > 4
        names = ("counts", "depth", "color", "ids")
        return [np.concatenate([getattr(s, name) for *_, s in strips]) for name in names]

    expected = deep(Renderer(CpuDevice()))
    renderer = Renderer(Failing(launches), falls_back=True)
    for found, array in zip(deep(renderer), expected, strict=True):
        np.testing.assert_array_equal(found, array)
    assert renderer.device == "cpu"


def test_two_pictures_that_are_drawn_at_once_both_fall_back() -> None:
    """Oracle: the CPU's picture, bit for bit, of both, and of one that follows."""
    scene = scene_of((random_cloud(3), np.eye(4)))
    expected = drawn(Renderer(CpuDevice()), scene)
    device = Failing(1000)
    renderer = Renderer(device, falls_back=True)
    pictures = [
        renderer.render(scene, view_of(lens()), settings_of(), AOVS, band_pixels=150 * 40)
        for _ in range(2)
    ]
    parts = [[{k: v.copy() for k, v in next(picture).arrays.items()}] for picture in pictures]
    device.left = 0
    for picture, found in zip(pictures, parts, strict=True):
        found += [{k: v.copy() for k, v in band.arrays.items()} for band in picture]
    for found in parts:
        for name in AOVS:
            np.testing.assert_array_equal(np.concatenate([p[name] for p in found]), expected[name])
    assert renderer.device == "cpu"
    np.testing.assert_array_equal(drawn(renderer, scene)["color"], expected["color"])


def test_who_asks_for_a_gpu_is_told(any_device) -> None:
    """Oracle: the error itself."""
    renderer = Renderer(Failing(3))
    with pytest.raises(BackendError, match="too hot"):
        drawn(renderer, scene_of((random_cloud(3), np.eye(4))))
    assert renderer.device == "cuda"
