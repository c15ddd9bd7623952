"""Tests that pieces of broken stone are filled. Oracles: a ball's geometry, and the capture."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.sim.recipes import ARRAYS, Written, always, ball, knobs, played
from usdsplat.kernels.devices import open_device
from usdsplat.sim import population
from usdsplat.sim.carriers import NEAR, Carriers
from usdsplat.sim.infill import Infill
from usdsplat.sim.parameters import AffectorParameters
from usdsplat.sim.pieces import Pieces
from usdsplat.sim.specs import Affector, Solid
from usdsplat.sim.state import Frame, State

COUNT = 2000


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


@pytest.fixture(scope="module")
def broken(device) -> list[Frame]:
    """Frames of a ball of stone of radius 1 whose top is inside something that collides."""
    parameters = knobs(
        matter={"enabled": True, "material": "stone", "roots": 0.2},
        carriers={"spacing": 0.09},
        refine={"enabled": "off"},
    )
    place = np.eye(4)
    place[:3, 3] = (0, 1.1, 0)
    solid = Solid(kind="sphere", size=(0.4, 0.0, 0.0), matrix=place)
    hammer = Affector(path="/Hammer", parameters=AffectorParameters(), solids=(solid,))
    moments = always(parameters=parameters, affectors=(hammer,))
    return played(device, Written(ball(COUNT), moments), 6)


def test_nothing_is_filled_at_first(broken) -> None:
    """Oracle: the capture's arrays, bit for bit."""
    rest = ball(COUNT)
    for name in ARRAYS:
        if name != "positions":  # what is inside the hammer is pushed out at once
            assert np.array_equal(getattr(broken[0].cloud, name), getattr(rest, name))


def test_a_piece_that_breaks_off_gets_an_inside(device) -> None:
    """Oracle: the ball: new splats are below its surface, under their piece, and follow it; and
    they are there once."""
    rest = ball(COUNT)
    state = State.of(rest, np.ones(COUNT, np.float32))
    carriers = Carriers.of(device, rest, distance=0.09, seed=1)
    carriers.bind(device, rest.positions).keep(state)
    c, graph = len(carriers), carriers.graph
    pieces = Pieces(
        device, carriers, graph.rows, graph.neighbors, colors=np.full((c, 3), 0.5, np.float32),
        size=8.0, roots=np.zeros(c, np.bool_), seed=1,
    )  # fmt: skip
    filling = Infill(
        device, carriers, pieces, colors=np.full((c, 3), 0.5, np.float32),
        origin=np.zeros(c, np.int32), ids=np.arange(COUNT), size=8.0, seed=1,
    )  # fmt: skip
    assert not len(filling.due(state, maximum=10**9)[0])
    pieces.stands[3] = False
    chosen, rows = filling.due(state, maximum=10**9)
    population.append(state, rows, now=0.0)
    filling.shape(state, chosen)
    at = state.rest_positions[COUNT:]
    radius = np.linalg.norm(at, axis=1)
    assert len(at) > 50 and radius.max() < 1.0 and radius.min() > 0.3
    assert (pieces.piece[state.memory[NEAR][COUNT:, 0]] == 3).all()
    middle = carriers.positions[pieces.piece == 3].mean(axis=0)
    assert np.linalg.norm(at - middle, axis=1).max() < 8 * 0.09
    assert not len(filling.due(state, maximum=10**9)[0])


def test_pieces_are_filled_once(broken) -> None:
    """Oracle: identities: those of a frame are in the next one, and none is there twice."""
    for before, after in itertools.pairwise(broken):
        assert set(before.cloud.ids.tolist()) <= set(after.cloud.ids.tolist())
    places = broken[-1].cloud.positions[broken[-1].cloud.ids >= COUNT]
    assert len(places) > 50
    assert len(np.unique(places, axis=0)) == len(places)
