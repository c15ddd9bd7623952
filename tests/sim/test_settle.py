"""Tests of settling."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import state_at
from usdsplat.kernels.devices import open_device
from usdsplat.sim.contact import SINCE
from usdsplat.sim.parameters import SettleParameters
from usdsplat.sim.settle import SPEEDS, settle_back
from usdsplat.sim.state import FREE, PINNED


def settle(state, before, after, dt, *, threads=None, max_speed=np.inf, **knobs):
    """One substep."""
    before, after = np.float32(before), np.float32(after)
    device = open_device(threads=threads)
    parameters = SettleParameters(**knobs)
    settle_back(device, state, before, after, parameters, dt, max_speed=max_speed)


@pytest.mark.parametrize("omega", [0.5, 8.0, 100.0])
def test_a_push_settles(omega: float) -> None:
    """Oracle: closed form (1 + omega t) exp(-omega t) of the first distance, test 13 of the
    specification: within 2e-6 of the larger of |x| and that distance, at any step."""
    goal = np.array([[1.0, -2.0, 0.5]])
    push = np.array([[0.3, 0.1, -0.2]])
    for dt in (1 / 960, 1 / 96, 1 / 4):
        state = state_at(goal + push)
        begun = state.positions.astype(np.float64) - goal
        for s in range(1, 100):
            settle(state, goal, goal, dt, omega=omega)
            t = np.float64(np.float32(dt)) * s
            expected = goal + (1 + omega * t) * np.exp(-omega * t) * begun
            assert np.abs(state.positions - expected).max() <= 2e-6 * 2.0
            assert ((state.positions - goal) * begun >= -4e-7).all()


def test_a_moving_goal_is_followed() -> None:
    """Oracle: the closed form relative to a goal of constant velocity."""
    omega, dt = 6.0, 1 / 48
    speed, push = np.array([[0.7, -0.4, 0.2]]), np.array([[0.2, 0.3, 0.1]])
    state = state_at(push, velocity=speed[0])
    for s in range(1, 60):
        settle(state, speed * dt * (s - 1), speed * dt * s, dt, omega=omega)
        t = dt * s
        left = (1 + omega * t) * np.exp(-omega * t) * push
        rate = speed - omega**2 * t * np.exp(-omega * t) * push
        assert state.positions == pytest.approx(speed * t + left, abs=3e-6)
        assert state.velocities == pytest.approx(rate, abs=3e-5)


def test_a_goal_that_speeds_up_takes_splats_along() -> None:
    """Oracle: the goal, from which a splat at rest on it never departs; its velocity, and that of
    a splat off it in the closed form relative to it."""
    dt, omega = 1 / 96, 7.0
    way = np.cumsum(np.random.default_rng(1).uniform(-0.1, 0.2, (40, 3)), axis=0)
    way = way.astype(np.float32)
    state = state_at([way[0], way[0] + np.float32(0.5)])
    state.memory[SPEEDS] = np.zeros((2, 3), np.float32)
    for s in range(1, 40):
        before, after = np.tile(way[s - 1], (2, 1)), np.tile(way[s], (2, 1))
        settle(state, before, after, dt, omega=omega)
        assert (state.positions[0] == way[s]).all()
        assert state.velocities[0] == pytest.approx((way[s] - way[s - 1]) / dt, rel=1e-5, abs=1e-5)
        left = 0.5 * (1 + omega * dt * s) * np.exp(-omega * dt * s)
        assert state.positions[1] - way[s] == pytest.approx([left] * 3, abs=2e-5)


def test_weights_scale_omega() -> None:
    """Oracle: the splat that has the scaled omega; weight 0 stays as far off as it is."""
    state, other = (state_at([(1, 0, 0)] * 2, velocity=(0, 1, 0)) for _ in range(2))
    state.weight[:] = 0.5, 0.0
    settle(state, np.zeros((2, 3)), np.zeros((2, 3)), 0.1, omega=8.0)
    settle(other, np.zeros((2, 3)), np.zeros((2, 3)), 0.1, omega=4.0)
    assert (state.positions[0] == other.positions[0]).all()
    assert state.positions[1].tolist() == [1, 0, 0]
    assert state.velocities[1].tolist() == [0, 0, 0]


def test_rest_after_a_contact() -> None:
    """Oracle: closed form of a damper alone, v exp(-2 omega t); then the spring's."""
    state = state_at([(1, 0, 0), (1, 0, 0)], velocity=(1, 0, 0))
    state.memory[SINCE] = np.array([0.0, np.inf], np.float32)
    goal = np.zeros((2, 3))
    for _ in range(3):
        settle(state, goal, goal, 0.1, omega=5.0, delay=0.25)
    assert state.memory[SINCE][0] == pytest.approx(0.3)
    t = 0.3
    assert state.positions[0, 0] == pytest.approx(1 + (1 - np.exp(-10 * t)) / 10, rel=1e-6)
    assert state.velocities[0, 0] == pytest.approx(np.exp(-10 * t), rel=1e-5)
    assert state.positions[1, 0] == pytest.approx((1 + 6 * t) * np.exp(-5 * t), rel=1e-5)
    x = state.positions[0, 0]
    settle(state, goal, goal, 0.1, omega=5.0, delay=0.25)
    tau = np.exp(-10 * t) + 5 * x
    assert state.positions[0, 0] == pytest.approx((x + tau * 0.1) * np.exp(-0.5), rel=1e-5)


def test_speed_is_limited_and_pinned_and_free_splats_are_left() -> None:
    """Oracle: the input."""
    state = state_at([(0, 0, 0)] * 3, velocity=(30, 40, 0))
    state.flags[1] |= PINNED
    state.flags[2] |= FREE
    settle(state, np.zeros((3, 3)), np.zeros((3, 3)), 1e-3, omega=1e-3, max_speed=5.0)
    assert state.velocities[0] == pytest.approx([3, 4, 0], rel=1e-5)
    assert (state.velocities[1:] == np.float32([30, 40, 0])).all()
    assert not state.positions[1:].any()


def test_threads_change_no_bit() -> None:
    """Oracle: one thread."""
    digests = []
    for threads in (1, 2):
        rng = np.random.default_rng(0)
        state = state_at(rng.normal(size=(5001, 3)))
        state.weight[:] = rng.uniform(0, 1, 5001)
        settle(state, np.zeros((5001, 3)), np.ones((5001, 3)), 0.01, threads=threads)
        digests.append(state.digest())
    assert digests[0] == digests[1]
