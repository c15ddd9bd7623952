"""Tests of choosing the quality of a picture from the times of the last ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from usdsplat.preview import pacing
from usdsplat.preview.pacing import (
    FULL,
    LONGEST_MS,
    MIDDLE_MS,
    MOVING_MS,
    OPENING_MS,
    RESTING_MS,
    SCALES,
    SLACK,
    Load,
    Pacer,
    Quality,
)

LOAD = Load(pixels=960 * 720, splats=100_000)
Cost = Callable[[float], float]


class Machine:
    """Draws nothing, and takes what it is told to by a clock of its own: so much for each splat,
    and for each pixel of the viewport over a power of the scale."""

    def __init__(
        self,
        splat_ns: float,
        pixel_ns: float,
        load: Load = LOAD,
        *,
        power: float = 1.0,
        start: float = 0.0,
    ) -> None:
        self.pacer = Pacer()
        self.power, self.start = power, start
        self.load = load
        self.splat_ns, self.pixel_ns = splat_ns, pixel_ns
        self.now = 0.0

    def took(self, quality: Quality) -> tuple[float, float]:
        samples = self.load.samples if quality.averages else 1
        splats = min(self.load.splats, quality.splats or self.load.splats)
        pixels = self.load.pixels / quality.scale**self.power
        fixed = self.start + 1e-6 * samples * splats * self.splat_ns
        return fixed, self.start + 1e-6 * samples * pixels * self.pixel_ns

    def draw(self, quality: Quality, held_up: float = 1.0) -> float:
        fixed, rest = (held_up * each for each in self.took(quality))
        self.pacer.drew(quality, self.load, fixed=fixed, rest=rest)
        self.now += 1e-3 * (fixed + rest)
        return fixed + rest

    def move(self, seconds: float, held_up: Cost = lambda now: 1.0) -> list[Quality]:
        until, seen = self.now + seconds, []
        while self.now < until:
            seen.append(self.pacer.moving(self.now, self.load))
            self.draw(seen[-1], held_up(self.now))
        return seen


def test_a_movement_begins_with_the_splats_of_the_last_one_if_they_nearly_fit():
    """Oracle: written down by hand: the choice stays within a step, and follows a new machine."""
    machine = Machine(90.0, 20.0, Load(pixels=960 * 720, splats=1_000_000))
    first = machine.move(5.0)[-1]
    assert first.splats is not None
    for held_up in (1.15, 0.9, 1.1):
        machine.pacer.resting(None, machine.load)
        for _ in range(5):
            machine.draw(first, held_up)
        assert machine.pacer.first(machine.load) == first
    for _ in range(5):
        machine.draw(first, 4.0)
    slower = machine.pacer.first(machine.load)
    assert slower.splats is not None and slower.splats < first.splats


def test_the_first_picture_of_a_movement_is_coarser_and_the_next_are_as_they_were():
    """Oracle: the machine's own cost: less than the limit of a first picture, and then what the
    last movement ended with, from the second picture on."""
    machine = Machine(90.0, 20.0, Load(pixels=960 * 720, splats=1_000_000))
    last = machine.move(5.0)[-1]
    for _ in range(5):
        machine.pacer.resting(None, machine.load)
        machine.draw(FULL)
        expected = machine.pacer.opening(machine.load)
        first, *rest = machine.move(0.5)
        assert first == expected
        assert sum(machine.took(first)) <= SLACK * OPENING_MS < sum(machine.took(last))
        assert set(rest) == {last}


def test_a_movement_of_few_splats_begins_as_it_goes_on():
    """Oracle: written down by hand: full pictures are quick enough to be the first."""
    machine = Machine(20.0, 5.0)
    machine.move(2.0)
    machine.pacer.resting(None, machine.load)
    assert set(machine.move(1.0)) == {FULL}


def test_a_machine_that_is_busy_for_a_moment_does_not_make_full_pictures_look_cheap():
    """Oracle: written down by hand: small pictures that took as long as full ones, because other
    programs ran, say that the machine is slow, and not that the number of splats does not matter.
    """
    cost = pacing.Cost(1e-4)
    for _ in range(3):
        cost.learn(1_000_000, 100.0)
    for _ in range(3):
        cost.learn(65_000, 100.0)
    assert cost.of(1_000_000) > 5.0 * cost.of(65_000)


def changes(seen: list[Quality]) -> int:
    return sum(one != two for one, two in pairwise(seen))


@pytest.mark.parametrize("power", [0.7, 1.0, 1.6])
@pytest.mark.parametrize("pixel_ns", [5.0, 40.0, 80.0])
@pytest.mark.parametrize("splat_ns", [5.0, 60.0, 120.0])
def test_a_movement_settles_where_pictures_take_a_thirtieth_of_a_second(splat_ns, pixel_ns, power):
    """Oracle: the machine's own cost, whatever its law: affordable, and the next finer scale would
    not be or is the finest."""
    machine = Machine(splat_ns, pixel_ns, power=power)
    last = machine.move(30.0)[-1]
    assert sum(machine.took(last)) <= SLACK * MOVING_MS
    if last != FULL:
        all_splats = last.splats is None
        finer = SCALES[SCALES.index(last.scale) - 1] if all_splats else last.scale
        more = None if all_splats else round(last.splats * 2**0.5)
        assert sum(machine.took(Quality(scale=finer, splats=more))) > 0.65 * MOVING_MS


def test_the_first_picture_of_a_movement_is_affordable_once_a_picture_was_drawn():
    """Oracle: the machine's own cost, after three full pictures."""
    machine = Machine(50.0, 60.0)
    for _ in range(3):
        machine.draw(FULL)
    first = machine.pacer.moving(machine.now, LOAD)
    assert first.scale > 1.0
    assert sum(machine.took(first)) <= MOVING_MS


@pytest.mark.parametrize("start", [6.0, 8.0])
def test_what_no_saving_saves_does_not_keep_pictures_coarse(start):
    """Oracle: the machine's own cost: when it was busy and is so no more, and some movements and
    full pictures later, the next better picture would be too dear. A model without a constant sees
    it in every splat, and stays at the bottom."""
    machine = Machine(20.0, 10.0, Load(pixels=960 * 720, splats=1_000_000), start=start)
    machine.draw(FULL)
    machine.move(5.0, lambda now: 6.0)
    for _ in range(8):
        machine.draw(FULL)
        last = machine.move(3.0)[-1]
    assert sum(machine.took(last)) <= SLACK * MOVING_MS
    splats = last.splats or machine.load.splats
    better = replace(last, splats=round(splats * 2**0.5)) if last.splats else FULL
    assert sum(machine.took(better)) > 0.75 * MOVING_MS


def test_one_picture_that_was_held_up_changes_nothing():
    """Oracle: the same movement without it."""
    machine = Machine(50.0, 40.0)
    settled = machine.move(10.0)[-1]
    machine.draw(settled, held_up=20.0)
    assert set(machine.move(1.0)) == {settled}


@pytest.mark.parametrize("pixel_ns", np.geomspace(10, 100, 12).tolist())
def test_times_that_vary_do_not_make_quality_flicker(pixel_ns):
    """Oracle: a person sees more than two changes in half a minute, which holds wherever between
    two scales the cost lies."""
    machine = Machine(60.0, pixel_ns)
    machine.move(15.0)
    noise = np.random.default_rng(5)
    assert changes(machine.move(30.0, lambda now: noise.uniform(0.75, 1.3))) <= 2


def test_a_machine_that_is_busy_now_and_then_is_given_up_on():
    """Oracle: patience doubles after each mistake, so that 60 s hold few of them, not 30."""
    machine = Machine(60.0, 30.0)
    machine.move(5.0)
    seen = machine.move(60.0, lambda now: 3.0 if now % 2.0 < 1.0 else 1.0)
    assert changes(seen) <= 24
    assert changes(seen[-len(seen) // 4 :]) <= 6


def test_finer_pictures_return_when_a_dear_view_is_over():
    """Oracle: what the movement had before."""
    machine = Machine(40.0, 15.0)
    before = machine.move(10.0)[-1]
    machine.pixel_ns *= 5
    assert machine.move(5.0)[-1].scale > before.scale
    machine.pixel_ns /= 5
    assert machine.move(40.0)[-1] == before


def test_splats_that_take_too_long_are_left_out():
    """Oracle: a million splats at 100 ns take 100 ms whatever the scale; with the budget the
    picture is affordable, and at rest none is left out."""
    machine = Machine(100.0, 30.0, Load(pixels=960 * 720, splats=1_000_000))
    seen = machine.move(10.0)
    assert sum(machine.took(seen[-1])) <= SLACK * MOVING_MS
    assert changes(seen[len(seen) // 2 :]) == 0
    assert machine.pacer.resting(None, machine.load).splats is None


def test_a_stage_that_grows_changes_quality_by_steps():
    """Oracle: a million splats become two within a movement; each step is a budget's."""
    machine = Machine(100.0, 10.0, Load(pixels=960 * 720, splats=1_000_000))
    seen = machine.move(5.0)
    for splats in range(1_000_000, 2_000_000, 20_000):
        machine.load = replace(machine.load, splats=splats)
        seen += machine.move(0.1)
    assert seen[-1].splats is not None and changes(seen[len(seen) // 3 :]) <= 3


def test_rest_is_full_at_once_when_that_is_quick():
    """Oracle: 100 ms are less than what a person waits for."""
    machine = Machine(100.0, 100.0)
    machine.move(2.0)
    assert sum(machine.took(FULL)) < RESTING_MS
    assert machine.pacer.resting(None, LOAD) == FULL


def test_rest_has_a_step_between_when_the_full_picture_takes_long():
    """Oracle: the machine's own cost, and the picture that is shown."""
    machine = Machine(100.0, 300.0)
    coarse = machine.move(5.0)[-1]
    middle = machine.pacer.resting(coarse, LOAD)
    assert 1.0 < middle.scale < coarse.scale
    assert sum(machine.took(middle)) <= 1.2 * MIDDLE_MS  # learned from coarser ones
    machine.draw(middle)
    assert machine.pacer.resting(middle, LOAD) == FULL
    machine.draw(FULL)
    assert machine.pacer.resting(FULL, LOAD) == FULL


def test_one_sample_is_enough_until_the_view_rests():
    """Oracle: 64 samples take 64 times as long as one."""
    machine = Machine(100.0, 20.0, Load(pixels=960 * 720, splats=100_000, samples=64))
    assert not any(quality.averages for quality in machine.move(2.0))
    middle = machine.pacer.resting(None, machine.load)
    assert not middle.averages and middle.scale == 1.0
    assert machine.pacer.resting(middle, machine.load) == FULL


def test_quality_compares_by_its_worst():
    """Oracle: by hand."""
    assert FULL.is_at_least(Quality(scale=2.0))
    assert not Quality(scale=2.0).is_at_least(FULL)
    assert not Quality(splats=10).is_at_least(FULL)
    assert FULL.is_at_least(Quality(splats=10))
    assert not Quality(averages=False).is_at_least(FULL)


def test_where_nothing_is_affordable_quality_is_not_given_away_for_nothing():
    """Oracle: what cannot be saved takes 100 ms, all that can be 10 ms: no picture is worth it."""
    load = Load(pixels=960 * 720, splats=1000)
    pacer = Pacer()
    for number in range(12):
        quality = pacer.moving(0.1 * number, load)
        pacer.drew(quality, load, fixed=100.0, rest=10.0 / quality.scale)
    assert quality == FULL


def test_trees_at_rest_have_a_budget_that_is_kept():
    """Oracle: the cost of the machine: the final picture of any number of splats takes at most
    LONGEST_MS, is one of whole pixels, and is not drawn again with another budget."""
    load = Load(pixels=700_000, splats=25_000_000, has_trees=True)
    pacer, shown = Pacer(), None
    for _ in range(3):  # the cost is known from a movement
        pacer.drew(Quality(scale=3.0, splats=100_000), load, fixed=70.0, rest=5.0)
    for _ in range(8):
        quality = pacer.resting(shown, load)
        count = quality.splats or load.splats
        pacer.drew(quality, load, fixed=700e-6 * count, rest=30.0)
        if quality == shown:
            break
        shown = quality
    assert shown.is_whole and shown.splats is not None
    assert 0.5 * LONGEST_MS < 700e-6 * shown.splats < LONGEST_MS
    assert pacer.resting(shown, load) == shown
    few = replace(load, splats=100_000)
    assert Pacer().resting(None, few) == FULL
    assert Pacer()._final(replace(load, has_trees=False)) == FULL


def test_times_of_other_levels_tell_nothing_of_a_constant():
    """Oracle: a movement that begins after a dear picture at rest, and whose pictures cost 200 ns a
    splat, is cheap soon."""
    load = Load(pixels=700_000, splats=25_000_000, samples=4, has_trees=True)
    pacer = Pacer()
    pacer.drew(Quality(splats=3_000_000), replace(load, splats=1_000_000), fixed=1800, rest=380)
    pacer.drew(Quality(splats=3_000_000), load, fixed=2800, rest=450)
    for number in range(12):
        quality = pacer.moving(float(number), load)
        took = 200e-6 * (quality.splats or load.splats)
        pacer.drew(quality, load, fixed=took, rest=5.0)
    assert took < 50
