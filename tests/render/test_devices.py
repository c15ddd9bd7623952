"""Tests that a scene with every feature gives the same pictures on a GPU."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import device_of
from tests.render.everything import CASES, DEEP, drawn, drawn_deep
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.render.deep_samples import DEEP_IDS

SIZE, SPLATS = (150, 110), 400
CLOSE = 1e-3
FEW = 0.004
"""Part of the pixels where rounding may decide: whether a splat counts at its edge, or which of two
is nearer."""
COUNTS_APART = 0.05
"""By which the numbers of splats that are seen, and of their pairs with tiles, may differ."""
IDS = ("primId", "instanceId", "elementId")


@pytest.fixture(scope="module")
def cuda() -> Device:
    """A GPU."""
    return device_of("cuda")


def differs(name: str, ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Which pixels do, shape (h, w)."""
    if name in IDS:
        return ours != theirs
    if name == "cryptoObject":  # ids are floats whose bits count
        return np.any(ours[..., ::2] != theirs[..., ::2], axis=-1) | np.any(
            abs(ours[..., 1::2] - theirs[..., 1::2]) > CLOSE, axis=-1
        )
    with np.errstate(invalid="ignore"):
        apart = abs(ours.astype(np.float64) - theirs) > CLOSE * np.maximum(1, abs(theirs))
    apart |= np.isfinite(ours) != np.isfinite(theirs)
    return apart if apart.ndim == 2 else apart.any(axis=-1)


@pytest.mark.parametrize("name", CASES)
def test_a_gpu_draws_what_the_cpu_draws(cuda: Device, name: str) -> None:
    """All AOVs, all settings. Oracle: the CPU, to 1e-3 but where rounding decides."""
    case = CASES[name]
    ours = drawn(cuda, case, size=SIZE, splats=SPLATS)
    theirs = drawn(CpuDevice(), case, size=SIZE, splats=SPLATS)
    counted, expected = ours.pop("stats"), theirs.pop("stats")
    assert (abs(counted - expected) <= COUNTS_APART * expected).all(), (counted, expected)
    wrong = {
        each: float(differs(each, ours[each], theirs[each]).mean())
        for each in theirs
        if differs(each, ours[each], theirs[each]).mean() > FEW
    }
    assert not wrong, wrong
    assert (theirs["color"][..., 3] > 0.5).any()  # there is something to compare


@pytest.mark.parametrize("error", [0.0, 0.01])
@pytest.mark.parametrize("name", DEEP)
def test_a_gpu_writes_the_deep_samples_of_the_cpu(cuda: Device, name: str, error: float) -> None:
    """Oracle: the CPU: as many samples but in a few pixels, and of those the same."""
    case = CASES[name]
    (ours,) = drawn_deep(cuda, case, error, size=SIZE, splats=SPLATS)
    (theirs,) = drawn_deep(CpuDevice(), case, error, size=SIZE, splats=SPLATS)
    same = ours.counts == theirs.counts
    assert same.mean() > 1 - 10 * FEW
    ours_in = np.repeat(same.ravel(), ours.counts.ravel())
    theirs_in = np.repeat(same.ravel(), theirs.counts.ravel())
    assert theirs_in.sum() > 1000
    for field in ("depth", "depth_back", "color"):
        a, b = getattr(ours, field)[ours_in], getattr(theirs, field)[theirs_in]
        wrong = abs(a - b) > CLOSE
        assert wrong.mean() < FEW, field
    assert (abs(ours.left - theirs.left) > CLOSE).mean() < FEW


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("name", DEEP)
def test_a_gpu_finds_the_ids_of_deep_samples(cuda: Device, name: str, samples: int) -> None:
    """Also of samples that are merged. Oracle: the CPU, in the pixels with as many samples."""
    options = {"size": SIZE, "splats": SPLATS, "aovs": DEEP_IDS, "samples": samples}
    (ours,) = drawn_deep(cuda, CASES[name], 0.0, **options)
    (theirs,) = drawn_deep(CpuDevice(), CASES[name], 0.0, **options)
    assert ours.id_names == theirs.id_names == DEEP_IDS and ours.prims == theirs.prims
    same = ours.counts == theirs.counts
    assert same.mean() > 1 - 10 * FEW * samples
    found = ours.ids[np.repeat(same.ravel(), ours.counts.ravel())]
    expected = theirs.ids[np.repeat(same.ravel(), theirs.counts.ravel())]
    assert len(expected) > 1000
    assert (found != expected).any(axis=1).mean() < FEW * samples


def test_two_pictures_on_one_gpu_are_the_same(cuda: Device) -> None:
    """Nothing is added up in an order that varies. Oracle: the same device, bit for bit."""
    for name in ("rays and surfaces", "matte splats"):
        first, second = (drawn(cuda, CASES[name], size=SIZE, splats=SPLATS) for _ in range(2))
        for each in first:
            np.testing.assert_array_equal(first[each], second[each], err_msg=each)
