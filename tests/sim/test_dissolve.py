"""Tests of dissolving and assembling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.devices import all_cores
from tests.sim.test_flight import ONE, closed, state_of
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.dissolve import TIMES, Dissolve
from usdsplat.sim.flight import fly
from usdsplat.sim.parameters import DissolveParameters, ParticlesParameters
from usdsplat.sim.state import ALIVE, FREE, PINNED, State
from usdsplat.sim.timeline import Step

DEVICE = open_device()
UP = np.float32([0, 0.6, 0.8])
ASKEW = np.array([[0, -2, 0, 5], [2, 0, 0, -1], [0, 0, 2, 3], [0, 0, 0, 1]], float)


def at_rest(n=2000, width=1.0) -> State:
    """Splats in a cube about 0."""
    state = state_of(np.random.default_rng(0).uniform(-width, width, (n, 3)))
    state.flags[:] = ALIVE
    return state


def normals(state) -> np.ndarray:
    """One for all."""
    return np.tile(UP, (len(state), 1))


def made(state, seed=1, **options) -> Dissolve:
    """A dissolve."""
    return Dissolve.of(DEVICE, state, DissolveParameters(enabled=True, **options), seed=seed)


def test_order_by_distance() -> None:
    """Oracle: the distances in NumPy; the last goes at start + duration."""
    state = at_rest()
    made(state, by="distance", origin=(0.5, 0, 0), start=1.0, duration=3.0)
    far = np.linalg.norm(state.rest_positions.astype(float) - (0.5, 0, 0), axis=1)
    assert np.abs(state.memory[TIMES] - (1 + 3 * far / far.max())).max() < 1e-6


def test_order_by_random_and_noise_fills_the_time() -> None:
    """Oracle: the uniform distribution; noise is alike within a patch, random is not."""
    state = at_rest(20_000, 10.0)
    near = state.rest_positions.copy()
    near[1::2] = near[::2] + np.float32(0.01)
    for by, tolerance, is_alike in (("random", 0.015, False), ("noise", 0.06, True)):
        state.memory.clear()
        state.rest_positions = near
        made(state, by=by, size=1.0, start=-1.0, duration=2.0)
        times = np.sort(state.memory[TIMES])
        even = np.linspace(-1, 1, len(times))
        assert -1 <= times[0] <= times[-1] <= 1
        assert np.abs(times - even).max() < 2 * tolerance
        gap = np.abs(state.memory[TIMES][1::2] - state.memory[TIMES][::2])
        assert (np.median(gap) < 0.05) == is_alike


def test_times_are_remembered() -> None:
    """Oracle: those of the capture, after it grew; other seeds have others."""
    state = at_rest()
    made(state)
    before = state.memory[TIMES].copy()
    state.rest_positions += np.float32(0.3)
    made(state)
    assert np.array_equal(state.memory[TIMES], before)
    state.memory.clear()
    made(state, seed=2)
    assert not np.array_equal(state.memory[TIMES], before)


def test_they_go_once_when_their_time_has_come() -> None:
    """Oracle: times, one by one; the unselected and the pinned stay."""
    state = at_rest()
    state.weight[:10] = 0.2
    state.flags[10:20] |= PINNED
    dissolve = made(state, by="random", speed=2.0, duration=1.0)
    state.velocities[:] = 0
    dissolve.release(state, normals(state), now=0.4)
    went = (state.flags & FREE) != 0
    due = state.memory[TIMES] <= 0.4
    due[:20] = False
    assert np.array_equal(went, due) and 0 < due.sum() < len(state)
    assert np.array_equal((state.velocities != 0).any(1), due)
    before = state.velocities.copy()
    dissolve.release(state, normals(state), now=0.4)
    assert np.array_equal(before, state.velocities)
    dissolve.release(state, normals(state), now=9.0)
    assert np.array_equal((state.flags & FREE) != 0, np.arange(len(state)) >= 20)


@pytest.mark.parametrize("spread", [0.0, 25.0, 180.0])
def test_impulse_is_even_over_a_cone(spread) -> None:
    """Oracle: a cone's cosines are evenly spread from 1 to that of half its angle, and its mean
    lies on the axis."""
    state = at_rest(20_000)
    dissolve = made(state, speed=2.0, spread=spread, duration=0.0)
    dissolve.release(state, normals(state), now=0.0)
    way = state.velocities / 2
    assert np.abs(np.linalg.norm(way, axis=1) - 1).max() < 1e-5
    cosines = np.sort(way @ UP)
    assert np.abs(cosines - np.linspace(math.cos(math.radians(spread)), 1, len(way))).max() < 0.03
    across = np.mean(way - (way @ UP)[:, None] * UP, axis=0)
    assert np.abs(across).max() < 0.02


def test_fades_by_the_time_since() -> None:
    """Oracle: smoothstep, written out; assembling is the mirror of it."""
    state = at_rest(500)
    dissolve = made(state, by="random", start=1.0, duration=2.0, fade=0.5, shrink=0.75)
    since = np.clip((2.0 - state.memory[TIMES].astype(float)) / 0.5, 0, 1)
    gone = since**2 * (3 - 2 * since)
    alpha, size = dissolve.fades(state, now=2.0)
    assert np.abs(alpha - (1 - gone)).max() < 1e-5
    assert np.abs(size - (1 - 0.75 * gone)).max() < 1e-5
    other = at_rest(500)
    assemble = made(other, by="random", start=1, duration=2, fade=0.5, shrink=0.75, mode="assemble")
    for now in (1.3, 2.0, 2.9):
        first, second = dissolve.fades(state, now=now), assemble.fades(other, now=4.0 - now)
        assert np.abs(np.subtract(first, second)).max() < 1e-5
    lasting = made(at_rest(500), fade=0.0)
    assert np.array_equal(lasting.fades(state, now=99.0), np.ones((2, 500)))


FLIGHT = ParticlesParameters(gravity=(0, -4, 1), wind=(0.7, 0, 0), drag=0.9)


def test_assembling_is_the_mirror_of_dissolving() -> None:
    """Oracle: dissolve's flight in closed form at the mirrored time, in float64, with the impulses
    that dissolve gives; positions 1e-5 of the way, velocities turned round."""
    options = {"by": "random", "start": 0.5, "duration": 2.0, "speed": 1.5}
    gone = at_rest()
    dissolve = made(gone, **options)
    dissolve.release(gone, normals(gone), now=9.0)
    first = gone.velocities.astype(float)
    linear = np.linalg.inv(ASKEW[:3, :3])
    push = linear @ FLIGHT.gravity + FLIGHT.drag * (linear @ FLIGHT.wind)
    state = at_rest()
    goals = state.positions.copy()
    assemble = made(state, mode="assemble", **options)
    for t in (2.9, 1.7, 0.6):
        assemble.place(state, goals, normals(state), FLIGHT, to_world=ASKEW, now=3.0 - t)
        since = t - gone.memory[TIMES].astype(float)
        flew = since > 1e-6
        for i in np.flatnonzero(flew)[:200]:
            way, speed = zip(
                *(closed(first[i, k], push[k], FLIGHT.drag, since[i]) for k in range(3)),
                strict=True,
            )
            assert np.abs(state.positions[i] - goals[i] - way).max() < 1e-5
            assert np.abs(state.velocities[i] + speed).max() < 1e-5
        assert np.array_equal(state.positions[~flew], goals[~flew])
        assert not state.velocities[~flew].any()
        assert np.array_equal((state.flags & FREE) != 0, flew)


def test_after_arrival_splats_are_left_alone() -> None:
    """Oracle: bits. Where goals move on and something pushes, nothing is undone."""
    state = at_rest()
    assemble = made(state, mode="assemble", by="random", duration=1.0, speed=1.0)
    goals = state.positions.copy()
    for now in (0.0, 0.5, 1.1):
        assemble.place(state, goals, normals(state), FLIGHT, to_world=ONE, now=now)
    assert np.array_equal(state.positions, goals) and not (state.flags & FREE).any()
    state.positions = state.positions + np.float32(0.1)
    pushed = state.digest()
    assemble.place(state, goals, normals(state), FLIGHT, to_world=ONE, now=1.2)
    assert state.digest() == pushed
    state.weight[:] = 0
    state.memory.clear()
    unselected = made(state, mode="assemble")
    unselected.place(state, goals, normals(state), FLIGHT, to_world=ONE, now=0.0)
    assert not (state.flags & FREE).any()


def test_steps_of_flight_converge_to_what_assembling_places() -> None:
    """Oracle: the closed form; halving the step halves the error."""
    errors = []
    for steps in (20, 40, 80):
        state = at_rest(100)
        dissolve = made(state, speed=1.5, duration=0.0)
        dissolve.release(state, normals(state), now=0.0)
        for step in range(steps):
            now, dt = step / steps, 1 / steps
            fly(DEVICE, state, FLIGHT, Step(now, dt, 1), to_world=ONE)
        mirror = at_rest(100)
        assemble = made(mirror, mode="assemble", speed=1.5, start=1.0, duration=0.0)
        assemble.place(
            mirror, mirror.positions.copy(), normals(mirror), FLIGHT, to_world=ONE, now=0.0
        )
        errors.append(np.abs(state.positions - mirror.positions).max())
    assert np.all(np.abs(np.array(errors[:-1]) / errors[1:] - 2) < 0.1), errors


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit by bit."""
    digests = set()
    for device in (CpuDevice(threads=1), all_cores()):
        for mode in ("dissolve", "assemble"):
            state = at_rest(5000)
            parameters = DissolveParameters(mode=mode, speed=1.0)
            dissolve = Dissolve.of(device, state, parameters, seed=3)
            dissolve.release(state, normals(state), now=1.0)
            goals = state.rest_positions
            dissolve.place(state, goals, normals(state), FLIGHT, to_world=ONE, now=1.0)
            digests.add(state.digest())
    assert len(digests) == 2
