"""Tests of captures that become other captures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.sim.recipes import Written, always, ball, deformer, knobs, started
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.population import padded

ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")
CONFORM = {"weight": 1.0, "start": 0.02, "duration": 0.25, "stagger": 0.1}
LAST = 12


def egg(count=700, degree=0):
    """Another capture: an egg beside the ball."""
    cloud = ball(count, degree, seed=8)
    places = cloud.positions * np.float32([0.6, 1.6, 0.6]) + np.float32([3, 0, 0])
    return replace(cloud, positions=places)


def frames(device, rest, other, **given):
    """All frames, with a deformer where one is given."""
    parameters = knobs(conform=CONFORM)
    padding = replace(other, sh=padded(other.sh, rest.sh.shape[1]))
    says = always(parameters=parameters, becomes=padding, **given)
    solver = started(device, Written(rest, says), LAST)
    found = [solver.frame()]
    for _ in range(LAST - 1):
        solver.advance()
        found.append(solver.frame())
    return found


@pytest.fixture(scope="module")
def morph(any_device):
    rest, other = ball(600), egg()
    return rest, other, frames(open_device(), rest, other)


def test_it_begins_with_the_capture(morph):
    """Oracle: the capture, bit for bit."""
    rest, _, found = morph
    for name in ARRAYS:
        assert np.array_equal(getattr(found[0].cloud, name), getattr(rest, name)), name


def test_it_ends_with_the_other_capture(morph):
    """Oracle: the other capture, bit for bit, and nothing else that is visible."""
    rest, other, found = morph
    cloud, n = found[-1].cloud, len(rest)
    for name in ("positions", "rotations", "scales", "opacities"):
        assert np.array_equal(getattr(cloud, name)[n:], getattr(other, name)), name
    np.testing.assert_allclose(cloud.sh[n:, :1], other.sh, atol=1e-6)
    assert not cloud.opacities[:n].any() and not cloud.sh[n:, 1:].any()


@pytest.mark.parametrize("order", ["distance", "primvar"])
def test_both_move_together(morph, order):
    """Oracle: where both are half visible, each splat of the other capture has splats of the
    capture beside it, at the distance of neighbours; also where a primvar says when those start."""
    rest, other, found = morph
    if order == "primvar":
        found = frames(open_device(), rest, other, order=(1 - rest.positions[:, 1]) / 2)
    n = len(rest)
    cloud = found[5].cloud
    is_seen = cloud.opacities > 0.1
    first, second = cloud.positions[:n], cloud.positions[n:][is_seen[n:]]
    assert len(second) > 300 and (is_seen[:n].mean() > 0.5)
    away = np.linalg.norm(second[:, None] - first[None], axis=2).min(axis=1)
    assert np.percentile(away, 90) < 0.25


def test_new_splats_have_new_identities(morph):
    """Oracle: those of the capture are its rows; others follow."""
    rest, other, found = morph
    assert np.array_equal(found[-1].cloud.ids, np.arange(len(rest) + len(other)))
    assert len(found[0].cloud) == len(rest)


def test_colors_go_from_one_to_the_other(any_device):
    """Oracle: a red capture and a green one: on the way nothing is redder or greener."""
    rest, other = ball(300, 0), egg(300)
    red, green = (np.tile(np.float32(each), (300, 1, 1)) for each in ([1, 0, 0], [0, 1, 0]))
    found = frames(open_device(), replace(rest, sh=red), replace(other, sh=green))
    middle = found[6].cloud.sh[:, 0]
    assert middle.min() >= -1e-5 and middle.max() <= 1 + 1e-5
    np.testing.assert_allclose(middle.sum(axis=1), 1, atol=1e-5)
    mixed = (middle[:, 0] > 0.1) & (middle[:, 0] < 0.9)
    assert mixed.any()


def test_deformers_do_not_reach_the_other_capture(any_device):
    """Oracle: the other capture, where a deformer moves everything else away."""
    rest, other = ball(300), egg(200)
    away = deformer("transform", translate=(0.0, 0.0, 7.0))
    found = frames(open_device(), rest, other, deformers=(away,))
    assert np.array_equal(found[-1].cloud.positions[300:], other.positions)


def test_threads_and_restarts_give_the_same_bits():
    """Oracle: one thread, without a restart."""
    rest, other = ball(300), egg(260)
    padding = replace(other, sh=padded(other.sh, rest.sh.shape[1]))
    recipe = Written(rest, always(parameters=knobs(conform=CONFORM), becomes=padding))
    found = []
    for threads in (1, 2):
        solver = started(CpuDevice(threads=threads), recipe, LAST)
        for number in range(8):
            if number in (0, 4) and threads == 2:
                state = solver.checkpoint()
                solver = started(CpuDevice(threads=2), recipe, LAST, state=state)
            solver.advance()
        found.append(solver.frame().cloud)
    for name in ARRAYS:
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name)), name
