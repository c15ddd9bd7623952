"""Tests of matter. Oracles: free fall, momentum, the catenary, the bent beam, and definitions."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.materials import MATERIALS
from usdsplat.sim.matter import SPAN, Matter, edges
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.parameters import (
    AffectorParameters,
    MatterParameters,
    NeighborsParameters,
    Parameters,
    ParticlesParameters,
)
from usdsplat.sim.specs import Affector, Moment, Solid
from usdsplat.sim.state import PINNED
from usdsplat.sim.timeline import Step

DT = 1 / 96


@pytest.fixture(scope="module")
def device(any_device):
    """One thread: there are many small launches."""
    return open_device(threads=1)


def carriers_at(device, points, spacing):
    """Carriers at given points."""
    points = np.float32(points)
    parameters = NeighborsParameters(h_min=2 * spacing, h_max=2 * spacing)
    graph = Neighbors(device, parameters).update(points, np.full(len(points), 2 * spacing, "f4"))
    return Carriers(
        positions=points,
        normals=np.zeros_like(points),
        outer=np.ones(len(points), np.bool_),
        dimension=np.full(len(points), 3, np.float32),
        graph=graph,
        spacing=spacing,
    )


def moment_of(time=0.0, affectors=(), fall=0.0, **knobs):
    """Values of a stage with matter whose knobs differ from the defaults; `fall` is gravity."""
    matter = MatterParameters(enabled=True, **{"roots": -1.0, **knobs})
    gravity = ParticlesParameters(gravity=(0.0, -fall, 0.0))
    parameters = Parameters(matter=matter, particles=gravity)
    return Moment(
        time=time, parameters=parameters, to_world=np.eye(4), up=(0, 1, 0), affectors=affectors
    )


def matter_of(device, carriers, moment, held=()):
    """Matter at rest, of which some carriers are held."""
    c = len(carriers)
    found = Matter(
        device, carriers, np.ones(c, np.float32), np.full((c, 3), 0.5, np.float32), moment
    )
    found.move_to(carriers.positions)
    flags = now(device, found, "flags")
    flags[list(held)] |= PINNED
    put(device, found, flags=flags)
    return found


def now(device, matter, name="positions"):
    """A copy of an array of the particles, which are in the memory of the device."""
    return np.array(device.fetch(getattr(matter.particles, name)))


def put(device, matter, **arrays):
    """Replace arrays of the particles."""
    for name, array in arrays.items():
        setattr(matter.particles, name, device.move(np.ascontiguousarray(array)))


def digest(matter):
    """The bytes of all that a restart needs."""
    return {name: np.asarray(each).tobytes() for name, each in matter.memory().items()}


def run(matter, carriers, moment_at, steps, dt=DT):
    """Take steps with values of the stage at each step."""
    for number in range(1, steps + 1):
        before, after = moment_at(number - 1), moment_at(number)
        matter.advance(carriers.positions, before, after, Step(number * dt, dt, 0))


def block(n=6, spacing=1.0):
    """A cube of points, slightly uneven."""
    axis = np.arange(n) * spacing
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return points + 0.1 * spacing * np.random.default_rng(1).uniform(-1, 1, points.shape)


def ball(at, radius, **knobs):
    """A ball that pushes."""
    matrix = np.eye(4)
    matrix[:3, 3] = at
    parameters = AffectorParameters(friction=0.0, blend=0.0, **knobs)
    solid = Solid(kind="sphere", matrix=matrix, size=(radius, 0.0, 0.0))
    return Affector(path="/Ball", parameters=parameters, solids=(solid,))


def test_edges_go_both_ways(device):
    """Oracle: the definition, on random points."""
    carriers = carriers_at(device, np.random.default_rng(2).random((300, 3)), 0.1)
    rows, ends, twins = edges(device, carriers)
    own = np.repeat(np.arange(300), np.diff(rows))
    assert np.array_equal(own[twins], ends) and np.array_equal(ends[twins], own)
    assert np.array_equal(twins[twins], np.arange(len(ends)))
    length = np.linalg.norm(carriers.positions[own] - carriers.positions[ends], axis=1)
    assert length.min() > 0 and length.max() <= SPAN * 0.1 * (1 + 1e-6)


@pytest.mark.parametrize("material", ["custom", "foliage", "cloth", "rubber", "jelly", "clay"])
def test_matter_at_rest_stays_bit_for_bit(device, material):
    """Oracle: the positions before. Gravity is left out."""
    carriers = carriers_at(device, block(), 1.0)
    moment = moment_of(material=material)
    matter = matter_of(device, carriers, moment)
    run(matter, carriers, lambda _: moment, 20)
    assert np.array_equal(now(device, matter), carriers.positions)
    assert not now(device, matter, "velocities").any()


def test_free_matter_falls(device):
    """Oracle: free fall by symplectic Euler, g dt² n (n + 1) / 2 after n steps."""
    carriers = carriers_at(device, block(), 1.0)
    moment = moment_of(fall=9.81, gravity=1.0, back=0.0, damping=0.0)
    matter = matter_of(device, carriers, moment)
    run(matter, carriers, lambda _: moment, 48)
    moved = now(device, matter) - carriers.positions
    np.testing.assert_allclose(moved[:, 1], -9.81 * DT**2 * 48 * 49 / 2, rtol=2e-5)
    np.testing.assert_allclose(moved[:, [0, 2]], 0, atol=1e-5)


def test_momentum_is_conserved(device):
    """Oracle: the momentum at the start, of random velocities; and the angular momentum, for edges
    and rigid shapes alike."""
    carriers = carriers_at(device, block(), 1.0)
    moment = moment_of(back=0.0, damping=0.0, stiffness=60.0, stretch=1.05, press=0.95)
    matter = matter_of(device, carriers, moment)
    velocities = np.random.default_rng(3).normal(size=(216, 3)) * 3
    velocities += np.cross((0, 0.5, 1.0), carriers.positions - carriers.positions.mean(axis=0))
    put(device, matter, velocities=velocities.astype(np.float32))

    def momenta():
        x, v = (now(device, matter, name).astype(float) for name in ("positions", "velocities"))
        return v.sum(axis=0), np.cross(x - x.mean(axis=0), v).sum(axis=0)

    linear, angular = momenta()
    energy = (velocities**2).sum()
    run(matter, carriers, lambda _: moment, 100)
    velocities = now(device, matter, "velocities")
    assert (velocities**2).sum() < 0.95 * energy  # the constraints have worked
    found = momenta()
    rate = np.abs(velocities).sum() / 216
    np.testing.assert_allclose(found[0], linear, atol=2e-3 * rate)
    # rotations are found in a few iterations, so that a little of the spin is lost
    np.testing.assert_allclose(found[1], angular, atol=0.1 * np.linalg.norm(angular))


def test_a_chain_hangs_in_a_catenary(device):
    """Oracle: the catenary of the same length between the same ends."""
    n, span = 61, 40.0
    length = 1.0 * (n - 1)
    points = np.zeros((n, 3))
    points[:, 0] = np.linspace(0, span, n)
    height = length / 4  # starts as a zigzag of the right length, so that no edge is stretched
    half = span / 2
    fold = np.sqrt((length / 2) ** 2 - half**2)
    points[:, 1] = -fold * (1 - np.abs(points[:, 0] / half - 1))
    carriers = carriers_at(device, points, 1.0)
    moment = moment_of(
        fall=9.81, gravity=1.0, back=0.0, damping=1.5, stiffness=0.0, stretch=1.0, press=0.0,
        iterations=24,
    )  # fmt: skip
    matter = matter_of(device, carriers, moment, held=(0, n - 1))
    run(matter, carriers, lambda _: moment, 600)
    low, high = 1e-3, 1e3
    while high / low > 1 + 1e-12:  # length = 2 a sinh(span / 2a)
        a = (low * high) ** 0.5
        low, high = (a, high) if 2 * a * np.sinh(half / min(a, 1e9)) > length else (low, a)
    x, y, _ = now(device, matter).T
    expected = a * (np.cosh((x - half) / a) - np.cosh(half / a))
    assert expected.min() < -0.9 * height
    # edges still stretch a little
    assert np.abs(y - expected).max() < 0.06 * -expected.min()


def test_a_beam_bends_like_a_cantilever(device):
    """Oracle: Euler and Bernoulli's shape of a beam under its own weight, x² (x² − 4 L x + 6 L²);
    and the deflection, which doubles with the weight."""
    x, y, z = np.meshgrid(np.arange(25), np.arange(3), np.arange(3), indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(float)
    carriers = carriers_at(device, points, 1.0)
    held = np.flatnonzero(points[:, 0] <= 1)
    tips = []
    for fall in (0.4, 0.8):
        moment = moment_of(
            fall=fall, gravity=1.0, back=0.0, damping=4.0, stiffness=60.0, stretch=10.0, press=0.0
        )
        matter = matter_of(device, carriers, moment, held=held)
        run(matter, carriers, lambda _, moment=moment: moment, 500)
        sag = (now(device, matter) - carriers.positions)[:, 1].reshape(25, -1).mean(axis=1)
        tips.append(sag[-1])
        along = np.maximum(np.arange(25) - 1.0, 0)
        shape = along**2 * (along**2 - 4 * 23 * along + 6 * 23**2)
        assert np.abs(sag / sag[-1] - shape / shape[-1]).max() < 0.12
    assert -10 < tips[1] < -0.2
    assert tips[1] / tips[0] == pytest.approx(2, rel=0.08)


def test_edges_are_not_stretched_beyond_the_limit(device):
    """Oracle: the limit, while a ball passes through a sheet that is held at its ends."""
    axis = np.arange(30.0)
    points = np.stack(np.meshgrid(axis, axis, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    carriers = carriers_at(device, points, 1.0)
    held = np.flatnonzero((points[:, 0] == 0) | (points[:, 0] == 29))

    def at(number):
        return moment_of(
            affectors=(ball((14.5, 14.5, -6 + 0.1 * number), 3.0),), material="foliage"
        )

    matter = matter_of(device, carriers, at(0), held=held)
    farthest = 0.0
    for number in range(1, 160):
        matter.advance(carriers.positions, at(number - 1), at(number), Step(number * DT, DT, 0))
        moved = np.linalg.norm(now(device, matter) - carriers.positions, axis=1).max()
        farthest = max(farthest, float(moved))
        assert np.quantile(matter.stretches(), 0.999) < 1.35
    assert 2.0 < farthest < 1.3 * 3.0
    calm = moment_of(material="foliage")
    for number in range(288):
        matter.advance(carriers.positions, calm, calm, Step((160 + number) * DT, DT, 0))
    left = np.linalg.norm(now(device, matter) - carriers.positions, axis=1).max()
    assert left < 0.01 * 29


def test_an_edge_tears_from_both_ends(device):
    """Oracle: the definition of tearing, edge by edge."""
    carriers = carriers_at(device, block(), 1.0)
    moment = moment_of(back=0.0, stiffness=0.0, stretch=10.0, press=0.0, tear=1.3)
    matter = matter_of(device, carriers, moment)
    put(device, matter, positions=carriers.positions * np.float32((1.4, 1.0, 1.0)))
    matter.advance(carriers.positions, moment, moment, Step(DT, DT, 0))
    rows, ends, twins = edges(device, carriers)
    own = np.repeat(np.arange(216), np.diff(rows))
    length, rest = (
        np.linalg.norm(p[own].astype(np.float64) - p[ends], axis=1)
        for p in (now(device, matter), carriers.positions)
    )
    cut = matter.memory()["cut"]
    assert np.array_equal(cut, cut[twins]) and 0 < cut.mean() < 1
    clear = np.abs(length / rest - 1.3) > 1e-4
    assert np.array_equal(cut[clear] == 1, (length / rest > 1.3)[clear])


def test_plastic_matter_stays_bent_and_elastic_matter_does_not(device):
    """Oracle: the definition, on a strip whose end is moved and let go."""
    x, y = np.meshgrid(np.arange(20.0), np.arange(4.0), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    carriers = carriers_at(device, points, 1.0)
    held = np.flatnonzero(points[:, 0] <= 2)
    left = {}
    for name, knobs in (("elastic", {}), ("plastic", {"plasticity": 0.98, "yielding": 0.01})):

        def at(number, knobs=knobs):
            pushes = ball((19, 1.5, -5 + min(0.08 * number, 7)), 4.0, enabled=number < 200)
            return moment_of(
                affectors=(pushes,), back=0.0, damping=1.0, stiffness=60.0, stretch=2.0, press=0.4,
                **knobs,
            )  # fmt: skip

        matter = matter_of(device, carriers, at(0), held=held)
        run(matter, carriers, at, 900)
        left[name] = float(now(device, matter)[-4:, 2].mean())
    assert left["plastic"] > 2.0
    assert abs(left["elastic"]) < 0.3 * left["plastic"]


@pytest.mark.parametrize("material", ["foliage", "clay", "stone", "sand"])
def test_any_number_of_threads_gives_the_same_bits(material):
    """Oracle: one thread."""
    digests = []
    for device in (CpuDevice(threads=1), all_cores()):
        carriers = carriers_at(device, block(8), 1.0)

        def at(number):
            return moment_of(
                affectors=(ball((-3 + 0.1 * number, 3.5, 3.5), 2.0),), fall=9.81, material=material,
                ground=True, roots=0.1,
            )  # fmt: skip

        matter = matter_of(device, carriers, at(0))
        run(matter, carriers, at, 60)
        digests.append(digest(matter))
    assert digests[0] == digests[1]


@pytest.mark.parametrize("material", ["clay", "stone"])
def test_a_restored_simulation_continues_with_the_same_bits(device, material):
    """Oracle: the run that was not interrupted."""
    carriers = carriers_at(device, block(8), 1.0)

    def at(number):
        return moment_of(
            affectors=(ball((-3 + 0.1 * number, 3.5, 3.5), 2.0),), fall=9.81, material=material,
            ground=True, roots=0.1,
        )  # fmt: skip

    whole = matter_of(device, carriers, at(0))
    run(whole, carriers, at, 40)
    memory = {key: np.array(each) for key, each in whole.memory().items()}
    again = matter_of(device, carriers, at(0))
    again.restore(memory)
    for number in range(41, 70):
        for matter in (whole, again):
            step = Step(number * DT, DT, 0)
            matter.advance(carriers.positions, at(number - 1), at(number), step)
    assert digest(whole) == digest(again)


def test_pieces_stay_rigid_and_fall_without_support(device):
    """Oracle: distances within each piece, and the heights: what is above a cut falls to the
    ground, what is below stays."""
    x, y, z = np.meshgrid(np.arange(5.0), np.arange(16.0), np.arange(5.0), indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    carriers = carriers_at(device, points, 1.0)

    def at(number):
        return moment_of(
            affectors=(ball((-4 + 0.3 * number, 7.5, 2.0), 3.0),), fall=40.0, ground=True,
            roots=0.1, **{**MATERIALS["stone"], "grain": 2.5},
        )  # fmt: skip

    matter = matter_of(device, carriers, at(0))
    run(matter, carriers, at, 200)
    assert matter.pieces is not None
    piece, stands = matter.pieces.piece, matter.pieces.stands
    places = now(device, matter)
    for number in np.unique(piece):
        rows = np.flatnonzero(piece == number)
        before, after = (
            np.linalg.norm(p[rows][:, None] - p[rows][None], axis=-1)
            for p in (carriers.positions, places)
        )
        assert np.abs(after - before).max() < 0.05
    assert stands[piece[points[:, 1] < 2]].all()
    assert np.array_equal(places[stands[piece]], carriers.positions[stands[piece]])
    upper = points[:, 1] > 13
    assert not stands[piece[upper]].any()
    assert places[upper, 1].mean() < 9
    assert places[:, 1].min() > -0.5
