"""Tests of the deformation of pushed splats, estimated from their neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import state_at
from usdsplat.kernels.devices import open_device
from usdsplat.sim.state import FREE
from usdsplat.sim.strain import Strain


def grid():
    """Splats 0.1 apart, of deviation 0.01."""
    axis = np.arange(8) * 0.1
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return state_at(points, sigma=0.01)


def strained(state, *, is_fixed):
    nothing = np.zeros((len(state), 3), np.float32)
    strain = Strain(open_device(), is_fixed=is_fixed)
    return strain.add(state, state.rest_positions, None, nothing)


@pytest.mark.parametrize("is_fixed", [True, False])
def test_those_beside_what_is_pushed_are_deformed_too(is_fixed) -> None:
    """Oracle: closed form: where x is stretched from a plane on, splats in that plane, which are
    not pushed themselves, are stretched by half as much; those before it are not, to the bit. Else
    their shapes would leap when they are touched."""
    state = grid()
    x = state.rest_positions[:, 0]
    state.positions[:, 0] = np.where(x > 0.35, x + 0.1 * (x - 0.35), x)
    f = strained(state, is_fixed=is_fixed)
    inner = ((state.rest_positions[:, 1:] > 0.25) & (state.rest_positions[:, 1:] < 0.45)).all(
        axis=1
    )
    plane = inner & (np.abs(x - 0.3) < 0.01)
    assert ((f[plane, 0, 0] > 1.01) & (f[plane, 0, 0] < 1.09)).all()
    deep = inner & (np.abs(x - 0.5) < 0.01)
    np.testing.assert_allclose(f[deep, 0, 0], 1.1, atol=1e-4)
    assert np.array_equal(f[x < 0.15], np.tile(np.eye(3), ((x < 0.15).sum(), 1, 1)))


def test_neighbours_found_before_and_now_are_the_same() -> None:
    """Oracle: the other way."""
    state = grid()
    state.rest_positions += np.random.default_rng(3).uniform(-0.02, 0.02, (512, 3)).astype("f4")
    state.positions[:] = state.rest_positions
    state.positions[:, 1] += np.float32(0.1) * np.maximum(state.positions[:, 0] - 0.3, 0)
    one, other = (strained(state, is_fixed=fixed) for fixed in (True, False))
    np.testing.assert_allclose(one, other, atol=1e-6)
    assert np.abs(one - np.eye(3)).max() > 0.05


def test_those_that_fly_are_left_out() -> None:
    """Oracle: the identity, where all that moved flies."""
    state = grid()
    state.positions[:100] += np.float32(0.3)
    state.flags[:100] |= FREE
    state.scales *= np.float32(2)  # so that they must be put back
    f = strained(state, is_fixed=True)
    assert np.array_equal(f, np.tile(np.eye(3), (512, 1, 1)))
