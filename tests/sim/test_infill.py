"""Tests that pieces of broken stone are filled. Oracles: a ball's geometry, and the capture."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest

from tests.sim.recipes import ARRAYS, Written, always, ball, knobs, played, started
from usdsplat.core.quaternion import to_matrix
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim import population
from usdsplat.sim.carriers import NEAR, Carriers
from usdsplat.sim.infill import OPENED, Infill
from usdsplat.sim.parameters import AffectorParameters
from usdsplat.sim.pieces import Pieces
from usdsplat.sim.seams import Seams
from usdsplat.sim.specs import Affector, Solid
from usdsplat.sim.state import Frame, State

COUNT = 2000


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


def stone() -> Written:
    """A ball of stone of radius 1 whose top is inside something that collides."""
    parameters = knobs(
        matter={"enabled": True, "material": "stone", "roots": 0.2},
        carriers={"spacing": 0.09},
        refine={"enabled": "off"},
    )
    place = np.eye(4)
    place[:3, 3] = (0, 1.1, 0)
    solid = Solid(kind="sphere", size=(0.4, 0.0, 0.0), matrix=place)
    hammer = Affector(path="/Hammer", parameters=AffectorParameters(), solids=(solid,))
    return Written(ball(COUNT), always(parameters=parameters, affectors=(hammer,)))


@pytest.fixture(scope="module")
def broken(device) -> list[Frame]:
    """Frames of that ball."""
    return played(device, stone(), 6)


def test_nothing_is_filled_at_first(broken) -> None:
    """Oracle: the capture's arrays, bit for bit."""
    rest = ball(COUNT)
    for name in ARRAYS:
        if name != "positions":  # what is inside the hammer is pushed out at once
            assert np.array_equal(getattr(broken[0].cloud, name), getattr(rest, name))


def whole(device: CpuDevice) -> tuple[State, Carriers, Pieces, Infill]:
    """A ball of stone in pieces, and what fills them."""
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
        up=np.array((0, 1, 0), np.float32), parents=np.zeros(c, np.int64),
        size=8.0, seed=1,
    )  # fmt: skip
    return state, carriers, pieces, filling


def test_a_piece_that_breaks_off_gets_an_inside(device) -> None:
    """Oracle: the ball: new splats are below its surface, under their piece, and follow it; and
    they are there once."""
    state, carriers, pieces, filling = whole(device)
    most, places = 10**9, carriers.positions.copy()
    pieces.stands[3] = False
    assert not filling.due(state, places, maximum=most)  # loose, but it has not moved
    places[pieces.piece == 3] += np.float32(0.5) * places[pieces.piece == 3]
    due = filling.due(state, places, maximum=most)
    assert due.is_first and due.seams.any()
    population.append(state, due.parents, now=0.0)
    filling.shape(state, due)
    at, carrier = state.rest_positions[COUNT:], state.memory[NEAR][COUNT:, 0]
    radius = np.linalg.norm(at, axis=1)
    assert len(at) > 50 and radius.max() < 1.0 and radius.min() > 0.3
    own = pieces.piece[carrier] == 3
    middle = carriers.positions[pieces.piece == 3].mean(axis=0)
    assert own.sum() > 50 and np.linalg.norm(at[own] - middle, axis=1).max() < 8 * 0.09
    assert not filling.due(state, places, maximum=most)


def test_seams_open_as_a_whole_or_not_yet(device) -> None:
    """Oracle: the filling without a limit: with half of its room fewer seams open, each with all of
    its points, and later the others, with the same filling in all; without room none opens, and
    nothing is cut."""
    state, carriers, pieces, filling = whole(device)
    seams, places = Seams.of(device, carriers, pieces.piece), 1.5 * carriers.positions
    pieces.stands[:] = False
    everything = filling.due(copy.deepcopy(state), places, maximum=10**9)
    wanted = len(everything.chosen)
    assert not filling.due(state, places, maximum=COUNT) and not state.globals[OPENED].any()
    first = filling.due(state, places, maximum=COUNT + wanted // 2)
    assert 0 < len(first.chosen) <= wanted // 2
    pair = np.sort(np.stack([seams.own, seams.other], axis=1), axis=1)
    shut = everything.seams & ~first.seams
    assert shut.any() and not set(map(tuple, pair[shut])) & set(map(tuple, pair[first.seams]))
    second = filling.due(state, places, maximum=10**9)
    assert np.array_equal(second.seams, shut) and not second.is_first
    both = np.concatenate([first.chosen, second.chosen])
    assert np.array_equal(np.sort(both), everything.chosen)


def test_splats_end_at_the_seams_that_open(device) -> None:
    """Oracle: the plane of a seam: what is left of a splat is on its own side, up to twice its
    standard deviation; splats away from seams, and on seams that stay shut, keep every bit."""
    carriers = Carriers.of(device, ball(COUNT), distance=0.09, seed=1)
    piece = (carriers.positions[:, 0] > 0).astype(np.int32)
    seams = Seams.of(device, carriers, piece)
    assert np.abs(seams.positions[:, 0]).max() < 0.1
    assert (np.abs(seams.normals[:, 0]) > 0.9).mean() > 0.95
    rng = np.random.default_rng(4)
    places = np.array([(0.03, 0.6, 0.8), (0.7, 0.7, 0.1), (-0.02, 0.0, -1.0)], np.float32)
    turns = rng.normal(size=(3, 4)).astype(np.float32)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    sizes = np.full((3, 3), 0.1, np.float32) * np.array([1, 2, 0.2], np.float32)
    shapes, sides = (places, turns, sizes), (places[:, 0] > 0).astype(np.int32)
    shut = np.zeros(len(seams), np.bool_)
    rest = sides, carriers.spacing, shapes
    assert not len(seams.cut(device, shut, shut, *rest)[0])
    assert not len(seams.cut(device, ~shut, shut, *rest)[0])
    rows, (at, rotations, scales), gone = seams.cut(device, ~shut, ~shut, *rest)
    assert rows.tolist() == [0, 2] and not gone.any()
    axes = to_matrix(rotations) * scales[:, None]
    sigma = np.sqrt((axes[:, 0] ** 2).sum(axis=1))
    inside = np.where(sides[rows] == 1, at[:, 0], -at[:, 0])
    assert (inside > 1.5 * sigma).all() and (inside > np.abs(places[rows, 0])).all()


def straight(count: int) -> Seams:
    """A seam along x with a point at every unit, between piece 0 below y = 0 and piece 1 above."""
    at = np.zeros((2 * count, 3), np.float32)
    at[:, 0] = np.tile(np.arange(count), 2)
    own = np.repeat([0, 1], count)
    normals = np.zeros_like(at)
    normals[:, 1] = 1 - 2 * own
    rows = np.arange(2 * count)
    return Seams(
        carriers=rows, beyond=np.roll(rows, count), own=own, other=1 - own, positions=at,
        normals=normals,
    )  # fmt: skip


def test_a_point_cuts_what_is_beside_it(device) -> None:
    """Oracle: the distance along the seam: with one point open, a splat beside it is cut, one
    beyond it vanishes, and those 6 distances further keep every bit; also where the seam ends."""
    places = np.float32([(4, -0.1, 0), (4, 0.5, 0), (10, -0.1, 0), (10, 0.5, 0), (-6, 0.5, 0)])
    turns = np.tile(np.float32([1, 0, 0, 0]), (len(places), 1))
    shapes = places, turns, np.full((len(places), 3), 0.2, np.float32)
    piece = np.zeros(len(places), np.int32)
    for chosen, cut, vanished in (([4], [0, 1], [False, True]), ([0], [], [])):
        seams, open_ = straight(9 + 3), np.zeros(24, np.bool_)
        open_[chosen] = True
        rows, _, gone = seams.cut(device, open_, open_, piece, 1.0, shapes)
        assert rows.tolist() == cut and gone.tolist() == vanished


def test_shapes_do_not_depend_on_when_points_open(device) -> None:
    """Oracle: all points at once, for random splats: the last result for each has the same bits,
    whatever the order of opening was."""
    seams, rng = straight(9), np.random.default_rng(3)
    places = np.float32(rng.uniform((0, -1, -0.3), (8, 0.2, 0.3), (200, 3)))
    turns = rng.normal(size=(200, 4)).astype(np.float32)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    shapes = places, turns, np.float32(rng.uniform(0.05, 0.6, (200, 3)))
    piece, every = np.zeros(200, np.int32), np.ones(18, np.bool_)
    rows, made, _ = seams.cut(device, every, every, piece, 1.0, shapes)
    assert 50 < len(rows) < 200
    found, open_ = [each.copy() for each in shapes], np.zeros(18, np.bool_)
    for point in rng.permutation(9):
        fresh = np.arange(18) % 9 == point
        open_ |= fresh
        some, shaped, _ = seams.cut(device, open_, fresh, piece, 1.0, shapes)
        for array, values in zip(found, shaped, strict=True):
            array[some] = values
    for array, values in zip(found, made, strict=True):
        assert np.array_equal(array[rows], values)


def test_pieces_are_filled_once(broken) -> None:
    """Oracle: identities: those of a frame are in the next one, and none is there twice."""
    for before, after in itertools.pairwise(broken):
        assert set(before.cloud.ids.tolist()) <= set(after.cloud.ids.tolist())
    places = broken[-1].cloud.positions[broken[-1].cloud.ids >= COUNT]
    assert len(places) > 50
    assert len(np.unique(places, axis=0)) == len(places)


def test_threads_and_restarts_give_the_same_bits() -> None:
    """Oracle: one thread, without a restart."""
    found = []
    for threads, restart in ((1, None), (2, 3)):
        solver = started(CpuDevice(threads=threads), stone(), 6)
        for number in range(5):
            if number == restart:
                solver = started(CpuDevice(threads=threads), stone(), 6, state=solver.checkpoint())
            solver.advance()
            solver.frame()
        found.append(solver.frame().cloud)
    for name in ARRAYS:
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name)), name
