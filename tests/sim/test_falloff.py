"""Tests of the falloff of affectors."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import affector, icosphere, placed, rotation
from usdsplat.kernels.devices import open_device
from usdsplat.sim.falloff import falloff
from usdsplat.sim.parameters import AffectorParameters
from usdsplat.sim.specs import Affector


def smooth(distance, width):
    """1 inside, 0 from `width` on."""
    t = np.clip(distance / width, 0, 1)
    return 1 - t * t * (3 - 2 * t)


@pytest.mark.parametrize("kind", ["sphere", "capsule", "box", "plane", "mesh"])
def test_every_solid(kind: str) -> None:
    """Oracle: closed form of the distance, and of the curve over it; outside of a mesh's field
    too, where distances may be too large."""
    turn, place = rotation((1, -2, 1), 0.8), np.array([0.5, 0.1, -0.3])
    points = np.random.default_rng(0).uniform(-2, 2, (3000, 3)).astype(np.float32)
    local = (points - place) @ turn
    size, surface, tolerance = (0.4, 0.4, 0.5), None, 1e-5
    if kind == "sphere":
        distance = np.linalg.norm(local, axis=1) - 0.4
    elif kind == "capsule":
        local[:, 2] -= np.clip(local[:, 2], -0.5, 0.5)
        distance = np.linalg.norm(local, axis=1) - 0.4
    elif kind == "box":
        q = np.abs(local) - size
        distance = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    elif kind == "plane":
        distance = local[:, 2]
    else:
        surface, tolerance = icosphere(3, 0.4), 0.06
        distance = np.linalg.norm(local, axis=1) - 0.4
    body = affector(kind, size, placed(place, turn), surface=surface, role="mask", falloff=0.7)
    found = falloff(open_device(), body, points)
    assert found.dtype == np.float32
    assert np.abs(found - smooth(distance, 0.7)).max() < tolerance
    assert (found[distance < -0.01] == 1).all()


def test_no_falloff_is_a_step() -> None:
    """Oracle: the ball."""
    points = np.float32([(0.39, 0, 0), (0.41, 0, 0), (9, 9, 9)])
    body = affector("sphere", (0.4, 0, 0), role="seed")
    assert falloff(open_device(), body, points).tolist() == [1, 0, 0]


def test_solids_of_one_affector_are_one_shape() -> None:
    """Oracle: closed form of the smooth minimum half-way between two balls: lower by a quarter of
    the blend."""
    balls = [affector("sphere", (0.4, 0, 0), placed((x, 0, 0))).solids[0] for x in (-0.5, 0.5)]
    knobs = AffectorParameters(role="mask", falloff=1.0, blend=0.2)
    both = Affector(path="/a", parameters=knobs, solids=tuple(balls))
    points = np.float32([(0, 0, 0), (0, 0.7, 0), (0, 3, 0)])
    distance = np.linalg.norm(points - [0.5, 0, 0], axis=1) - 0.4 - 0.2 / 4
    found = falloff(open_device(), both, points)
    assert found == pytest.approx(smooth(distance, 1.0), abs=1e-6)


def test_an_affector_without_solids_weighs_nothing() -> None:
    """Oracle: nothing."""
    none = Affector(path="/a", parameters=AffectorParameters(role="mask"), solids=())
    assert not falloff(open_device(), none, np.zeros((4, 3), np.float32)).any()
