"""Tests of continuous collision with fast solids."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tests.sim.affectors import affector, icosphere, placed, rotation, state_at
from usdsplat.kernels.devices import open_device
from usdsplat.sim.contact import Contacts
from usdsplat.sim.specs import Solid, Surface

R, FRAME = 0.05, 1 / 24


def sheet(n: int = 3000, half: float = 0.2) -> np.ndarray:
    """Points of a thin sheet at x = 0."""
    rng = np.random.default_rng(4)
    points = rng.uniform(-half, half, (n, 3))
    points[:, 0] = rng.normal(0, 1e-4, n)
    return points


def strike(points, make, substeps, *, start=-5.0, way=10.0, spin=0.0, sigma=1e-3):
    """Move an affector along x through points at rest; where they end, and how many strikes."""
    state = state_at(points, sigma=sigma)
    contacts = Contacts(open_device())
    struck = 0
    ends = []
    for s in range(substeps + 1):
        turn = rotation((1, 2, 3), spin * s / substeps)
        ends.append([make(placed((start + way * s / substeps, 0, 0), turn))])
    for before, after in pairwise(ends):
        counts = contacts.step(state, state.positions.copy(), before, after, FRAME / substeps)
        struck += counts.struck
    return state.positions.astype(np.float64), struck


def slid(points, friction: float) -> np.ndarray:
    """Closed form of a ball of radius R that moves from -5 to 5 along x: with a the angle of
    friction and s the way since the strike, tan((p - a) / 2) grows by exp(s sqrt(1 + mu²) / R)
    from the angle p of the strike; what reaches the equator is left there, what is struck within a
    is carried."""
    mu = friction / (1 - friction) if friction < 1 else np.inf
    points = np.float32(points).astype(np.float64)
    out = points.copy()
    across = np.hypot(points[:, 1], points[:, 2])
    for i in np.flatnonzero(across < R):
        angle, limit = np.arcsin(across[i] / R), np.arctan(mu)
        way = 5 - points[i, 0] + np.sqrt(R**2 - across[i] ** 2)
        if angle > limit:
            rate = np.sqrt(1 + mu**2) / R
            begin, end = np.tan((angle - limit) / 2), np.tan((np.pi / 2 - limit) / 2)
            needed = np.log(end / begin) / rate
            grown = np.log(begin) + rate * min(way, needed)
            angle = limit + 2 * np.arctan(np.exp(grown))
            way = min(way, needed)
        centre = points[i, 0] - np.sqrt(R**2 - across[i] ** 2) + way
        out[i, 0] = centre + R * np.cos(angle)
        out[i, 1:] = points[i, 1:] / across[i] * R * np.sin(angle)
    return out


@pytest.mark.parametrize("friction", [0.0, 0.2, 1.0])
def test_a_ball_through_a_sheet(friction: float) -> None:
    """Oracle: closed form of sliding along a ball, test 11 of the specification: 10 units in a
    frame, radius 0.05. Nothing is behind the front: what was struck is on the ball's front half or
    was left at its equator; and the number of substeps changes it by less than a tenth of R."""
    points = sheet()
    across = np.hypot(points[:, 1], points[:, 2])
    assert (across < R).sum() > 80
    expected = slid(points, friction)

    def make(matrix):
        return affector("sphere", (R, 0, 0), matrix, friction=friction)

    worst = 0.0
    for substeps in range(1, 9):
        ended, struck = strike(points, make, substeps)
        assert struck >= (across < 0.99 * R).sum()
        tube = (np.hypot(ended[:, 1], ended[:, 2]) < R * (1 - 1e-3)) & (ended[:, 0] < 5)
        assert not tube.any()
        worst = max(worst, np.linalg.norm(ended - expected, axis=1).max())
    assert worst < 0.1 * R


@pytest.mark.parametrize("kind", ["capsule", "cone", "box", "mesh"])
def test_other_solids_through_a_sheet(kind: str) -> None:
    """Oracle: the volume they pass, whose section across the way is known: of the splats in it none
    is left, however many substeps there are."""
    surface = icosphere(2, 0.1)
    turn = rotation((1, 0, 0), 0.5)

    def make(matrix):
        matrix = matrix @ placed((0, 0, 0), turn)
        if kind == "capsule":
            return affector("capsule", (R, R, 0.1), matrix, friction=0.2)
        if kind == "cone":
            return affector("capsule", (R, 0.02, 0.1), matrix, friction=0.2)
        if kind == "box":
            return affector("box", (0.004, 0.1, 0.05), matrix, friction=0.2)
        return affector("mesh", matrix=matrix, surface=surface, friction=0.2)

    points = sheet()
    section = points[:, 1:] @ turn[1:, 1:]
    if kind == "mesh":
        inside = np.hypot(*section.T) < 0.097
    elif kind == "box":
        inside = (np.abs(section) < (0.099, 0.049)).all(axis=1)
    else:
        inside = np.hypot(section[:, 0], np.maximum(np.abs(section[:, 1]) - 0.1, 0)) < 0.019
    assert inside.sum() > 50
    for substeps in (1, 3):
        ended, struck = strike(points, make, substeps)
        left = ended[inside]
        there = left[:, 1:] @ turn[1:, 1:]
        if kind == "mesh":
            hit = np.hypot(*there.T) < 0.097
        elif kind == "box":
            hit = (np.abs(there) < (0.099, 0.049)).all(axis=1)
        else:
            hit = np.hypot(there[:, 0], np.maximum(np.abs(there[:, 1]) - 0.1, 0)) < 0.019
        assert struck >= inside.sum()
        assert not (hit & (left[:, 0] < 4.9)).any()


def test_a_fast_splat_stops_at_a_thin_wall() -> None:
    """Oracle: closed form; the wall is at rest, and the splat keeps its way along it."""
    wall = [affector("box", (0.001, 5, 5))]
    state = state_at([(1.0, 0.5, 0.0)], velocity=(200, 50, 0))
    started = np.float32([(-1.0, 0.0, 0.0)])
    Contacts(open_device()).step(state, started, wall, wall, 0.01)
    assert state.positions[0] == pytest.approx([-0.001, 0.5, 0], abs=1e-5)
    assert state.velocities[0] == pytest.approx([0, 50, 0], abs=1e-3)


def test_without_ccd_a_ball_passes() -> None:
    """Oracle: the input, which proves that the tests above need the sweep."""
    points = sheet(200)
    ended, struck = strike(points, lambda m: affector("sphere", (R, 0, 0), m, ccd=False), 1)
    assert struck == 0
    assert (ended == np.float32(points)).all()


def test_a_mesh_swept_sideways_catches_what_is_before_its_field() -> None:
    """Oracle: closed form of where a thin plate's face ends. The splats begin far outside of the
    plate's distance field."""
    square = Surface(
        points=np.float32([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1),
                           (0.02, -1, -1), (0.02, 1, -1), (0.02, 1, 1), (0.02, -1, 1)]),
        triangles=np.int32([(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
                            (2, 3, 7), (2, 7, 6), (1, 2, 6), (1, 6, 5), (3, 0, 4), (3, 4, 7)]),
    )  # fmt: skip
    ended, _ = strike(
        sheet(300),
        lambda m: affector("mesh", matrix=m, surface=square, voxel_size=0.01),
        1,
    )
    assert ended[:, 0] == pytest.approx(np.full(300, 5.02), abs=0.003)


def test_a_degenerate_capsule_is_a_ball() -> None:
    """Oracle: the ball that holds the other."""
    state = state_at([(0, 0, -0.95), (0.3, 0, -0.5)])
    cone = [affector("capsule", (0.5, 0.1, 0.1), placed((0, 0, -0.4)))]
    assert isinstance(cone[0].solids[0], Solid)
    Contacts(open_device()).step(state, state.positions.copy(), cone, cone, 0.1)
    assert state.positions[0] == pytest.approx([0, 0, -1.0], abs=1e-6)
    assert state.positions[1] == pytest.approx([0.5, 0, -0.5], abs=1e-6)
