"""Tests of when a simulation begins, pauses and ends, and of its time step."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.sim.recipes import (
    ARRAYS,
    Written,
    always,
    ball,
    changed,
    deformer,
    driver,
    knobs,
    played,
    pusher,
    started,
)
from usdsplat.kernels.devices import open_device
from usdsplat.sim.solver import Solver
from usdsplat.sim.uses import uses_over


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def lively(time: float, **sim: Any) -> dict[str, Any]:
    """Pushed, bent and coloured."""
    bend = deformer("bend", angle=5 * time)
    tint = driver("opacity", source="distance", in_max=0.3, amount=0.5)
    p = knobs(sim=sim)
    return pusher(time, parameters=p, deformers=(bend,), drivers=(tint,))


def test_before_its_start_nothing_happens(device) -> None:
    """Oracle: the capture's bits until then; then a simulation whose first frame is that one."""
    rest = ball(500)
    late = played(device, Written(rest, lambda time: lively(time, start_time=5.0)), 12)
    other = played(device, Written(rest, lively), 8, start=5.0)
    assert changed(late[:4], rest) == set()
    for a, b in zip(late[4:], other, strict=True):
        assert a.time == b.time
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(a.cloud, name), getattr(b.cloud, name))


def test_frames_may_begin_after_the_simulation(device) -> None:
    """Oracle: the same frames of a bake that begins with the simulation, to the bit."""
    rest = ball(500)
    says = partial(lively, start_time=3.0)
    whole = played(device, Written(rest, says), 10, start=3.0)
    recipe = Written(rest, says)
    uses = uses_over(recipe, range(3, 13))
    solver = Solver(recipe, uses, device=device, start=9.0)
    for expected in whole[6:]:
        frame = solver.frame()
        assert frame.time == expected.time
        for name in (*ARRAYS, "velocities"):
            there = getattr(frame.cloud, name)
            np.testing.assert_array_equal(there, getattr(expected.cloud, name))
        solver.advance()


@pytest.mark.parametrize("how", ["end", "disabled"])
def test_after_its_end_nothing_changes(device, how: str) -> None:
    """Oracle: the bits of the last frame; bends, affectors and drivers that move on do nothing."""

    def says(time: float) -> dict[str, Any]:
        return lively(time, **({"end_time": 6.0} if how == "end" else {"enabled": time <= 6}))

    frames = played(device, Written(ball(500), says), 12)
    for frame, time in zip(frames[6:], range(7, 13), strict=True):
        assert frame.time == time
        assert (frame.cloud.velocities == 0).all()
        for name in ARRAYS:
            there = getattr(frame.cloud, name)
            np.testing.assert_array_equal(there, getattr(frames[5].cloud, name))


def test_a_simulation_that_is_off_goes_on_when_it_is_on_again(device) -> None:
    """Oracle: a restart in between, to the bit; and at the end the bend's own place for splats."""

    def says(time: float) -> dict[str, Any]:
        given = lively(time, enabled=not 4 <= time < 9)
        return {**given, "parameters": replace(
            given["parameters"], settle=knobs(settle={"omega": 60.0}).settle
        )}  # fmt: skip

    rest = ball(500)
    whole = played(device, Written(rest, says), 20)
    solver = started(device, Written(rest, says), 20)
    solver.frame()
    for _ in range(5):
        solver.advance()
        solver.frame()
    state = solver.checkpoint()
    again = started(device, Written(rest, says), 20, state=state)
    for expected in whole[6:]:
        again.advance()
        for name in ARRAYS:
            there = getattr(again.frame().cloud, name)
            np.testing.assert_array_equal(there, getattr(expected.cloud, name))
    still = Written(rest, lambda time: {**lively(20.0), "affectors": ()})
    bent = played(device, still, 1)[0].cloud.positions
    np.testing.assert_allclose(whole[-1].cloud.positions, bent, rtol=0, atol=1e-3)


@pytest.mark.parametrize("rate", [24.0, 30.0, 60.0])
def test_seconds_are_time_codes_over_their_rate(device, rate: float) -> None:
    """Oracle: free fall, g t^2 / 2 up to symplectic Euler's g t dt / 2."""
    p = knobs(particles={"enabled": True, "gravity": (0.0, -9.0, 0.0), "drag": 0.0})
    recipe = Written(ball(200), always(parameters=p), codes_per_second=rate)
    frames = played(device, recipe, 13)
    t = 12 / rate
    fallen = recipe.rest.positions[:, 1] - frames[-1].cloud.positions[:, 1]
    np.testing.assert_allclose(fallen, 4.5 * t * (t + 1 / (4 * rate)), rtol=1e-5)


def test_what_is_off_does_nothing(device) -> None:
    """Oracle: the capture's bits, though affectors, deformers and drivers are there."""
    recipe = Written(ball(300), lambda time: lively(time, enabled=False))
    assert changed(played(device, recipe, 6), recipe.rest) == set()
    assert uses_over(recipe, range(1, 7)).writes == {"positions"}
