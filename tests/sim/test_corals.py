"""Tests of corals. Oracles: closed forms of branches, and geometry on a sphere of carriers."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.recipes import ARRAYS, Written, always, ball, knobs, played
from tests.sim.sphere import front_from_above, sphere
from usdsplat.core import edit
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim.branches import FLARE, RAISED, TAPER
from usdsplat.sim.branches import THINNER, THINNEST, Branches, across, aside, passed, unit
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.corals import GROWING, Corals

SIZE, LAYERS, FULL = 4.0, 6, 0.5
UP = np.float32((0, 1, 0))
LATE = 100.0


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


@pytest.fixture(scope="module")
def carriers(device) -> Carriers:
    """Carriers on the unit sphere."""
    return sphere(device)


@pytest.fixture(scope="module")
def corals(device, carriers) -> Corals:
    """Corals everywhere."""
    return made(device, carriers, np.ones(len(carriers), np.float32))


@pytest.fixture(scope="module")
def arrival(carriers) -> np.ndarray:
    """A front from the highest point, which takes two seconds to the lowest."""
    return front_from_above(carriers)


def made(device, carriers, allowed) -> Corals:
    """Corals on the carriers that may grow."""
    corals = Corals(device, carriers, SIZE, 1)
    corals.keep_to(allowed, LAYERS, UP)
    return corals


def every(carriers, rows=None) -> tuple[np.ndarray, np.ndarray]:
    """Carrier and number of all splats of branches."""
    rows = np.arange(len(carriers)) if rows is None else rows
    layer = np.tile(np.arange(LAYERS, dtype=np.int32), len(rows))
    return np.repeat(rows, LAYERS).astype(np.int32), layer


def test_a_branch_grows_along_its_line() -> None:
    """Oracle: closed forms: it ends at `offsets + lengths (axes + bends)`, has the direction
    `axes + 2 bends` there, and passes u at the part 1 - sqrt(1 - u) of its time."""
    x, y = np.float32([[1, 0, 0]]), np.float32([[0, 1, 0]])
    one = np.ones(1, np.float32)
    branch = Branches(
        site=np.zeros(1, np.int64), colony=np.zeros(1, np.int64), roots=x, offsets=y, axes=x,
        bends=0.5 * y, lengths=2 * one, radii=0.1 * one, delays=one, times=4 * one,
    )  # fmt: skip
    end, along = branch.line(one)
    np.testing.assert_allclose(end, [[2, 2, 0]])
    np.testing.assert_allclose(along, [[0.5**0.5, 0.5**0.5, 0]], rtol=1e-6)
    assert branch.grown(3 * one, 4.0) == 0 and branch.grown(3 * one, 8.0) == 1
    u = np.float32([0.36])
    np.testing.assert_allclose(branch.grown(3 * one, 4 + 4 * float(passed(u)[0])), u, rtol=1e-6)
    np.testing.assert_allclose(branch.areas(), 2 * np.pi * 0.1 * (1 - TAPER / 2) * 2, rtol=1e-6)


def test_side_branches_leave_what_has_grown_already(corals) -> None:
    """Oracle: the branches of the same finger: each side branch begins on the middle line of a
    thicker one, when that one's tip passes."""
    b = corals.branches
    side = np.flatnonzero(b.delays > 0)
    assert len(side) > 100 and (b.delays[side] > 0.05 * GROWING).all()
    u = np.linspace(0, 1, 401, dtype=np.float32)
    for i in side[::7]:
        others = np.flatnonzero((b.site == b.site[i]) & (b.delays < b.delays[i]))
        found = []
        for j in others:
            rows = b.taken(np.full(len(u), j))
            points, _ = rows.line(u)
            apart = np.linalg.norm(points - b.offsets[i], axis=1)
            at = np.argmin(apart)
            when = b.delays[j] + b.times[j] * passed(u[at])
            thin = max(THINNER * b.radii[j] * (1 - TAPER * u[at]), THINNEST)
            found.append((apart[at], abs(when - b.delays[i]), abs(thin - b.radii[i])))
        assert any(a < 0.004 and t < 0.01 and r < 0.001 for a, t, r in found)


def test_branches_have_many_lengths_and_lean_out(corals) -> None:
    """Oracle: the ball: fingers leave it, the longest has about the length 1, and side branches are
    shorter than their finger."""
    b = corals.branches
    np.testing.assert_allclose(np.linalg.norm(b.axes, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose((b.axes * b.bends).sum(axis=1), 0, atol=1e-5)
    finger = b.delays == 0
    outward = (b.axes * b.roots).sum(axis=1)[finger]
    assert (outward > 0).mean() > 0.95
    assert 0.6 < b.lengths.max() <= 1 and b.lengths[finger].max() > 2.5 * b.lengths[finger].min()
    assert b.lengths[~finger].max() < b.lengths[finger].max()


def test_splats_cover_branches_evenly(corals, carriers) -> None:
    """Oracle: areas: of the splats of a colony, each branch has its part, give or take one."""
    b = corals.branches
    carrier, layer = every(carriers)
    branch = corals._slots.branch[corals._slot(carrier, layer)]
    count = np.bincount(branch, minlength=len(b))
    of_colony = np.bincount(b.colony, weights=count)[b.colony]
    areas = b.areas().astype(np.float64)
    part = areas / np.bincount(b.colony, weights=areas)[b.colony]
    np.testing.assert_array_less(np.abs(count - of_colony * part), 1 + 1e-3)
    assert len(np.unique(corals._slot(carrier, layer))) == len(carrier)


def test_splats_lie_on_tapered_branches_with_round_tips(corals, carriers, arrival) -> None:
    """Oracle: the distance from the middle line: the radius times (1 - taper s), wider at roots,
    and where less than the tip's radius is left, that of a hemisphere; polyps stand out."""
    b = corals.branches
    carrier, layer = every(carriers)
    slot = corals._slot(carrier, layer)
    own, s = b.taken(corals._slots.branch[slot]), corals._slots.part[slot]
    at = corals.placed(carrier, layer, FULL, arrival, LATE)
    middle, along = own.line(s)
    out = (at.positions - own.roots) / FULL - middle
    tip = own.radii * (1 - TAPER)
    below = np.clip((1 - s) * own.lengths / tip, 0, 1)
    flare = np.where(own.delays == 0, FLARE * np.exp(-9 * s), 0)
    radius = own.radii * (1 - TAPER * s + flare) * np.sqrt(1 - (1 - below) ** 2)
    raised = corals._slots.polyp[slot] * RAISED * own.radii
    far = np.linalg.norm(out, axis=1)
    assert (np.abs(far - radius) < raised + 2e-4).all()
    np.testing.assert_allclose(np.linalg.norm(at.normals, axis=1), 1, atol=1e-4)
    round_tip = below < 0.3
    assert round_tip.any() and ((at.normals * along).sum(axis=1)[round_tip] > 0.69).all()
    assert (at.spread > 0).all()


def test_tips_are_pale_and_roots_are_deep(corals, carriers, arrival) -> None:
    """Oracle: the end of the ramp at the tips of long branches, without tint; shadow at roots."""
    carrier, layer = every(carriers)
    slot = corals._slot(carrier, layer)
    own = corals.branches.taken(corals._slots.branch[slot])
    s = corals._slots.part[slot]
    at = corals.placed(carrier, layer, FULL, arrival, LATE)
    tip = (s > 0.98) & (own.lengths > 0.3)
    root = (s < 0.1) & (own.delays == 0)
    assert at.tones[tip].min() > 0.9 and at.tints[tip].max() < 0.3
    assert at.tones[root].max() < 0.4 and at.tints[root].min() > 0.9
    assert at.opened[root].max() < 0.6 < at.opened[tip].min()


def test_branches_appear_behind_the_front_and_lengthen(corals, carriers, arrival) -> None:
    """Oracle: the front: what has not begun is hidden, nothing is ahead of the front by more than a
    finger, and no tip ever goes back."""
    carrier, layer = every(carriers)
    own = corals.branches.taken(corals._slots.branch[corals._slot(carrier, layer)])
    far = np.zeros(len(carrier))
    for now in (0.2, 0.6, 1.0, 2.0, 4.0):
        at = corals.placed(carrier, layer, FULL, arrival, now)
        shown = at.spread > 0
        assert (shown == (arrival[own.site] + own.delays < now)).all()
        assert corals.at(arrival, now).begun[carrier[shown]].all()
        middle, _ = own.line(corals.branches.grown(arrival[corals.branches.site], now)[
            corals._slots.branch[corals._slot(carrier, layer)]])  # fmt: skip
        along = ((middle - own.offsets) * own.axes).sum(axis=1)
        assert (along >= far - 1e-6).all()
        far = along
    assert shown.all()
    never = corals.placed(carrier, layer, FULL, np.full_like(arrival, np.inf), LATE)
    assert not never.spread.any() and np.isfinite(never.positions).all()


def test_splats_of_branches_move_with_their_root(corals, carriers) -> None:
    """Oracle: the branches: sites of fingers for their splats, the carrier itself for the crust."""
    carrier, layer = every(carriers)
    rows = corals.roots(carrier, layer)
    branch = corals._slots.branch[corals._slot(carrier, layer)]
    assert np.array_equal(rows, corals.branches.site[branch])
    assert np.array_equal(corals.roots(carrier, np.full_like(layer, -1)), carrier)


@pytest.mark.parametrize("count", [0, 1, 40])
def test_few_carriers_may_grow(device, carriers, arrival, count) -> None:
    """Oracle: their number: all their splats are finite, and roots are carriers that may grow."""
    allowed = np.zeros(len(carriers), np.float32)
    rows = np.argsort(-carriers.positions[:, 0], kind="stable")[:count]
    allowed[rows] = 0.5
    corals = made(device, carriers, allowed)
    carrier, layer = every(carriers, rows)
    at = corals.placed(carrier, layer, FULL, arrival, LATE)
    assert len(at.positions) == count * LAYERS
    for values in (at.positions, at.normals, at.tones, at.opened, at.spread):
        assert np.isfinite(values).all()
    assert (allowed[corals.branches.site] > 0).all() and bool(len(corals.branches)) == bool(count)
    if count:
        assert (at.spread > 0).any()


def test_helpers_are_perpendicular() -> None:
    """Oracle: dot products."""
    rng = np.random.default_rng(1)
    a = unit(rng.normal(size=(50, 3)))
    b = np.float32(rng.normal(size=(50, 3)))
    x, y = across(a)
    for u, v in ((x, a), (y, a), (x, y), (aside(b, a), a)):
        np.testing.assert_allclose((u * v).sum(axis=1), 0, atol=1e-6)


def test_coral_grows_on_the_capture_within_its_relief(device) -> None:
    """Oracle: the arrays of the capture, bit for bit, at the first frame and below at the last; the
    radius of the ball: nothing inside by more than a radius, fingers no farther out than theirs and
    their side branches' length."""
    rest, relief, spacing = ball(700), 8.0, 0.12
    parameters = knobs(
        sim={"seed": 4},
        rd={"enabled": True, "substeps": 1, "pattern_scale": spacing, "front_speed": 40.0,
            "seeds": 2},
        accretion={"enabled": True, "motif": "corals", "motif_size": 4.0, "relief": relief},
        refine={"enabled": "off"},
    )  # fmt: skip
    frames = played(device, Written(rest, always(parameters=parameters)), 40)
    for name in ARRAYS:
        assert np.array_equal(getattr(frames[0].cloud, name), getattr(rest, name))
    own = edit.take(frames[-1].cloud, frames[-1].cloud.ids < 700)
    for name in ARRAYS:
        assert np.array_equal(getattr(own, name), getattr(rest, name))
    new = edit.take(frames[-1].cloud, frames[-1].cloud.ids >= 700)
    radius = np.linalg.norm(new.positions, axis=1)
    assert 1 + 0.5 * relief * spacing < radius.max() < 1 + 1.35 * relief * spacing
    assert (radius > 1 - 0.1 * relief * spacing).mean() > 0.97


def test_one_layer_is_the_crust_alone(device) -> None:
    """Oracle: the radius of the ball, from which a crust rises by less than a fifth of the longest
    finger."""
    spacing, relief = 0.12, 8.0
    parameters = knobs(
        rd={"enabled": True, "substeps": 1, "pattern_scale": spacing, "front_speed": 40.0,
            "seeds": 2},
        accretion={"enabled": True, "motif": "corals", "relief": relief, "layers": 1},
        refine={"enabled": "off"},
    )  # fmt: skip
    frames = played(device, Written(ball(700), always(parameters=parameters)), 20)
    new = edit.take(frames[-1].cloud, frames[-1].cloud.ids >= 700)
    assert len(new) > 100 and (new.opacities > 0.5).any()
    assert np.abs(np.linalg.norm(new.positions, axis=1) - 1).max() < 0.2 * relief * spacing
