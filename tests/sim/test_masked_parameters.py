"""Tests of masked parameters: each by its effect on every second splat, and over time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.sim.affectors import affector, placed
from tests.sim.recipes import (
    Written,
    always,
    ball,
    deformer,
    driver,
    halves,
    joints,
    knobs,
    mask,
    painted,
    played,
    started,
)
from tests.sim.shapes import sphere
from usdsplat.core.cloud import F32
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim import masks as kernels
from usdsplat.sim.checkpoint import Checkpoint, load, save
from usdsplat.sim.parameters import GROUPS, INSTANCED, masked_parameters


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


HALF = (np.arange(400) % 2).astype(np.float32)
"""Every second splat."""


def frames(device, says: Any, count: int = 6, **given: Any) -> list[Any]:
    """The frames of a ball of 400 splats."""
    return played(device, Written(ball(400), says, **given), count)


def pushed(time: float) -> dict[str, Any]:
    """A ball that lies in a cap of the sphere until frame 2, and is then gone."""
    at = placed((1.1, 0, 0) if time <= 2 else (90, 0, 0))
    return {"affectors": (affector("sphere", (0.5, 0, 0), at),)}


REACTING = {"enabled": True, "domain": "self", "seed_density": 0.3, "substeps": 4,
            "pattern_scale": 0.1}  # fmt: skip


def moves(device, says: Any, count: int = 6) -> F32:
    """How far each splat is from rest at the last frame."""
    last = frames(device, says, count)[-1].cloud.positions
    return np.linalg.norm(last - ball(400).positions, axis=1)


def still_where_masked(device, knob: str, **given: Any) -> None:
    """Whoever has the mask 0 stays at rest, whoever has 1 moves as without a mask."""
    free = moves(device, always(**given))
    held = moves(device, always(**given, **painted(HALF, knob)))
    assert (free > 1e-4).mean() > 0.9
    if device.name == "cpu":
        assert np.array_equal(held[HALF > 0], free[HALF > 0])
    else:  # products and sums are fused differently in the kernel that takes masks
        np.testing.assert_allclose(held[HALF > 0], free[HALF > 0], rtol=1e-5, atol=1e-7)
    assert held[HALF == 0].max() < 1e-6


@pytest.mark.parametrize(
    ("knob", "given"),
    [
        ("deform:d:weight", {"deformers": (deformer("transform", translate=(1.0, 0, 0)),)}),
        ("deform:d:amount", {"deformers": (deformer("noise", amount=0.4, size=0.7),)}),
        ("driver:r:amount", {"drivers": (
            driver("displacement", source="distance", in_min=-1.0, in_max=0.0, amount=0.3),
        )}),
        ("particles:gravity", {"parameters": knobs(
            particles={"enabled": True, "gravity": (0.0, -9.0, 0.0)})}),
        ("particles:wind", {"parameters": knobs(
            particles={"enabled": True, "wind": (3.0, 0.0, 0.0), "drag": 2.0})}),
        ("particles:turbulence", {"parameters": knobs(
            particles={"enabled": True, "turbulence": 3.0, "drag": 2.0})}),
        ("particles:drag", {"parameters": knobs(
            particles={"enabled": True, "wind": (3.0, 0.0, 0.0), "drag": 2.0})}),
        ("affector:amount", {
            "parameters": knobs(particles={"enabled": True, "drag": 2.0}),
            "affectors": (affector("box", (9, 9, 9), role="wind", amount=3.0),),
        }),
        ("dissolve:speed", {"parameters": knobs(
            dissolve={"enabled": True, "duration": 0.0, "speed": 2.0, "fade": 0.0})}),
    ],
)  # fmt: skip
def test_what_moves_splats_moves_those_of_the_mask(device, knob: str, given: Any) -> None:
    """Oracle: the same simulation without the mask, and rest."""
    name = f"/a.{knob}" if knob.startswith("affector") else knob
    still_where_masked(device, name, **given)


def test_a_skin_moves_those_of_the_mask(device) -> None:
    """Oracle: the same skin without the mask, and rest; by both methods."""
    rest = ball(400)
    for method in ("linear", "dualQuaternion"):
        own = {"parameters": knobs(skin={"method": method})}
        results = [
            played(
                device,
                Written(
                    rest,
                    lambda time, extra=extra, own=own: {**own, "skin": joints(time), **extra},
                    binding=halves(rest.positions),
                ),
                6,
            )[-1].cloud.positions
            for extra in ({}, painted(HALF, "skin:weight"))
        ]
        free, held = (np.linalg.norm(each - rest.positions, axis=1) for each in results)
        assert free.mean() > 0.01
        assert np.array_equal(held[HALF > 0], free[HALF > 0])
        assert held[HALF == 0].max() < 1e-6


@pytest.mark.parametrize("mode", ["transport", "closest"])
def test_a_target_draws_those_of_the_mask(device, mode: str) -> None:
    """Oracle: the same target without the mask, and rest."""
    mesh = sphere(2, 2.0)
    parameters = knobs(conform={"weight": 1.0, "duration": 0.1, "stagger": 0.0, "mode": mode})
    still_where_masked(device, "conform:weight", parameters=parameters, target=mesh)


def test_another_capture_has_no_primvars_of_the_mask(device) -> None:
    """Oracle: those of the capture with the mask 0 stay at rest; the other capture arrives."""
    other = replace(ball(300, seed=8), positions=ball(300).positions + np.float32([3, 0, 0]))
    parameters = knobs(conform={"weight": 1.0, "start": 0.02, "duration": 0.1, "stagger": 0.0})
    own = painted(HALF, "conform:weight")
    last = frames(device, always(parameters=parameters, becomes=other, **own), 10)[-1].cloud
    rest = ball(400).positions
    assert len(last) == 700
    assert np.abs(last.positions[:400] - rest)[HALF == 0].max() < 1e-6
    assert np.abs(last.positions[:400] - rest)[HALF > 0].max(axis=1).min() > 0.5
    assert np.allclose(last.positions[400:], other.positions, atol=1e-5)


def test_matter_is_deformed_where_the_mask_is(device) -> None:
    """Oracle: each carrier moves by the mask of the splat nearest to it, by brute force."""
    rest = ball(400)
    paint = (rest.positions[:, 0] > 0).astype(np.float32)
    says = always(
        parameters=knobs(matter={"enabled": True}),
        deformers=(deformer("transform", translate=(1.0, 0, 0)),),
        **painted(paint, "deform:d:weight"),
    )
    parts = started(device, Written(rest, says), 2)._parts
    assert parts.matter is not None and parts.carriers is not None
    places = parts.carriers.positions
    moved = device.fetch(parts.matter.matter.particles.positions) - places
    apart = np.linalg.norm(places[:, None] - rest.positions, axis=2)
    assert np.allclose(moved[:, 0], paint[apart.argmin(axis=1)], atol=1e-5)
    assert 0.3 < moved[:, 0].mean() < 0.7 and np.allclose(moved[:, 1:], 0, atol=1e-6)


def test_affectors_push_those_of_the_mask(device) -> None:
    """Oracle: the same push without the mask, and rest; a contact of 0 is no contact."""
    free, held = (
        moves(device, lambda time, extra=extra: {**pushed(time), **extra}, 2)
        for extra in ({}, painted(HALF, "sim:contact"))
    )
    assert (free > 1e-3).sum() >= 20
    assert np.array_equal(held[HALF > 0], free[HALF > 0]) and held[HALF == 0].max() < 1e-6
    none = {"parameters": knobs(sim={"contact": 0.0})}
    assert not moves(device, lambda time: {**pushed(time), **none}, 2).any()


def test_splats_settle_by_their_own_omega(device) -> None:
    """Oracle: with half of omega, the state of a simulation that has half of it everywhere; with
    0, nobody comes back."""
    full, half = (
        frames(device, lambda t, w=w: {**pushed(t), "parameters": knobs(settle={"omega": w})}, 8)
        for w in (8.0, 4.0)
    )
    own = painted((HALF + 1) / 2, "settle:omega")
    both = frames(
        device,
        lambda t: {**pushed(t), "parameters": knobs(settle={"omega": 8.0}), **own},
        8,
    )
    last = [each[-1].cloud.positions for each in (full, half, both)]
    wanted = np.where(HALF[:, None] > 0, last[0], last[1])
    assert np.allclose(last[2], wanted, atol=1e-6) and not np.allclose(last[0], last[1], atol=1e-4)


@pytest.mark.parametrize(("knob", "low"), [("rd:feed", "feed"), ("rd:kill", "kill")])
@pytest.mark.parametrize("domain", ["self", "carrier"])
def test_rates_of_the_reaction_differ_from_splat_to_splat(device, knob, low, domain) -> None:
    """Oracle: a reaction that has the other rate everywhere, far from the border of the mask."""
    rest = ball(1500)
    side = (rest.positions[:, 0] > 0).astype(np.float32)
    rates = {"feed": 0.037, "kill": 0.06}
    lower = {**rates, low: rates[low] * 0.6}

    def ran(given: dict[str, float], **extra: Any) -> F32:
        rd = {**REACTING, "domain": domain, "substeps": 5, "pattern_scale": 0.06, **given}
        groups = {"rd": rd, "relax": {"iterations": 5}}
        says = always(parameters=knobs(**groups), **extra)
        return played(device, Written(rest, says), 12)[-1].uv

    full, other = ran(rates), ran(lower)
    own = painted(0.6 + 0.4 * side, knob)
    both = ran(rates, **own)
    far = np.abs(rest.positions[:, 0]) > 0.6
    assert np.abs(full[far] - other[far]).max() > 0.02
    assert np.abs(both - full)[far & (side > 0)].max() < 0.02
    assert np.abs(both - other)[far & (side == 0)].max() < 0.02


def test_growth_and_births_are_where_the_mask_is(device) -> None:
    """Oracle: the parents of the children, and rest."""
    rest = ball(400)
    groups = {
        "rd": {**REACTING, "seed_mode": "selection"},
        "growth": {"rate": 0.5, "birth_rate": 8.0, "v_min": 0.0, "v_max": 0.01, "crowd_max": 9.0},
        "relax": {"iterations": 0},
    }
    own = painted(HALF, "growth:rate", "growth:birthRate")
    solver = started(device, Written(rest, always(parameters=knobs(**groups), **own)), 8)
    for _ in range(7):
        solver.advance()
    state = solver.state
    captured = state.ids < 400
    far = np.linalg.norm(state.rest_positions[captured] - rest.positions, axis=1)
    assert far[HALF > 0].min() > 1e-3 and far[HALF == 0].max() == 0
    ancestors = {}
    for child, parent in zip(state.ids.tolist(), state.parents.tolist(), strict=True):
        ancestors[child] = ancestors.get(parent, parent) if parent >= 0 else child
    born = [ancestors[each] for each in state.ids[~captured].tolist()]
    assert len(born) > 100 and all(HALF[each] for each in born)


def test_size_follows_spacing_where_the_mask_is(device) -> None:
    """Oracle: sizes without the mask, and at rest."""
    groups = {
        "rd": {**REACTING, "seed_mode": "selection"},
        "growth": {"birth_rate": 8.0, "v_min": 0.0, "v_max": 0.01, "size_follow": 1.0},
        "relax": {"iterations": 0},
    }
    free = frames(device, always(parameters=knobs(**groups)), 8)[-1].cloud
    own = painted(HALF, "growth:sizeFollow")
    held = frames(device, always(parameters=knobs(**groups), **own), 8)[-1].cloud
    rest = ball(400).scales
    assert np.array_equal(held.scales[:400][HALF > 0], free.scales[:400][HALF > 0])
    assert np.allclose(held.scales[:400][HALF == 0], rest[HALF == 0])
    assert not np.allclose(free.scales[:400][HALF == 0], rest[HALF == 0])


def test_stretch_is_limited_by_the_mask(device) -> None:
    """Oracle: a stretch by three, and one by the least limit, 1."""
    stretch = deformer("transform", scale=(3.0, 3.0, 3.0))
    plain = knobs(appearance={"max_stretch": 4.0})
    own = painted(HALF, "appearance:maxStretch")
    last = frames(device, always(parameters=plain, deformers=(stretch,), **own), 2)[-1].cloud
    ratio = last.scales / ball(400).scales
    assert np.allclose(ratio[HALF > 0], 3, rtol=1e-4)
    assert np.allclose(ratio[HALF == 0], 1, rtol=1e-4)  # of the range of the parameter


def test_transport_limits_stretches_by_itself_and_needs_no_mask(device) -> None:
    """Oracle: the same without the mask."""
    given = {"parameters": knobs(conform={"weight": 1.0, "duration": 0.1, "stagger": 0.0}),
             "target": sphere(2, 2.0)}  # fmt: skip
    with np.errstate(invalid="raise"):
        free, held = (
            frames(device, always(**given, **extra))[-1].cloud.scales
            for extra in ({}, painted(HALF, "appearance:maxStretch"))
        )
    assert np.array_equal(free, held)


def dissolving(**given: Any) -> dict[str, Any]:
    """A dissolve of everything at once."""
    own = {"enabled": True, "duration": 0.0, "speed": 0.0, "fade": 0.25, "shrink": 1.0, **given}
    return {"parameters": knobs(dissolve=own)}


def test_splats_vanish_in_their_own_time(device) -> None:
    """Oracle: fades of 0.25 s and 0.125 s; with 0 a splat stays."""
    own = painted(np.float32([0, 0.5, 1])[np.arange(400) % 3], "dissolve:fade")
    every = frames(device, always(**dissolving(), **own), 8)
    part = every[-1].cloud.opacities / ball(400).opacities
    seconds = 7 / 24
    for which, fade in ((0, 0.0), (1, 0.125), (2, 0.25)):
        t = min(seconds / fade, 1) if fade else 0
        assert np.allclose(part[np.arange(400) % 3 == which], 1 - t * t * (3 - 2 * t), atol=0.03)


def test_splats_shrink_by_their_own_part(device) -> None:
    """Oracle: sizes at the end: none, or as at rest."""
    every = frames(device, always(**dissolving(), **painted(HALF, "dissolve:shrink")), 9)
    ratio = every[-1].cloud.scales / ball(400).scales
    assert np.allclose(ratio[HALF > 0], 0) and np.allclose(ratio[HALF == 0], 1)


def test_a_mask_is_the_order_of_a_dissolve(device) -> None:
    """Oracle: the time of each splat: the mask times the duration; above 1 it comes later."""
    order = np.linspace(0, 1.2, 400).astype(np.float32)
    own = painted(order, "dissolve:by")
    given = dissolving(by="mask", duration=0.5, fade=0.0, start=0.05, speed=1.0)
    solver = started(device, Written(ball(400), always(**given, **own)), 20)
    for _ in range(10):
        solver.advance()
    flying = np.linalg.norm(solver.state.velocities, axis=1) > 0
    assert np.array_equal(flying, 0.05 + 0.5 * order <= 10 / 24 + 1e-6)


def test_a_region_that_passes_dissolves_what_it_meets(device) -> None:
    """Oracle: a half-space that advances along x: who is in it by then, from then on."""

    def says(time: float) -> dict[str, Any]:
        wall = affector("box", (9, 9, 9), placed((-10 + 0.1 * time, 0, 0)), role="region")
        front = mask("affector", "front", regions=(wall,), invert=True)
        given = dissolving(by="mask", duration=1e6, fade=0.2, speed=1.0)
        return {**given, "masks": {"front": front}, "masked": {"dissolve:by": ("front",)}}

    rest = ball(400)
    solver = started(device, Written(rest, says), 12)
    released = np.full(400, -1)
    for number in range(11):
        flying = np.linalg.norm(solver.state.velocities, axis=1) > 0
        released[flying & (released < 0)] = number
        met = rest.positions[:, 0] < -1 + 0.1 * (number + 1) - 1e-4
        assert np.array_equal(flying | ~met, np.ones(400, bool)) or number == 0
        solver.advance()
    late = solver.frame().cloud
    gone = late.opacities < 1e-6
    assert gone[(released >= 0) & (released <= 6)].all() and (released > 8).any()
    assert not gone[(released < 0) | (released >= 8)].any()


def test_every_parameter_that_takes_a_mask_is_tested_here() -> None:
    """Oracle: the parameters' own declarations."""
    tested = {
        "deform:<name>:weight", "deform:<name>:amount", "driver:<name>:amount",
        "particles:gravity", "particles:wind", "particles:turbulence", "particles:drag",
        "affector:amount", "dissolve:speed", "skin:weight", "conform:weight", "sim:contact",
        "settle:omega", "rd:feed", "rd:kill", "growth:rate", "growth:birthRate",
        "growth:sizeFollow", "appearance:maxStretch", "dissolve:fade", "dissolve:shrink",
        "dissolve:by",
    }  # fmt: skip
    assert set(masked_parameters()) == tested
    assert {name.partition(":")[0] for name in tested} <= {*GROUPS, *INSTANCED}


# --- over time ------------------------------------------------------------------------------


def masked_growth(time: float) -> dict[str, Any]:
    """Births, deaths and growth under masks of every kind that changes."""
    wall = affector("box", (9, 9, 9), placed((-9.5 + 0.05 * time, 0, 0)), role="region",
                    falloff=0.4)  # fmt: skip
    given = {
        "rd": {**REACTING, "seed_mode": "selection"},
        "growth": {"rate": 0.3, "birth_rate": 6.0, "v_min": 0.0, "v_max": 0.01, "life": 0.3,
                   "death_fade": 0.05, "crowd_max": 9.0},
        "relax": {"iterations": 0},
        "settle": {"omega": 6.0},
        "dissolve": {"enabled": True, "by": "mask", "duration": 2.0, "speed": 1.0},
        "particles": {"turbulence": 1.0},
    }  # fmt: skip
    masks = {
        each.name: each
        for each in (
            mask("affector", "wall", regions=(wall,), at="current"),
            mask("noise", "grain", size=0.4, speed=2.0, at="current"),
            mask("age", "young", in_max=0.3, invert=True),
            mask("v", "pattern"),
            mask("primvar", "paint", primvar=np.linspace(0, 1, 400, dtype=np.float32)),
            mask("masks", "all", inputs=("wall", "young", "paint"), operation="max"),
        )
    }
    masked = {
        "growth:rate": ("wall",), "growth:birthRate": ("all",), "settle:omega": ("grain",),
        "deform:d:weight": ("wall", "grain"), "particles:turbulence": ("pattern",),
        "dissolve:by": ("all",), "driver:r:amount": ("grain",),
    }  # fmt: skip
    return {
        "parameters": knobs(**given), "masks": masks, "masked": masked,
        "deformers": (deformer("bend", angle=40.0),), "drivers": (driver("scale", source="u"),),
        **pushed(time),
    }  # fmt: skip


def test_a_simulation_with_masks_goes_on_from_any_frame(device, tmp_path) -> None:
    """Oracle: the simulation that was not stopped, bit for bit."""
    recipe = Written(ball(400), masked_growth)
    whole = started(device, recipe, 13)
    states, digests = {}, []
    for number in range(13):
        if number:
            whole.advance()
        whole.frame()
        path = tmp_path / f"{number}"
        save(path, Checkpoint(time=number, states={"f": whole.checkpoint()}, parameter_hash=""))
        digests.append(whole.state.digest())
        states[number] = path
    assert len(whole.state) > 500 and (whole.state.parents >= 0).any()
    for number in (0, 1, 6):
        state = load(states[number]).states["f"]
        other = started(device, recipe, 13, state=state)
        for later in range(number + 1, 13):
            other.advance()
            other.frame()
            other.checkpoint()
            assert other.state.digest() == digests[later], (number, later)


def test_masks_that_do_not_change_are_evaluated_once(device, monkeypatch) -> None:
    """Oracle: the number of launches of the kernel."""
    own = mask("noise", "m", size=0.5)
    given = {"masks": {"m": own}, "masked": {"settle:omega": ("m",)}}
    recipe = Written(ball(400), always(**given))
    solver = started(device, recipe, 4)
    launched = []
    real = type(device).run

    def run(self: Any, kernel: Any, *args: Any) -> Any:
        launched.append(kernel is kernels.noise)
        return real(self, kernel, *args)

    monkeypatch.setattr(type(device), "run", run)
    for _ in range(3):
        solver.advance()
    assert not any(launched)


def test_a_factor_keeps_a_parameter_within_its_range(device) -> None:
    """Oracle: the range of settle:omega: 0 to 100, for a mask from -3 to 20."""
    paint = np.linspace(-3, 20, 400, dtype=np.float32)
    recipe = Written(
        ball(400),
        always(parameters=knobs(settle={"omega": 8.0}), **painted(paint, "settle:omega")),
    )
    solver = started(device, recipe, 2)
    factor = solver._factor(recipe.at(1), "settle:omega")
    assert np.allclose(factor, np.clip(paint, 0, 100 / 8))
