"""Tests of growth, births and deaths."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import GrowthParameters
from usdsplat.sim.population import (
    DYING_SINCE,
    HUNGRY,
    PROGRESS,
    births,
    deaths,
    fades,
    grow,
)
from usdsplat.sim.state import ALIVE, BORN, DYING, FREE, PINNED, State
from usdsplat.sim.support import Neighborhood
from usdsplat.sim.timeline import Step

DEVICE = open_device()
EAGER = GrowthParameters(birth_rate=1e3, v_min=0.1, v_max=0.2, birth_fade=0.5, death_fade=0.5)


def capture(n=200, seed=0) -> State:
    """Splats with a pattern, at rest, of which nothing is alike."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(n, 4))
    state = State.of(
        SplatCloud(
            positions=rng.uniform(-1, 1, (n, 3)).astype(np.float32),
            scales=rng.uniform(0.01, 0.1, (n, 3)).astype(np.float32),
            rotations=(turns / np.linalg.norm(turns, axis=1)[:, None]).astype(np.float32),
            opacities=rng.uniform(0, 0.99, n).astype(np.float32),
            sh=rng.normal(size=(n, 4, 3)).astype(np.float32),
        )
    )
    state.uv[:, 1] = rng.uniform(0, 0.4, n)
    state.support[:] = rng.uniform(0.1, 0.2, n)
    return state


def normals(n, seed=1) -> np.ndarray:
    """Unit vectors."""
    drawn = np.random.default_rng(seed).normal(size=(n, 3))
    return (drawn / np.linalg.norm(drawn, axis=1)[:, None]).astype(np.float32)


def have(state, growth=EAGER, *, device=DEVICE, **options) -> np.ndarray:
    """Births of a step."""
    around = {
        "crowding": np.zeros(len(state), np.float32),
        "normals": normals(len(state)),
        "dimension": 2,
        "target": 16.0,
        "usual_support": 0.15,
    }
    around |= {name: options.pop(name) for name in around.keys() & options.keys()}
    step = Step(options.pop("now", 1.0), options.pop("dt", 0.1), options.pop("seed", 5))
    settings = {"maximum": 10**6} | options
    return births(device, state, growth, step, Neighborhood(**around), **settings)


def depth(opacities) -> np.ndarray:
    """Optical depth -ln(1 - a)."""
    return -np.log1p(-opacities.astype(float))


def check(state) -> None:
    """What is so of every state: identities unique and ascending, arrays of one length."""
    assert np.all(np.diff(state.ids) > 0) and state.ids.max() < state.next_id
    assert {len(array) for _, array in state.per_splat()} == {len(state)}


def test_growth_is_along_the_normal_and_bounded() -> None:
    """Oracle: dt g S(v) n in float64, a fifth of the support at most; the way now is the way at
    rest turned from one quaternion to the other, here by a half turn about z."""
    state = capture()
    state.rest_rotations = np.tile(np.float32([1, 0, 0, 0]), (len(state), 1))
    state.rotations[:] = (0, 0, 0, 1)
    state.flags[:3] |= np.uint32([PINNED, FREE, DYING])
    rest, now = state.rest_positions.copy(), state.positions.copy()
    growth = GrowthParameters(rate=0.6)
    factor = np.linspace(0, 4, len(state)).astype(np.float32)
    n = normals(len(state))
    grow(DEVICE, state, growth, dt=0.1, normals=n, rate_factor=factor)
    t = np.clip((state.uv[:, 1].astype(float) - 0.15) / 0.2, 0, 1)
    far = np.minimum(0.06 * factor * t * t * (3 - 2 * t), 0.2 * state.support)
    far[:3] = 0
    assert (far == 0.2 * state.support).any() and ((far > 0) & (far < 0.2 * state.support)).any()
    way = far[:, None] * n
    assert np.abs(state.rest_positions - rest - way).max() < 2e-7
    assert np.abs(state.positions - now - way * (-1, -1, 1)).max() < 2e-7
    grow(DEVICE, state, GrowthParameters(rate=-1e9), dt=1, normals=n)
    shrunk = np.linalg.norm(state.rest_positions - rest - way, axis=1)
    expected = np.where((t > 0) & (np.arange(len(t)) > 2), 0.2 * state.support, 0)
    assert np.abs(shrunk - expected).max() < 1e-6


def test_09_ids_ascend_and_optical_depth_is_conserved() -> None:
    """Oracle: the sum of -ln(1 - a), relative 1e-6, over twelve generations; identities by their
    definition: the next ones, in the order of the parents'."""
    state = capture()
    state.opacities[0] = state.rest_opacities[0]
    before = depth(state.rest_opacities).sum()
    first = state.next_id
    for step in range(12):
        state.step = step
        parents = have(state, usual_support=0.3, now=step / 10)
        new = len(state) - len(parents)
        assert np.array_equal(state.parents[new:], state.ids[parents])
        assert np.array_equal(state.ids[new:], first + np.arange(len(parents)))
        first += len(parents)
        check(state)
        if len(state) > 20_000:
            break
    assert len(state) > 5000
    assert abs(depth(state.rest_opacities).sum() / before - 1) < 1e-6
    assert abs(depth(state.opacities).sum() / before - 1) < 1e-6


def test_a_child_is_its_parent_half_a_spacing_away() -> None:
    """Oracle: each array by its definition; directions across the normal, all ways alike."""
    state = capture(4000)
    state.memory["other:thing"] = np.arange(8000).reshape(4000, 2)
    state.memory[HUNGRY] = np.full(4000, 0.2, np.float32)
    old = {name: array.copy() for name, array in state.per_splat()}
    n = normals(len(state))
    parents = have(state, normals=n, now=2.5)
    b, at = len(parents), len(old["ids"])
    assert 2000 < b < 4000
    same = ("rotations", "scales", "sh", "rest_rotations", "rest_scales", "rest_sh", "velocities",
            "support", "uv", "weight", "memory:other:thing")  # fmt: skip
    arrays = dict(state.per_splat())
    for name in same:
        assert np.array_equal(arrays[name][at:], old[name][parents]), name
        assert np.array_equal(arrays[name][:at], old[name]), name
    assert np.all(state.flags[at:] == ALIVE | BORN) and np.all(state.births[at:] == 2.5)
    way = (state.rest_positions[at:] - old["rest_positions"][parents]).astype(float)
    assert not state.memory[HUNGRY][at:].any() and not state.memory[PROGRESS][at:].any()
    spacing = old["support"][parents] * np.sqrt(np.pi / 16)
    assert np.abs(np.linalg.norm(way, axis=1) / spacing - 0.5).max() < 2e-5
    assert np.abs((way * n[parents]).sum(1)).max() < 1e-6
    assert np.abs(np.mean(way / spacing[:, None], 0)).max() < 0.02
    moved = state.positions[at:] - old["positions"][parents]
    assert np.abs(moved - way).max() < 1e-6  # not turned
    for name in ("positions", "rest_positions"):
        assert np.array_equal(arrays[name][:at], old[name])


def test_children_follow_the_turn_and_fill_volumes() -> None:
    """Oracle: a half turn about z; in three dimensions, or without a normal, the second moment of
    directions is a third in each axis."""
    for dimension, n in ((3, normals(4000)), (2, np.zeros((4000, 3), np.float32))):
        state = capture(4000)
        state.rest_rotations = np.tile(np.float32([1, 0, 0, 0]), (4000, 1))
        state.rotations[:] = (0, 0, 0, 1)
        parents = have(state, dimension=dimension, normals=n)
        way = state.rest_positions[4000:] - state.rest_positions[parents]
        moved = state.positions[4000:] - state.positions[parents]
        assert np.abs(moved - way * np.float32([-1, -1, 1])).max() < 1e-6
        factor = (4 * np.pi / 48) ** (1 / 3) if dimension == 3 else np.sqrt(np.pi / 16)
        length = np.linalg.norm(way, axis=1)
        assert np.abs(length / (0.5 * factor * state.support[parents]) - 1).max() < 1e-4
        moment = (way / length[:, None]).T @ (way / length[:, None]) / len(way)
        assert np.abs(moment - np.eye(3) / 3).max() < 0.03


def test_the_next_child_goes_another_way() -> None:
    """Oracle: ways of the same parents in two steps are not correlated; in one step they are
    equal."""
    ways = []
    for step in (3, 4, 3):
        state = capture(4000)
        state.step = step
        parents = have(state)
        ways.append((state.rest_positions[4000:] - state.rest_positions[parents]).ravel())
    assert abs(np.corrcoef(ways[0], ways[1])[0, 1]) < 0.05
    assert np.array_equal(ways[0], ways[2])


def test_harmonics_stay_shared_and_stay_apart() -> None:
    """Oracle: identity of the arrays, through a birth and a death."""
    state = capture()
    have(state)
    assert state.sh is state.rest_sh
    state.positions[7] = np.nan
    deaths(state, EAGER, now=1.0, dt=0.1)
    assert state.sh is state.rest_sh
    state.sh = state.rest_sh.copy()
    have(state, now=2.0)
    assert state.sh is not state.rest_sh and not np.shares_memory(state.sh, state.rest_sh)


def test_rate_of_births() -> None:
    """Oracle: rate times time times S(v) (h / usual_support)^d, in the mean over splats that begin
    anywhere, and to one child for each; crowded children have none."""
    for dimension, speed in ((2, 0.5), (3, 0.5), (2, 6.0)):
        growth = GrowthParameters(birth_rate=speed, v_min=0.1, v_max=0.3)
        state = capture(5000)
        t = np.clip((state.uv[:, 1].astype(float) - 0.1) / 0.2, 0, 1)
        rate = speed * t * t * (3 - 2 * t) * (state.support / 0.2) ** dimension
        count = np.zeros(5000)
        for _ in range(40):
            crowding = (9 * (np.arange(len(state)) >= 5000)).astype(np.float32)
            born = have(state, growth, dimension=dimension, usual_support=0.2, crowding=crowding)
            count += np.bincount(born, minlength=5000)
        assert abs(count.mean() / (4.0 * rate.mean()) - 1) < 0.02
        assert np.all(np.abs(count - 4.0 * rate) <= 1 + 1e-4)


def test_the_crowded_wait() -> None:
    """Oracle: the threshold; those that waited have one child, not all they missed."""
    state = capture()
    crowding = np.where(np.arange(len(state)) % 2, 1.3, 1.2).astype(np.float32)
    assert np.all(have(state, crowding=crowding) % 2 == 0)
    for _ in range(20):
        have(state, crowding=np.full(len(state), 1.25, np.float32), now=2.0)
    assert state.memory[PROGRESS].max() <= 1
    quiet = GrowthParameters(birth_rate=0.0)
    waited = np.flatnonzero(state.memory[PROGRESS] == 1)
    assert len(waited) > 50
    assert np.array_equal(have(state, quiet), waited)
    assert len(have(state, quiet)) == 0


def test_births_end_at_the_maximum_in_the_order_of_identities() -> None:
    """Oracle: the first of those that would have children without it."""
    free, full = capture(), capture()
    wanted = have(free)
    assert np.array_equal(have(full, maximum=230), wanted[:30]) and len(full) == 230
    assert len(have(full, maximum=230)) == 0 == len(have(full, maximum=10))
    assert full.memory[PROGRESS][wanted[30:]].max() == 1
    check(full)


def test_the_flying_and_the_dying_have_no_children() -> None:
    """Oracle: the flags."""
    state = capture()
    state.flags[::3] |= FREE
    state.flags[1::3] |= DYING
    assert np.all(have(state) % 3 == 2)


def test_fades_are_functions_of_age() -> None:
    """Oracle: smoothstep, written out; at birth parent and child look as the parent did, the
    optical depth of a parent falls to half of it without a jump."""
    state = capture()
    old = state.rest_opacities.copy()
    parents = have(state, now=1.1)
    for now in (1.1, 1.2, 1.45, 1.6, 7.0):
        alpha, size = fades(state, EAGER, now=now)
        t = min(1.0, (now - 1.1) / 0.5)
        e = t * t * (3 - 2 * t)
        assert np.all(size[:200] == 1) and np.abs(size[200:] - e).max() < 1e-6
        drawn = depth(alpha * state.rest_opacities)
        assert np.abs(drawn[parents] / depth(old[parents]) - (1 - e / 2)).max() < 2e-5
        assert np.all(alpha[200:] == 1)
        assert np.all(np.delete(alpha[:200], parents) == 1)
    have(state, now=1.2)
    alpha, _ = fades(state, EAGER, now=1.2)
    assert np.all(alpha[200 + len(parents) :] == 1) and np.all(alpha[parents] > 1.1)
    state.rest_opacities[:] = np.repeat(np.float32([0, 1]), [100, len(state) - 100])
    alpha, _ = fades(state, EAGER, now=1.2)
    assert np.all(alpha[parents[parents < 100]] == 2) and np.all(alpha[parents[parents > 100]] == 1)


def test_the_born_die_of_age_and_fade() -> None:
    """Oracle: times; captured splats do not age."""
    growth = GrowthParameters(birth_rate=1e3, v_min=0.1, v_max=0.2, life=2.0, death_fade=0.5)
    state = capture()
    have(state, growth, now=1.0)
    n = len(state)
    assert deaths(state, growth, now=2.9, dt=0.1) is None and not (state.flags & DYING).any()
    assert deaths(state, growth, now=3.1, dt=0.1) is None
    assert np.array_equal((state.flags & DYING) != 0, np.arange(n) >= 200)
    alpha, _ = fades(state, growth, now=3.35)
    assert np.all(alpha[:200] == 1) and np.abs(alpha[200:] - 0.5).max() < 1e-5
    assert deaths(state, growth, now=3.55, dt=0.1) is None
    left = deaths(state, growth, now=3.65, dt=0.1)
    assert np.array_equal(left, np.arange(200)) and len(state) == 200
    check(state)
    assert state.next_id == n  # never used twice


def test_the_born_starve() -> None:
    """Oracle: a clock that is set back by food, one for each splat."""
    growth = GrowthParameters(birth_rate=1e3, v_min=0.1, v_max=0.2, starve=0.35, death_fade=0.0)
    state = capture()
    have(state, growth, now=0.0)
    n = len(state)
    fed = np.arange(n) % 2 == 0
    for step in range(1, 5):
        state.uv[:, 1] = np.where(fed[np.isin(np.arange(n), state.ids)] & (step == 2), 0.3, 0.05)
        left = deaths(state, growth, now=step / 10, dt=0.1)
        assert (left is None) == (step < 4)
    assert np.array_equal(state.ids, np.flatnonzero((np.arange(n) < 200) | fed))
    assert np.abs(state.memory[HUNGRY] - np.where(state.ids % 2 == 0, 0.2, 0.4)).max() < 1e-6


def test_splats_that_are_nowhere_go_at_once_and_memory_follows() -> None:
    """Oracle: NumPy's choice of rows of each array."""
    state = capture()
    state.memory["other:thing"] = np.arange(400).reshape(200, 2)
    state.positions[[3, 50], [0, 2]] = np.nan, np.inf
    old = {name: array.copy() for name, array in state.per_splat()}
    left = deaths(state, GrowthParameters(), now=0.0, dt=0.1)
    assert np.array_equal(left, np.delete(np.arange(200), [3, 50]))
    for name, array in state.per_splat():
        assert np.array_equal(array, np.delete(old[name], [3, 50], axis=0)), name
    assert DYING_SINCE not in state.memory


def test_equals_are_not_born_at_once() -> None:
    """Oracle: splats of the same rate are due evenly over its period."""
    state = capture(2000)
    state.uv[:, 1] = 0.4
    state.support[:] = 0.15
    counts = [len(have(state, GrowthParameters(birth_rate=1.0))) for _ in range(9)]
    assert np.abs(np.array(counts) - 200).max() < 70


@pytest.mark.parametrize("seed", range(6))
def test_any_sequence_keeps_the_state_sound_and_threads_do_not_matter(seed) -> None:
    """Oracle: invariants after each of a random sequence of births, deaths and patterns; one
    thread, bit by bit."""
    digests = []
    for device in (CpuDevice(threads=1), all_cores()):
        rng = np.random.default_rng(seed)
        state = capture(1500, seed)
        gone: set[int] = set()
        for step in range(30):
            state.step = step
            state.uv[:, 1] = rng.uniform(0, 0.5, len(state))
            growth = GrowthParameters(
                birth_rate=rng.choice([0.0, 3.0, 30.0]),
                life=rng.choice([np.inf, 0.5]),
                starve=rng.choice([np.inf, 0.1]),
                death_fade=rng.choice([0.0, 0.3]),
                rate=0.1,
            )
            if rng.random() < 0.2:
                state.positions[rng.integers(len(state))] = np.nan
            grow(device, state, growth, dt=0.1, normals=normals(len(state)))
            crowding = rng.uniform(0.5, 1.5, len(state)).astype(np.float32)
            have(state, growth, device=device, crowding=crowding, maximum=2500, now=step / 10)
            before = set(state.ids.tolist())
            assert not before & gone and len(state) <= 2500
            captured = set(state.ids[np.isfinite(state.positions).all(1) & (state.parents < 0)])
            deaths(state, growth, now=step / 10, dt=0.1)
            gone |= before - set(state.ids.tolist())
            assert captured <= set(state.ids)
            check(state)
            alpha, size = fades(state, growth, now=step / 10)
            assert np.isfinite([alpha, size]).all() and alpha.min() >= 0 <= size.min()
            assert (alpha * state.rest_opacities).max() <= 1
        assert gone
        digests.append(state.digest())
    assert digests[0] == digests[1]
