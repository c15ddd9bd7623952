"""Tests of colour-only pictures through the delegate, on the simulator."""

from __future__ import annotations

import pytest

from tests.kernels.cuda.simulated.passes import PythonDevice
from tests.render import color_pictures
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame import picture, tiles

SIZE, SPLATS = (20, 18), 7


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Launches of a size that a simulator can take."""
    for name, value in (("WAVES", 2), ("THREADS", 32), ("LEAST", 64)):
        monkeypatch.setattr(picture, name, value)


@pytest.mark.parametrize(
    "name", ["tangential", "budget", "samples", "tree in colour", "tree and samples"]
)
def test_colour_alone_is_drawn_whole(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Oracle: the CPU's loops, in Python here as the kernels are."""
    made = color_pictures.count_fused(monkeypatch)
    device = PythonDevice(threads=1)
    color_pictures.check_fused(CudaDevice(), device, name, SIZE, SPLATS, 1e-4)
    assert made


def test_what_touches_too_many_tiles_goes_band_by_band(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the CPU's loops, in Python here; no picture is drawn whole."""
    monkeypatch.setattr(tiles, "MOST_PAIRS", 5)
    finished = []
    monkeypatch.setattr(picture.FramePicture, "_finish", finished.append)
    device = PythonDevice(threads=1)
    color_pictures.check_fused(CudaDevice(), device, "splats alone", SIZE, SPLATS, 1e-4)
    assert not finished


def test_packed_fields_are_drawn_as_they_are() -> None:
    """Oracle: what they unpack to."""
    color_pictures.check_packed(CudaDevice(), SIZE, SPLATS)


def test_only_new_nodes_are_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the nodes that are drawn, without those that were drawn before; and the CPU's loops,
    in Python here as the kernels are."""
    device = PythonDevice(threads=1)
    color_pictures.check_only_new_nodes_are_sent(CudaDevice(), device, monkeypatch, 1e-4)
