"""Tests of free flight. Oracle: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from tests.devices import all_cores
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim.flight import flight
from usdsplat.sim.flight import fly
from usdsplat.sim.parameters import ParticlesParameters
from usdsplat.sim.state import ALIVE, FREE, PINNED, State
from usdsplat.sim.timeline import Step

DEVICE = open_device()
ONE = np.eye(4)


@njit
def closed(v, push, drag, seconds):
    """`flight` from Python."""
    return flight(v, push, drag, seconds)


def state_of(positions, velocities=0.0) -> State:
    """Splats that fly."""
    n = len(positions)
    state = State.of(
        SplatCloud(
            positions=np.asarray(positions, np.float32),
            scales=np.full((n, 3), 0.1, np.float32),
            rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
            opacities=np.full(n, 0.5, np.float32),
            sh=np.zeros((n, 1, 3), np.float32),
        )
    )
    state.velocities[:] = velocities
    state.flags |= FREE
    return state


def run(state: State, particles: ParticlesParameters, seconds: float, steps: int, **options):
    """`steps` equal steps."""
    for step in range(steps):
        each = Step(step * seconds / steps, seconds / steps, 1)
        fly(DEVICE, state, particles, each, **{"to_world": ONE, **options})
    return state


@pytest.mark.parametrize("steps", [1, 7, 64])
def test_23_drag_is_exact_at_any_step(steps) -> None:
    """Oracle: v(t) = w + (v - w) e^(-c t)."""
    rng = np.random.default_rng(0)
    first = rng.uniform(-1, 1, (50, 3)).astype(np.float32)
    particles = ParticlesParameters(drag=1.7, wind=(0.4, -0.2, 0.1))
    state = run(state_of(np.zeros((50, 3)), first), particles, 1.3, steps)
    wind = np.array(particles.wind)
    expected = wind + (first.astype(float) - wind) * math.exp(-1.7 * 1.3)
    assert np.abs(state.velocities - expected).max() < 1e-6


def test_23_gravity_converges_with_order_one() -> None:
    """Oracle: the closed form of flight with gravity, wind and drag, written out here."""
    drag, seconds, wind = 0.8, 1.5, np.array([0.5, 0.0, -0.25])
    gravity, first = np.array([0.0, -9.81, 0.0]), np.array([1.0, 4.0, 0.5])
    final = wind + gravity / drag
    gone = math.exp(-drag * seconds)
    way = final * seconds + (first - final) * (1 - gone) / drag
    particles = ParticlesParameters(gravity=tuple(gravity), wind=tuple(wind), drag=drag)
    errors = []
    for steps in (8, 16, 32, 64):
        state = run(state_of(np.zeros((1, 3)), first), particles, seconds, steps)
        errors.append(np.abs(state.positions[0] - way).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(np.abs(ratios - 2) < 0.15), errors


@pytest.mark.parametrize("drag", [0.0, 1e-9, 1e-4, 0.0099, 0.0101, 0.8, 40.0])
def test_closed_form_solves_the_equation(drag) -> None:
    """Oracle: Runge-Kutta of order 4 in float64; without drag the parabola."""
    v, push, seconds, steps = 1.3, -2.7, 1.0, 400
    place, speed, dt = 0.0, v, seconds / steps
    for _ in range(steps):
        k1 = push - drag * speed
        k2 = push - drag * (speed + dt / 2 * k1)
        k3 = push - drag * (speed + dt / 2 * k2)
        k4 = push - drag * (speed + dt * k3)
        place += dt * speed + dt * dt / 6 * (k1 + k2 + k3)
        speed += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    found = closed(v, push, drag, seconds)
    assert np.allclose(found, (place, speed), rtol=0, atol=1e-11 if drag < 1 else 2e-6)
    if drag == 0:
        assert np.allclose(found, (v + push / 2, v + push), rtol=0, atol=1e-15)


def test_gravity_and_wind_are_the_stages() -> None:
    """Oracle: the same flight in the stage's space, taken there and back by the matrix."""
    turn = np.array([[0, -2, 0, 5], [2, 0, 0, -1], [0, 0, 2, 3], [0, 0, 0, 1]], float)
    rng = np.random.default_rng(2)
    local = rng.uniform(-1, 1, (200, 3))
    particles = ParticlesParameters(
        gravity=(0, -3, 1), wind=(1, 0, 2), turbulence=0.7, turbulence_scale=0.5, drag=2.0
    )
    moved = run(state_of(local), particles, 0.5, 8, to_world=turn).positions
    world = local @ turn[:3, :3].T + turn[:3, 3]
    expected = run(state_of(world), particles, 0.5, 8).positions
    assert np.abs(moved @ turn[:3, :3].T + turn[:3, 3] - expected).max() < 3e-5


def test_whirls_have_their_speed_and_extra_air_adds() -> None:
    """Oracle: with much drag splats have the air's velocity, of the root mean square asked for."""
    points = np.random.default_rng(3).uniform(-100, 100, (20_000, 3))
    particles = ParticlesParameters(turbulence=2.5, drag=1e3)
    seen = run(state_of(points), particles, 0.1, 1).velocities.copy()
    assert abs(np.sqrt(np.mean(np.sum(seen**2, -1))) / 2.5 - 1) < 0.03
    air = np.random.default_rng(4).uniform(-1, 1, (len(points), 3)).astype(np.float32)
    both = run(state_of(points), particles, 0.1, 1, air=air).velocities
    assert np.abs(both - seen - air).max() < 1e-5


def test_whirls_change_over_time() -> None:
    """Oracle: at a later change the air is another, at speed 0 it is the same."""
    points = np.random.default_rng(3).uniform(-100, 100, (5000, 3))
    for speed, correlation in ((0.5, 0.0), (0.0, 1.0)):
        particles = ParticlesParameters(turbulence=1.0, turbulence_speed=speed, drag=1e3)
        states = [state_of(points), state_of(points)]
        for state, now in zip(states, (0.0, 4.0), strict=True):
            fly(DEVICE, state, particles, Step(now, 0.1, 1), to_world=ONE)
        first, second = (state.velocities.ravel() for state in states)
        assert abs(np.corrcoef(first, second)[0, 1] - correlation) < 0.05


def test_only_the_free_fly_and_none_faster_than_allowed() -> None:
    """Oracle: the definitions of the flags and of the limit."""
    particles = ParticlesParameters(gravity=(0, -10, 0), drag=0.0)
    state = state_of(np.zeros((4, 3)))
    state.flags[:] = [ALIVE, ALIVE | FREE, ALIVE | FREE | PINNED, FREE]
    run(state, particles, 1.0, 1, max_speed=4.0)
    assert np.array_equal(state.velocities[:, 1], np.float32([0, -4, 0, 0]))
    assert np.array_equal(state.positions[:, 1], np.float32([0, -4, 0, 0]))
    everyone = state_of(np.zeros((2, 3)))
    everyone.flags[:] = [ALIVE, ALIVE | PINNED]
    run(everyone, ParticlesParameters(enabled=True, gravity=(1, 0, 0)), 1.0, 1)
    assert everyone.positions[0, 0] > 0 == everyone.positions[1, 0]


def test_a_flattened_field_is_refused() -> None:
    """Oracle: no inverse."""
    with pytest.raises(StageError, match="an invertible one"):
        run(state_of(np.zeros((1, 3))), ParticlesParameters(), 1, 1, to_world=np.diag([1, 0, 1, 1]))


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit by bit."""
    points = np.random.default_rng(5).uniform(-3, 3, (5000, 3))
    particles = ParticlesParameters(gravity=(0, -1, 0), turbulence=1.0, turbulence_scale=0.3)
    digests = set()
    for device in (CpuDevice(threads=1), all_cores()):
        state = state_of(points)
        for step in range(5):
            fly(device, state, particles, Step(step / 24, 1 / 24, 1), to_world=ONE)
        digests.add(state.digest())
    assert len(digests) == 1
