"""Tests that colour-only pictures on a GPU are fused, and equal those of the CPU."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import device_of
from tests.render import color_pictures
from tests.render.everything import drawn
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.render.cuda import _Words

SIZE, SPLATS = (150, 110), 400


@pytest.fixture(scope="module")
def cuda() -> Device:
    """A GPU."""
    return device_of("cuda")


@pytest.mark.parametrize(
    ("name", "is_fused"),
    [(name, True) for name in color_pictures.FUSED]
    + [(name, False) for name in color_pictures.OTHERWISE],
)
def test_colour_alone_is_drawn_whole_where_nothing_else_decides_it(
    cuda: Device, monkeypatch: pytest.MonkeyPatch, name: str, is_fused: bool
) -> None:
    """Oracle: the CPU, to 1e-3 but where rounding decides."""
    made = color_pictures.count_fused(monkeypatch)
    color_pictures.check_fused(cuda, CpuDevice(), name, SIZE, SPLATS, 1e-3)
    assert bool(made) == is_fused


def test_packed_fields_are_drawn_as_they_are(cuda: Device) -> None:
    """Oracle: what they unpack to."""
    color_pictures.check_packed(cuda, SIZE, SPLATS)


def test_only_new_nodes_are_sent(cuda: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the nodes that are drawn, without those that were drawn before; and the CPU."""
    color_pictures.check_only_new_nodes_are_sent(cuda, CpuDevice(), monkeypatch, 1e-3)


def test_two_pictures_on_one_gpu_are_the_same(cuda: Device) -> None:
    """Oracle: the same device, bit for bit."""
    case = color_pictures.bare("splats alone")
    first, second = (drawn(cuda, case, size=SIZE, splats=SPLATS) for _ in range(2))
    np.testing.assert_array_equal(first["color"], second["color"])


def test_words_are_taken_anew_when_they_are_others() -> None:
    """Colours change in the words while the layout stays. Oracle: NumPy's own indexing."""
    taken, rows = _Words(), np.array([2, 0, 1], np.int32)
    words = np.arange(12, dtype=np.int32).reshape(3, 4)
    np.testing.assert_array_equal(taken.of(words, rows), words[rows])
    assert taken.of(words, rows) is taken.of(words, rows)
    recoloured = words + np.int32(100)
    np.testing.assert_array_equal(taken.of(recoloured, rows), recoloured[rows])
    assert taken.of(recoloured, np.empty(0, np.int32)) is recoloured
