"""Tests of the order of the solver's stages. Oracle: closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.sim.affectors import affector, capsule_gaps, placed, rotation
from tests.sim.recipes import (
    ARRAYS,
    Written,
    always,
    ball,
    changed,
    deformer,
    driver,
    knobs,
    painted,
    played,
    pusher,
    started,
)
from tests.sim.shapes import sphere
from usdsplat.core import covariance, edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.contact import USUAL
from usdsplat.sim.specs import SkinBinding, SkinPose, Surface
from usdsplat.sim.uses import uses_over


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def sigma(cloud: SplatCloud) -> np.ndarray:
    """Covariances in float64, shape (n, 3, 3)."""
    return covariance.from_scale_rotation(
        cloud.scales.astype(np.float64), cloud.rotations.astype(np.float64)
    )


def assert_same_splats(found: SplatCloud, expected: SplatCloud, tolerance: float = 1e-5) -> None:
    """Places, covariances and harmonics, relative to the largest."""
    for a, b in (
        (found.positions, expected.positions),
        (sigma(found), sigma(expected)),
        (found.sh, expected.sh),
        (found.opacities, expected.opacities),
    ):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * np.abs(b).max())


EXACT = {"appearance": {"sh_min_angle": 0.0}}


def wave_of(time: float, scale: float = 1.0) -> np.ndarray:
    """A place that speeds up, slows down and turns all the while."""
    turn = rotation((1, 2, 0.5), 0.8 * np.sin(time / 3))
    return placed((np.sin(time / 2), 0.1 * time, -np.cos(time / 4)), turn * scale)


# --- what carries ------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["linear", "dualQuaternion"])
def test_all_weights_on_one_joint_are_a_transform(device, method: str) -> None:
    """Oracle: the capture through the joint's matrix by core.edit, at every frame, although the
    joint speeds up and slows down (test 17): places, covariances, harmonics within 1e-5."""
    rest = ball(500, degree=3)
    one = np.tile(np.array([1, 0], np.int32), (500, 1))
    share = np.tile(np.array([1, 0], np.float32), (500, 1))
    binding = SkinBinding(indices=one, weights=share, bind=np.eye(4))
    p = knobs(skin={"method": method}, **EXACT)

    def says(time: float) -> dict[str, Any]:
        joints = np.stack([np.eye(4), wave_of(time, 1.3)])
        return {"parameters": p, "skin": SkinPose(joints=joints)}

    for frame in played(device, Written(rest, says, binding=binding), 12):
        assert_same_splats(frame.cloud, edit.transform(rest, wave_of(frame.time, 1.3)))


def test_a_transform_deformer_is_a_transform(device) -> None:
    """Oracle: the capture through the matrix by core.edit; stretched by as much as is allowed."""
    rest = ball(400, degree=2)
    p = knobs(**EXACT)

    def says(time: float) -> dict[str, Any]:
        move = deformer("transform", translate=(0.2 * time, 0, 0), scale=(1, 1 + 0.1 * time, 1))
        return {"parameters": p, "deformers": (move,)}

    for frame in played(device, Written(rest, says), 6):
        matrix = np.diag([1, 1 + 0.1 * frame.time, 1, 1])
        matrix[0, 3] = 0.2 * frame.time
        assert_same_splats(frame.cloud, edit.transform(rest, matrix))


def test_splats_on_a_target_move_with_it(device) -> None:
    """Oracle: the first frame, all having arrived, through the target's rigid motion."""
    mesh = sphere(3, 1.3)
    p = knobs(conform={"weight": 1.0, "duration": 0.0, "stagger": 0.0}, **EXACT)

    def says(time: float) -> dict[str, Any]:
        m = wave_of(time)
        points = (mesh.points @ m[:3, :3].T + m[:3, 3]).astype(np.float32)
        return {"parameters": p, "target": Surface(points=points, triangles=mesh.triangles)}

    frames = played(device, Written(ball(400, degree=2), says), 10)
    back = np.linalg.inv(wave_of(frames[0].time))
    for frame in frames[1:]:
        expected = edit.transform(frames[0].cloud, wave_of(frame.time) @ back)
        assert_same_splats(frame.cloud, expected, 2e-5)


# --- being pushed, and the way back ------------------------------------------------------


def test_nobody_is_inside_where_a_sample_is_taken(device) -> None:
    """Oracle: distances from the capsule in float64; clearance of the usual sizes at rest."""
    recipe = Written(ball(2000), pusher)
    solver = started(device, recipe, 8)
    scales = recipe.rest.scales.max(axis=1)
    scales = np.minimum(scales, np.float32(USUAL * np.median(scales)))
    for _ in range(7):
        solver.advance()
        frame = solver.frame()
        gap, _ = capsule_gaps(recipe.at(frame.time).affectors, frame.cloud.positions, scales)
        assert gap.min() > -1e-5 * 0.4
    assert np.abs(frame.cloud.positions - recipe.rest.positions).max() > 0.1


@pytest.mark.parametrize("policy", ["full", "rigid", "volume"])
def test_after_a_push_all_is_as_it_was(device, policy: str) -> None:
    """Oracle: the capture: places within a thousandth of a splat's size, and 1e-6 at last; shapes
    and colours to the bit, but for the sign of quaternions."""
    rest = ball(1500, degree=2)
    p = knobs(settle={"omega": 30.0}, appearance={"covariance": policy, "sh_min_angle": 0.0})
    frames = played(device, Written(rest, lambda time: pusher(time, parameters=p)), 40)
    assert changed(frames[7:8], rest) >= {"positions", "rotations", "sh"}
    last = frames[-1].cloud
    np.testing.assert_allclose(last.positions, rest.positions, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(last.scales, rest.scales)
    np.testing.assert_array_equal(last.sh, rest.sh)
    sign = np.sign((last.rotations * rest.rotations).sum(axis=1, keepdims=True))
    np.testing.assert_array_equal(last.rotations * sign, rest.rotations)


def test_omega_of_nothing_leaves_splats_where_they_were_pushed(device) -> None:
    """Oracle: the frame in which the affector left, to the bit."""
    p = knobs(settle={"omega": 0.0})
    frames = played(device, Written(ball(1000), lambda time: pusher(time, parameters=p)), 16)
    for frame in frames[9:]:
        for name in ARRAYS:
            there = getattr(frame.cloud, name)
            np.testing.assert_array_equal(there, getattr(frames[8].cloud, name))
    assert np.abs(frames[8].cloud.positions - frames[0].cloud.positions).max() > 0.1


def test_the_way_back_is_critically_damped(device) -> None:
    """Oracle: (1 + omega t) exp(-omega t) of the push, from a splat at rest that was pushed with no
    speed: an affector that appears for one step, friction 1."""
    omega, rest = 6.0, ball(600)
    there = placed((1.2, 0, 0))

    def says(time: float) -> dict[str, Any]:
        body = affector("sphere", (0.5, 0, 0), there, enabled=time <= 1.0, clearance=0.0)
        return {"affectors": (body,), "parameters": knobs(settle={"omega": omega})}

    frames = played(device, Written(rest, says), 12)
    push = frames[0].cloud.positions.astype(np.float64) - rest.positions
    assert np.abs(push).max() > 0.1
    for number, frame in enumerate(frames):
        t = number / 24
        expected = rest.positions + (1 + omega * t) * np.exp(-omega * t) * push
        np.testing.assert_allclose(frame.cloud.positions, expected, rtol=0, atol=2e-6)


def test_who_is_not_selected_is_not_touched(device) -> None:
    """Oracle: the bits of the capture; half is not selected, by weight or by a mask."""
    rest = ball(1200)
    out = rest.positions[:, 1] < 0
    weight = np.where(out, 0, 1).astype(np.float32)
    frames = played(device, Written(rest, pusher, selection=weight), 14)
    mask = affector("box", (9, 9, 9), placed((0, 9, 0)), path="/m", role="mask")

    def masked(time: float) -> dict[str, Any]:
        given = pusher(time)
        return {**given, "affectors": (*given["affectors"], mask)}

    for each in (frames, played(device, Written(rest, masked), 14)):
        for frame in each:
            for name in ARRAYS[:1]:
                there = getattr(frame.cloud, name)[out]
                np.testing.assert_array_equal(there, getattr(rest, name)[out])
        assert np.abs(each[7].cloud.positions - rest.positions).max() > 0.1


# --- what is written ---------------------------------------------------------------------

CASES: dict[str, Any] = {
    "nothing": lambda time: {},
    "collide": pusher,
    "bend": lambda time: {"deformers": (deformer("bend", angle=4 * time),)},
    "fly": lambda time: {
        "parameters": knobs(particles={"enabled": True, "gravity": (0.0, -1.0, 0.0)})
    },
    "dissolve": lambda time: {
        "parameters": knobs(dissolve={"enabled": True, "duration": 0.3, "speed": 1.0})
    },
    "opacity": lambda time: {
        "affectors": (
            affector("sphere", (0.7, 0, 0), placed((1, 0, 0)), role="opacity", amount=0.2),
        )
    },
    "color": lambda time: {
        "parameters": knobs(rd={"enabled": True, "seed_density": 0.01}),
        "drivers": (driver("color", source="v", in_max=0.2),),
    },
    "scale": lambda time: {"drivers": (driver("scale", source="age", in_max=0.2, amount=2.0),)},
    "thickness": lambda time: {
        "drivers": (driver("thickness", source="age", in_max=0.2, amount=2.0),)
    },
    "displacement": lambda time: {
        "drivers": (driver("displacement", source="age", in_max=0.2, amount=0.1),)
    },
    "grow": lambda time: {
        "parameters": knobs(rd={"enabled": True, "seed_density": 0.05}, growth={"rate": 0.2})
    },
    "keep": lambda time: {
        "deformers": (deformer("transform", scale=(2.0, 1.0, 1.0), rotate=(0.0, 0.0, 40.0)),),
        "parameters": knobs(appearance={"keep_opacity": True}),
    },
}


@pytest.mark.parametrize("case", list(CASES))
def test_exactly_what_is_announced_changes(device, case: str) -> None:
    """Oracle: the capture's bits in all frames; positions are announced in any case."""
    recipe = Written(ball(600, degree=1), CASES[case])
    writes = uses_over(recipe, range(1, 11)).writes
    found = changed(played(device, recipe, 10), recipe.rest)
    assert found | {"positions"} == writes


def test_a_pattern_waits_until_it_is_enabled(device) -> None:
    """Oracle: u and v of the first frame to the bit, as long as it is off."""

    def says(time: float) -> dict[str, Any]:
        return {"parameters": knobs(rd={"enabled": time > 5, "seed_density": 0.01})}

    frames = played(device, Written(ball(600), says), 9)
    for frame in frames[1:5]:
        np.testing.assert_array_equal(frame.uv, frames[0].uv)
    assert not np.array_equal(frames[5].uv, frames[0].uv)
    assert np.ptp(frames[0].uv[:, 1]) > 0.1


# --- births and what is about the capture's rows ------------------------------------------

FERTILE = {
    "rd": {"enabled": True, "seed_density": 0.2},
    "growth": {
        "birth_rate": 20.0, "crowd_max": 3.0, "v_min": 0.0, "v_max": 0.05, "birth_fade": 0.1,
        "life": 0.3, "death_fade": 0.1,
    },
}  # fmt: skip


def test_children_go_where_their_parents_mask_takes_them(device) -> None:
    """Oracle: the parent's mask: who descends from a masked splat moves, nobody else."""
    rest = ball(500)
    mask = (rest.positions[:, 2] > 0.3).astype(np.float32)

    def says(time: float) -> dict[str, Any]:
        move = deformer("transform", translate=(10.0, 0.0, 0.0))
        own = painted(mask, "deform:d:weight")
        return {"parameters": knobs(**FERTILE), "deformers": (move,), **own}

    solver = started(device, Written(rest, says), 14)
    for _ in range(14):
        solver.advance()
    state = solver.state
    ancestor = {int(i): int(i) for i in range(500)}
    for child, parent in zip(state.ids, state.parents, strict=True):
        ancestor[int(child)] = ancestor.get(int(parent), -1) if parent >= 0 else int(child)
    rows = np.array([ancestor[int(i)] for i in state.ids])
    known = rows >= 0
    assert (rows[known] != state.ids[known]).sum() > 50
    moved = state.positions[known, 0] > 5
    np.testing.assert_array_equal(moved, mask[rows[known]] > 0)


def test_who_is_not_selected_has_no_children(device) -> None:
    """Oracle: the selection of the parents: a weight of nothing, or outside of a mask."""
    rest = ball(500)
    out = rest.positions[:, 1] < 0
    mask = affector("box", (9, 9, 9), placed((0, 9, 0)), path="/m", role="mask")
    given = {"parameters": knobs(**FERTILE)}
    weight = np.where(out, 0, 1).astype(np.float32)
    for recipe in (
        Written(rest, always(**given), selection=weight),
        Written(rest, always(**given, affectors=(mask,))),
    ):
        solver = started(device, recipe, 6)
        for _ in range(6):
            solver.advance()
        parents = solver.state.parents[500:]
        parents = parents[(parents >= 0) & (parents < 500)]
        assert len(parents) > 20
        assert not out[parents].any()


# --- space, errors -----------------------------------------------------------------------


def test_those_let_go_fly_along_the_normals_that_they_have_by_then(device) -> None:
    """Oracle: the same without a deformer, turned by it: a quarter about z."""
    p = knobs(
        dissolve={"enabled": True, "by": "random", "duration": 0.0, "speed": 2.0, "spread": 0.0},
        particles={"drag": 0.0},
    )
    rest = ball(300)
    plain = played(device, Written(rest, always(parameters=p)), 5)
    turn = deformer("transform", rotate=(0.0, 0.0, 90.0))
    turned = played(device, Written(rest, always(parameters=p, deformers=(turn,))), 5)
    expected = plain[-1].cloud.positions @ rotation((0, 0, 1), np.pi / 2).T
    assert np.abs(plain[-1].cloud.positions - rest.positions).max() > 0.2
    np.testing.assert_allclose(turned[-1].cloud.positions, expected, rtol=0, atol=2e-5)


def test_those_that_assemble_arrive_at_a_goal_that_moves(device) -> None:
    """Oracle: the goal itself, as soon as they are there."""
    p = knobs(dissolve={"enabled": True, "mode": "assemble", "duration": 0.2, "speed": 1.0})

    def says(time: float) -> dict[str, Any]:
        move = deformer("transform", translate=(0.1 * time * time, 0.0, 0.0))
        return {"parameters": p, "deformers": (move,)}

    rest = ball(400)
    frames = played(device, Written(rest, says), 12)
    assert np.abs(frames[1].cloud.positions - rest.positions - (0.4, 0, 0)).max() > 0.1
    for frame in frames[6:]:
        goal = rest.positions + np.float32([0.1 * frame.time**2, 0, 0])
        np.testing.assert_allclose(frame.cloud.positions, goal, rtol=0, atol=1e-5)


def test_a_field_without_splats_is_refused(device) -> None:
    """Oracle: the sentence."""
    empty = edit.take(ball(20), np.zeros(20, bool))
    with pytest.raises(StageError, match="/World/Field: found a field without splats"):
        played(device, Written(empty, always()), 1)


@pytest.mark.parametrize("domain", ["carrier", "self"])
def test_a_pattern_on_nothing_that_is_seen(device, domain: str) -> None:
    """Oracle: one sentence, or nothing but the capture: no splat is opaque enough."""
    rest = replace(ball(100), opacities=np.full(100, 0.01, np.float32))
    p = knobs(rd={"enabled": True, "domain": domain})
    try:
        frames = played(device, Written(rest, always(parameters=p)), 2)
    except StageError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(frames[-1].uv).all()


def test_a_pattern_that_would_never_end_is_refused(device) -> None:
    """Oracle: the sentence; a lattice unit of many spacings needs the square of them in steps."""
    p = knobs(rd={"enabled": True, "domain": "self", "pattern_scale": 1e4})
    with pytest.raises(StageError, match=r"splatSim:rd:patternScale: found 10000, \d+ spacings"):
        played(device, Written(ball(300), always(parameters=p)), 2)


def test_who_has_no_way_out_is_counted(device) -> None:
    """Oracle: two half-spaces that are everything together; there is a way out of one alone."""
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    up, over = affector("plane"), affector("plane", matrix=down)
    for bodies, expected in (((up,), 0), ((up, over), 50)):
        solver = started(device, Written(ball(50), always(affectors=bodies)), 2)
        solver.advance()
        assert solver.trapped == expected
