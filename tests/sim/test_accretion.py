"""Tests of new matter that grows on a field, through the solver. Oracles: the capture, the geometry
of a sphere, and runs that must give the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sim.recipes import ARRAYS, Written, always, ball, knobs, played, started
from usdsplat.core import edit
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.accretion import CARRIER
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.seeds import SEED_RADIUS
from usdsplat.sim.state import Frame

SPACING = 0.16
"""Distance of carriers; the ball has the radius 1."""
SPEED = 24.0
"""Of the front [distance of carriers/s]."""


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


def growing(
    style: str = "custom", rest: Any = None, selection: Any = None, **groups: Any
) -> Written:
    """A ball on which new matter grows from one seed."""
    parameters = knobs(
        sim={"seed": 4, **groups.pop("sim", {})},
        rd={"enabled": True, "preset": "coral", "substeps": 30, "pattern_scale": SPACING,
            "front_speed": SPEED, "seeds": 1, **groups.pop("rd", {})},
        accretion={"enabled": True, "style": style, **groups.pop("accretion", {})},
        refine={"enabled": "off"},
        **groups,
    )  # fmt: skip
    return Written(ball(700) if rest is None else rest, always(parameters=parameters), selection)


@pytest.fixture(scope="module")
def grown(device) -> list[Frame]:
    """Frames of the pattern on the ball."""
    return played(device, growing(), 16)


def new(frame: Frame) -> np.ndarray:
    """Which splats are new matter."""
    return frame.cloud.ids >= 700


def test_the_first_frame_is_the_capture(grown) -> None:
    """Oracle: the arrays, bit for bit."""
    rest = ball(700)
    for name in ARRAYS:
        assert np.array_equal(getattr(grown[0].cloud, name), getattr(rest, name))


def test_the_capture_stays_below(grown) -> None:
    """Oracle: the arrays of the capture, bit for bit, at every frame."""
    rest = ball(700)
    for frame in grown:
        own = edit.take(frame.cloud, ~new(frame))
        for name in ARRAYS:
            assert np.array_equal(getattr(own, name), getattr(rest, name))
    assert new(grown[-1]).sum() > 300


def test_matter_rises_above_the_surface(grown) -> None:
    """Oracle: the radius of the ball: discs are between the surface and the relief above it, give
    or take the distance of the layers."""
    radius = np.linalg.norm(grown[-1].cloud.positions[new(grown[-1])], axis=1)
    relief = 3.5 * SPACING
    assert radius.min() > 1 - 0.5 * SPACING
    assert 1 + 0.3 * relief < radius.max() < 1 + 1.1 * relief


def test_the_front_has_its_speed(grown) -> None:
    """Oracle: great circles from the first discs: none is farther than the front, give or take the
    radius of the seed, at which the pattern is ahead of it."""
    first = next(number for number, frame in enumerate(grown) if new(frame).any())
    centre = grown[first].cloud.positions[new(grown[first])].mean(axis=0)
    farthest = []
    for number, frame in enumerate(grown[first:], first):
        at = frame.cloud.positions[new(frame)]
        cosine = at @ centre / np.linalg.norm(at, axis=1) / np.linalg.norm(centre)
        farthest.append(np.arccos(np.clip(cosine, -1, 1)).max())
        assert farthest[-1] < SPACING * (SPEED * number / 24 + 2 * SEED_RADIUS + 2)
    assert farthest[-1] > farthest[0] + 0.5


def test_ids_are_new_and_stay(grown) -> None:
    """Oracle: sets."""
    before: set[int] = set()
    for frame in grown:
        now = set(frame.cloud.ids.tolist())
        assert len(now) == len(frame.cloud) and before <= now
        before = now


def test_growth_ends_at_the_largest_number(device) -> None:
    """Oracle: `sim:maxCount`, which counts the capture."""
    frames = played(device, growing(sim={"max_count": 900}), 16)
    assert 880 < len(frames[-1].cloud) <= 900


def test_matter_stays_where_splats_are_selected(device) -> None:
    """Oracle: the half of the ball with the weight 0, less one distance of carriers."""
    rest = ball(700)
    weight = (rest.positions[:, 0] > 0).astype(np.float32)
    frame = played(device, growing(rest=rest, selection=weight), 16)[-1]
    at = frame.cloud.positions[new(frame)]
    assert len(at) > 100 and at[:, 0].min() > -2 * SPACING


def test_moss_grows_on_top(device) -> None:
    """Oracle: the height of the discs on the ball: matter with `upward` avoids what faces down."""
    frame = played(device, growing("moss"), 16)[-1]
    at = frame.cloud.positions[new(frame)]
    assert len(at) > 100 and at[:, 1].min() > -0.35


@pytest.mark.parametrize("style", ["cells", "coral", "veins", "moss", "crystals", "lichen"])
def test_each_style_gives_sound_splats(device, style: str) -> None:
    """Oracle: what a splat is: finite, positive sizes, opacity below 1, unit quaternions."""
    frame = played(device, growing(style), 12)[-1]
    cloud = edit.take(frame.cloud, new(frame))
    assert len(cloud) > 50
    for name in ARRAYS:
        assert np.isfinite(getattr(cloud, name)).all()
    assert (cloud.scales > 0).all() and (cloud.opacities < 1).all()
    np.testing.assert_allclose(np.linalg.norm(cloud.rotations, axis=1), 1, atol=1e-5)


def test_captured_splats_do_not_cover_veins(device) -> None:
    """Oracle: the ball: all of a vein, also its thin ends and its sides, is half a distance of
    carriers above it."""
    frame = played(device, growing("veins"), 24)[-1]
    drawn = new(frame) & (frame.cloud.opacities > 0)
    assert drawn.sum() > 50
    assert np.linalg.norm(frame.cloud.positions[drawn], axis=1).min() > 1 + 0.5 * SPACING


def same(a: Frame, b: Frame) -> bool:
    """Whether two frames have the same bits."""
    return np.array_equal(a.cloud.ids, b.cloud.ids) and all(
        np.array_equal(getattr(a.cloud, name), getattr(b.cloud, name)) for name in ARRAYS
    )


STYLES = ("coral", "cells", "veins", "lichen", "crystals")


@pytest.mark.parametrize("style", STYLES)
def test_any_number_of_threads_gives_the_same_bits(style) -> None:
    """Oracle: the run with one thread."""
    runs = [played(CpuDevice(threads=threads), growing(style), 9) for threads in (1, 2)]
    for a, b in zip(*runs, strict=True):
        assert same(a, b)


@pytest.mark.parametrize("style", STYLES)
def test_a_checkpoint_continues_with_the_same_bits(device, style) -> None:
    """Oracle: the run without interruption."""
    frames = played(device, growing(style), 11)
    assert new(frames[-1]).any()
    solver = started(device, growing(style), 11)
    for _ in range(7):
        solver.advance()
    state = solver.checkpoint()
    again = started(device, growing(style), 11, state=state)
    for frame in frames[8:]:
        again.advance()
        assert same(frame, again.frame())


def test_motifs_need_a_front(device) -> None:
    """Oracle: without a front, matter grows where the pattern is, as with the motif "pattern"."""
    still = {"front_speed": -1.0, "seeds": 40}
    motif, pattern = (
        played(device, growing("cells", rd=still, accretion=knobs), 8)
        for knobs in ({}, {"motif": "pattern"})
    )
    assert new(motif[-1]).any()
    assert same(motif[-1], pattern[-1])


def test_a_seed_affector_starts_the_front(device) -> None:
    """Oracle: its place: without seeds of its own, matter begins at the affector only."""
    from tests.sim.affectors import affector, placed

    seed = affector("sphere", (0.25, 0, 0), placed((0, 0, 1)), path="/seed", role="seed")
    recipe = growing(rd={"seed_mode": "affectors"})
    parameters = recipe.says(0.0)["parameters"]
    recipe.says = always(parameters=parameters, affectors=(seed,))
    frames = played(device, recipe, 12)
    first = next(frame for frame in frames if new(frame).any())
    assert first.cloud.positions[new(first), 2].min() > 0.5
    recipe.says = always(parameters=parameters)
    assert not any(new(frame).any() for frame in played(device, recipe, 6))


def test_discs_belong_to_carriers(device) -> None:
    """Oracle: the memory of the state: each carrier has one disc in each layer."""
    solver = started(device, growing(), 16)
    for _ in range(15):
        solver.advance()
    own = solver.state.memory[CARRIER]
    carriers, counts = np.unique(own[own >= 0], return_counts=True)
    assert (counts == 4).all()
    assert carriers.max() < len(Carriers.of(device, ball(700), distance=SPACING, seed=4))
