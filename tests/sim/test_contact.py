"""Tests of contacts between splats and solids: positions and velocities."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import (
    affector,
    capsule_gaps,
    capsules,
    icosphere,
    placed,
    rotation,
    state_at,
)
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.jit import serial
from usdsplat.kernels.sim.blend_solids import touch
from usdsplat.sim.bodies import pack_bodies
from usdsplat.sim.contact import SINCE, Contacts
from usdsplat.sim.fields import Fields
from usdsplat.sim.state import PINNED

DT = 1 / 96


def step(state, before, after, *, device=None, dt=DT, started=None):
    """One substep in which splats move by themselves not at all, or from `started`."""
    started = state.positions.copy() if started is None else np.float32(started)
    return Contacts(device or open_device()).step(state, started, before, after, dt)


@pytest.mark.parametrize("blend", [0.0, 0.02])
def test_nothing_is_inside_sixteen_capsules(blend: float) -> None:
    """Oracle: distances from capsules in float64 NumPy, joined there; test 10 of the
    specification: at least -1e-5 R after each of 20 steps."""
    rng = np.random.default_rng(1)
    radius = 0.2
    state = state_at(rng.uniform(-1, 1, (12_000, 3)))
    state.rest_scales[:] = rng.uniform(0, 0.01, state.scales.shape)
    sigma = state.rest_scales.max(axis=1).astype(np.float64)
    contacts = Contacts(open_device())
    touched = 0
    for s in range(20):
        ends = [
            capsules(t / 96, count=16, radius=radius, half=0.3, spread=0.4, seed=3, blend=blend,
                     clearance=0.5, friction=0.2)
            for t in (s, s + 1)
        ]  # fmt: skip
        counts = contacts.step(state, state.positions.copy(), *ends, DT)
        joined, least = capsule_gaps(ends[1], state.positions, sigma)
        assert joined.min() >= -1e-5 * radius
        assert least.min() >= -1e-5 * radius
        assert counts.trapped == 0
        touched += counts.touched
    assert touched > 5000


def test_threads_change_no_bit() -> None:
    """Oracle: one thread. Rows are in no order, so blocks overlap all solids."""
    digests = []
    for threads in (1, 2):
        rng = np.random.default_rng(5)
        state = state_at(rng.uniform(-1, 1, (5000, 3)), velocity=(3, 0, 0))
        device = open_device(threads=threads)
        contacts = Contacts(device)
        for s in range(4):
            ends = [
                capsules(t / 20, count=9, radius=0.1, half=0.3, spread=0.4, seed=2, blend=0.03,
                         friction=0.4, restitution=0.5)
                for t in (s, s + 1)
            ]  # fmt: skip
            started = state.positions.copy()
            state.positions += state.velocities * np.float32(DT)
            contacts.step(state, started, *ends, DT)
        digests.append(state.digest())
    assert digests[0] == digests[1]


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5, 1.0])
def test_coulomb(friction: float) -> None:
    """Oracle: closed form, test 12 of the specification. A splat that falls onto a plane at 45
    degrees loses mu times its normal speed of the tangential one, and as much of its way: nothing
    without friction, all of it with full friction; mu = f / (1 - f)."""
    mu = friction / (1 - friction) if friction < 1 else np.inf
    turn = rotation((1, 2, 3), 0.7)
    along, up = turn @ [1, 0, 0], turn @ [0, 0, 1]
    for mix in (1.0, 3.0):
        velocity = mix * along - up
        kept = max(0.0, 1 - mu / mix)
        state = state_at([0.3 * along - DT * up], velocity=velocity)
        before = np.float32([0.3 * along - DT * mix * along])
        plane = [affector("plane", matrix=placed((0, 0, 0), turn), friction=friction)]
        step(state, plane, plane, started=before)
        gone = state.positions[0] - before[0]
        assert state.velocities[0] @ along == pytest.approx(kept * mix, abs=1e-5 * mix)
        assert state.velocities[0] @ up == pytest.approx(0, abs=1e-6)
        assert gone @ along == pytest.approx(kept * mix * DT, abs=1e-5)
        assert state.positions[0] @ up == pytest.approx(0, abs=1e-6)
        assert state.memory[SINCE][0] == 0


def test_bouncing() -> None:
    """Oracle: closed form; the normal speed relative to the moving ball turns round and loses."""
    ends = [[affector("sphere", (1, 0, 0), placed((0, 0, z)), restitution=0.5)] for z in (0, 0.02)]
    state = state_at([(0, 0, 1.0)], velocity=(0, 0, -3))
    step(state, *ends)
    speed = 0.02 / DT
    assert state.velocities[0, 2] == pytest.approx(speed + 0.5 * (3 + speed), rel=1e-5)
    assert state.positions[0, 2] == pytest.approx(1.02, abs=1e-6)


def test_what_sticks_rides_along() -> None:
    """Oracle: closed form. A splat that a turning plane lifts, with full friction, goes where the
    plane's matter goes, to the third order of the turn."""
    turns = [rotation((0, 1, 0), angle) for angle in (0.0, -0.02)]
    ends = [[affector("plane", matrix=placed((0, 0, 0), turn), friction=1.0)] for turn in turns]
    state = state_at([(0.5, 0.2, 0)])
    step(state, *ends)
    assert state.positions[0] == pytest.approx(turns[1] @ [0.5, 0.2, 0], abs=1e-6)


def test_pinned_splats_stay() -> None:
    """Oracle: the input."""
    state = state_at([(0.1, 0, 0), (0.1, 0, 0)])
    state.flags[0] |= PINNED
    ball = [affector("sphere", (0.5, 0, 0))]
    counts = step(state, ball, ball)
    assert counts.touched == 1
    assert state.positions[0].tolist() == [np.float32(0.1), 0, 0]
    assert state.positions[1, 0] == pytest.approx(0.5, abs=1e-6)


def test_clearance_is_of_usual_sizes_at_rest() -> None:
    """Oracle: closed form: on a ball of radius 0.5, splats of deviation s end 0.5 s outside of it,
    whatever they are stretched to, and a huge one as if it had three medians."""
    state = state_at(np.tile([(0.1, 0, 0)], (9, 1)), sigma=0.02)
    state.rest_scales[0] = 3.0
    state.scales[1:4] = 0.7
    ball = [affector("sphere", (0.5, 0, 0), clearance=0.5)]
    step(state, ball, ball)
    assert state.positions[0, 0] == pytest.approx(0.5 + 0.5 * 3 * 0.02, abs=1e-6)
    assert state.positions[1:, 0] == pytest.approx(np.full(8, 0.5 + 0.5 * 0.02), abs=1e-6)


def test_other_roles_and_disabled_affectors_push_nothing() -> None:
    """Oracle: the input."""
    state = state_at([(0.1, 0, 0)])
    others = [
        affector("sphere", (0.5, 0, 0), role="mask"),
        affector("sphere", (0.5, 0, 0), enabled=False),
    ]
    assert step(state, others, others).touched == 0
    assert state.positions[0, 0] == np.float32(0.1)


def test_boxes_and_planes() -> None:
    """Oracle: closed form in float64 NumPy, in the box's own frame; a splat leaves by the nearest
    face, at its clearance."""
    rng = np.random.default_rng(0)
    turn, place, half = rotation((3, 1, 2), 1.1), np.array([0.2, -0.4, 0.3]), (0.5, 0.3, 0.4)
    points = rng.uniform(-1, 1, (4000, 3))
    state = state_at(points, sigma=0.02)
    box = [affector("box", half, placed(place, turn), clearance=1.0)]
    step(state, box, box)
    local = (state.positions.astype(np.float64) - place) @ turn
    was = (np.float32(points).astype(np.float64) - place) @ turn
    q = np.abs(local) - half
    gap = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - 0.02
    assert gap.min() >= -1e-6
    inside = (np.abs(was) < half).all(axis=1)
    assert inside.sum() > 100
    depth = (half - np.abs(was)).min(axis=1)[inside]
    moved = np.linalg.norm(local - was, axis=1)[inside]
    # The last of four steps may turn to another face's normal only within rounding of an edge.
    assert np.quantile(np.abs(moved - depth - 0.02), 0.99) < 1e-5

    plane = [affector("plane", matrix=placed(place, turn))]
    step(state, plane, plane)
    assert ((state.positions.astype(np.float64) - place) @ turn)[:, 2].min() >= -1e-6


@pytest.mark.parametrize("clearance", [0.0, 2.0])
def test_what_a_ball_presses_into_the_ground_comes_out(clearance: float) -> None:
    """Oracle: distances from the ball and the ground; and lengths: nothing goes further than the
    solids are large. The shortest way out of the lower half of the ball leads into the ground."""
    rng = np.random.default_rng(8)
    points = np.float32(rng.uniform(-0.6, 0.6, (4000, 3))) * np.float32([1, 0, 1])
    points[:500, 1] = rng.uniform(-0.9, 0, 500)
    points[500:600] = 0
    ground = affector("plane", (0, 0, 0), placed(turn=rotation((1, 0, 0), -np.pi / 2)))
    for height in (0.0, 0.1, 0.5):
        at = placed((0, height, 0))
        knobs = {"blend": 0.03, "clearance": clearance}
        solids = [ground, affector("sphere", (0.6, 0, 0), at, path="/ball", **knobs)]
        state = state_at(points)
        counts = step(state, solids, solids)
        found = state.positions.astype(np.float64)
        assert counts.trapped == 0 and counts.marched > 0
        assert np.isfinite(found).all() and np.abs(found).max() < 3
        assert found[:, 1].min() > -1e-6
        assert np.linalg.norm(found - (0, height, 0), axis=1).min() > 0.6 - 1e-6


def test_what_has_no_way_out_stays_near() -> None:
    """Oracle: lengths: between two planes that face each other nothing is outside, and nothing goes
    further than it is deep."""
    up, down = (placed(turn=rotation((1, 0, 0), turn * np.pi / 2)) for turn in (-1, 1))
    solids = [affector("plane", matrix=up), affector("plane", matrix=down, path="/b")]
    points = np.random.default_rng(2).uniform(-1, 1, (50, 3))
    state = state_at(points)
    counts = step(state, solids, solids)
    assert counts.touched == counts.trapped == 50
    assert np.linalg.norm(state.positions - np.float32(points), axis=1).max() < 4


def test_a_mesh_pushes_like_the_ball_it_is() -> None:
    """Oracle: the ball, within a voxel's error of curvature: h²/(8 r) of interpolation, as much of
    the chords, and the bound of the field's far part where it is deep."""
    surface = icosphere(3, 0.5)
    turn, place = rotation((1, 0, 2), 0.4), np.array([1, 2, 3.0])
    rng = np.random.default_rng(0)
    state = state_at(rng.uniform(-0.6, 0.6, (4000, 3)) + place)
    mesh = [affector("mesh", matrix=placed(place, turn), surface=surface, voxel_size=0.025)]
    counts = step(state, mesh, mesh)
    radius = np.linalg.norm(state.positions - place, axis=1)
    assert counts.trapped == 0
    assert counts.touched > 1000
    assert radius.min() > 0.5 - 0.004
    pushed = state.memory[SINCE] == 0
    assert radius[pushed].max() < 0.5 + 0.002


def test_a_mesh_that_swells_hits() -> None:
    """Oracle: closed form; its surface moves by its growth, not with its matter."""
    surfaces = [icosphere(3, radius) for radius in (0.5, 0.52)]
    ends = [[affector("mesh", surface=each, voxel_size=0.025, ccd=False)] for each in surfaces]
    state = state_at([(0, 0, 0.505), (0.505, 0, 0)])
    step(state, *ends)
    assert state.velocities[0, 2] == pytest.approx(0.02 / DT, rel=0.05)
    assert state.velocities[1, 0] == pytest.approx(0.02 / DT, rel=0.05)


@serial
def velocity_at(bodies, rows, fields, voxels, x, y, z):
    """The surface's velocity, from Python."""
    return touch(bodies, rows, len(rows), fields, voxels, 1 / DT, x, y, z, 0.0, np.inf)


def test_velocity_of_a_turning_surface() -> None:
    """Oracle: finite differences of the point's own path over the substep, and its closed form
    omega x r up to the substep's curvature."""
    rate, axis = 3.0, np.array([1.0, 2.0, -1.0])
    turns = [rotation(axis, rate * t) for t in (0, DT)]
    places = [np.array([0.1, 0.2, 0.3]), np.array([0.15, 0.2, 0.25])]
    ends = [
        [affector("sphere", (1, 0, 0), placed(place, turn))]
        for place, turn in zip(places, turns, strict=True)
    ]
    bodies = pack_bodies(Fields(open_device()), *ends, DT)
    own = np.array([0.6, 0.0, 0.8])
    was, now = (turn @ own + place for turn, place in zip(turns, places, strict=True))
    rows = np.arange(1, dtype=np.int32)
    found = velocity_at(bodies.table, rows, bodies.fields.headers, bodies.fields.voxels, *now)
    assert found[:3] == pytest.approx((now - was) / DT, rel=1e-9)
    spin = np.cross(rate * axis / np.linalg.norm(axis), now - places[1])
    assert found[:3] == pytest.approx(spin + (places[1] - places[0]) / DT, abs=rate**2 * DT)
