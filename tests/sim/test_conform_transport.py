"""Tests of splats that conform to a mesh by transport."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.recipes import Written, always, ball, knobs, played, started
from tests.sim.shapes import sheet, sphere
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.conform_transport import TransportConform
from usdsplat.sim.specs import Surface
from usdsplat.sim.state import Frame

SOON = {"weight": 1.0, "duration": 0.0, "stagger": 0.0, "keep_thickness": 0.0}
ROD = np.float32([0.4, 2.0, 0.4])


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def arrived(device, rest, target, frames=2, **options):
    """The last frame, with the target at all times."""
    recipe = Written(rest, always(parameters=knobs(conform={**SOON, **options}), target=target))
    return played(device, recipe, frames)[-1].cloud


def ellipsoid():
    mesh = sphere(4)
    return Surface(points=mesh.points * ROD, triangles=mesh.triangles)


def test_splats_cover_another_shape(device):
    """Oracle: the equation of the ellipsoid, and the neighbours at rest, by brute force."""
    rest = ball(3000)
    cloud = arrived(device, rest, ellipsoid())
    height = np.linalg.norm(cloud.positions / ROD, axis=1)
    assert height.min() > 0.9 and height.max() < 1.01, "they lie on it, a little below the surface"
    ends = np.abs(cloud.positions[:, 1])
    assert (ends > 1.6).mean() > 0.03, "the ends are covered"
    apart = nearest(device, cloud.positions, cloud.positions, 2)[1][:, 1]
    assert np.median(apart) < 0.06, "even"
    near = nearest(device, rest.positions, rest.positions, 7)[0][:, 1:]
    spacing = np.sqrt(8.5 / 3000)
    far = np.linalg.norm(cloud.positions[near] - cloud.positions[:, None], axis=2) / spacing
    assert (far < 3).mean() > 0.65 and (far < 6).mean() > 0.9, "neighbours stay neighbours"


def test_sizes_follow_the_spacing(device):
    """Oracle: a sphere of ten times the size: distances grow tenfold, so sizes do."""
    rest = ball(2000)
    mesh = sphere(4)
    large = Surface(points=10 * mesh.points, triangles=mesh.triangles)
    cloud = arrived(device, rest, large)
    ratio = np.sort(cloud.scales, axis=1)[:, 1:] / np.sort(rest.scales, axis=1)[:, 1:]
    assert 8 < np.median(ratio) < 16


def test_splats_ride_on_the_target(device):
    """Oracle: after their arrival, a rotation and a translation of the mesh are those of the
    splats."""
    angle = 0.7
    turn = np.float32(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    mesh = ellipsoid()
    shift = np.float32([3, 1, 2])
    moved = Surface(points=mesh.points @ turn.T + shift, triangles=mesh.triangles)

    def says(time):
        return {"parameters": knobs(conform=SOON), "target": mesh if time < 3 else moved}

    frames = played(device, Written(ball(800), says), 4)
    before, after = frames[1].cloud, frames[3].cloud
    np.testing.assert_allclose(after.positions, before.positions @ turn.T + shift, atol=2e-5)
    np.testing.assert_allclose(after.scales, before.scales, rtol=2e-3, atol=1e-6)


def test_the_first_frame_is_the_capture(device):
    """Oracle: the capture, bit for bit."""
    rest = ball(400)
    parameters = knobs(conform={"weight": 1.0, "start": 0.1})
    first = played(device, Written(rest, always(parameters=parameters, target=sphere(2))), 2)[0]
    for name in ("positions", "rotations", "scales", "opacities", "sh"):
        assert np.array_equal(getattr(first.cloud, name), getattr(rest, name)), name


def test_paths_are_arcs(device):
    """Oracle: halfway, without an arc splats are in the middle; the arc leads outwards."""
    rest, target = ball(600), sphere(4, 3.0)
    options = {"duration": 2.0, "start": 0.0}
    places = [
        arrived(device, rest, target, 25, **options, arc=arc).positions
        for arc in (0.0, 0.25, -0.25)
    ]
    straight, out, inwards = places
    assert not np.allclose(straight, out)
    np.testing.assert_allclose((out + inwards) / 2, straight, atol=1e-5)


def test_an_order_from_a_primvar_starts_splats(device):
    """Oracle: those with 0 have arrived when those with 1 have not started."""
    rest = ball(500)
    order = (rest.positions[:, 2] > 0).astype(np.float32)
    parameters = knobs(conform={**SOON, "duration": 0.1, "stagger": 10.0})
    says = always(parameters=parameters, target=sphere(3, 2.0), order=order)
    cloud = played(device, Written(rest, says), 12)[-1].cloud
    assert np.array_equal(cloud.positions[order == 1], rest.positions[order == 1])
    assert np.linalg.norm(cloud.positions[order == 0], axis=1).min() > 1.8


def test_a_front_passes_down(device):
    """Oracle: heights at rest: those that have moved are the upper ones."""
    rest = ball(500)
    slow = {**SOON, "duration": 0.1, "stagger": 1.0, "order": "height"}
    says = always(parameters=knobs(conform=slow), target=sphere(3, 2.0))
    cloud = played(device, Written(rest, says), 12)[-1].cloud
    moved = (cloud.positions != rest.positions).any(axis=1)
    assert 0.2 < moved.mean() < 0.8
    assert np.quantile(rest.positions[moved, 1], 0.05) > np.quantile(
        rest.positions[~moved, 1], 0.95
    ) - np.float32(0.2)


def test_unselected_splats_stay(device):
    """Oracle: their positions at rest; and the others cover the whole target."""
    rest = ball(1500)
    weight = (rest.positions[:, 0] > 0).astype(np.float32)
    recipe = Written(
        rest, always(parameters=knobs(conform=SOON), target=sphere(3, 2.0)), selection=weight
    )
    cloud = played(device, recipe, 2)[-1].cloud
    assert np.array_equal(cloud.positions[weight == 0], rest.positions[weight == 0])
    assert (cloud.positions[weight == 1, 0] < -1).mean() > 0.1


@pytest.mark.parametrize("count", [1, 3, 20])
def test_tiny_captures_arrive(device, count):
    """Oracle: the sphere."""
    cloud = arrived(device, ball(count), sphere(3, 2.0))
    assert np.abs(np.linalg.norm(cloud.positions, axis=1) - 2).max() < 0.2
    assert np.isfinite(cloud.scales).all()


def test_splats_move_to_the_closest_points_of_a_target_without_area(device):
    """Oracle: the closest points of the same mesh, and the finding."""
    mesh = sheet(3)
    flat = Surface(points=mesh.points * np.float32([1, 0, 0]), triangles=mesh.triangles)
    found = []
    for mode in ("transport", "closest"):
        conform = {"weight": 1.0, "duration": 0.2, "start": 0.0, "mode": mode}
        recipe = Written(ball(100), always(parameters=knobs(conform=conform), target=flat))
        solver = started(device, recipe, 3)
        for _ in range(2):
            solver.advance()
        codes = [each.code for each in solver.findings]
        assert ("flat-target" in codes) == (mode == "transport")
        found.append(solver.frame().cloud.positions)
    np.testing.assert_array_equal(*found)


def test_threads_and_restarts_give_the_same_bits():
    """Oracle: one thread, without a restart."""
    parameters = knobs(conform={"weight": 1.0, "duration": 0.2, "stagger": 0.1, "start": 0.0})
    recipe = Written(ball(600), always(parameters=parameters, target=ellipsoid()))
    found = []
    for threads in (1, 2):
        solver = started(CpuDevice(threads=threads), recipe, 8)
        for number in range(7):
            if number == 3 and threads == 2:
                state = solver.checkpoint()
                solver = started(CpuDevice(threads=2), recipe, 8, state=state)
            solver.advance()
        found.append(solver.frame().cloud)
    for name in ("positions", "rotations", "scales", "sh"):
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name)), name


def test_a_cloud_is_not_changed(device):
    """Oracle: a copy of the capture's arrays."""
    rest = ball(200)
    names = ("positions", "rotations", "scales", "opacities", "sh")
    before = {name: getattr(rest, name).copy() for name in names}
    arrived(device, rest, sphere(2, 1.5))
    assert isinstance(rest, SplatCloud)
    assert all(np.array_equal(before[name], getattr(rest, name)) for name in names)


def test_the_look_in_flight_follows_births_and_deaths(device):
    """Oracle: the parents: before the next pose children have their progress, and other rows their
    own; without a target all look as they do at rest; after arrival it is exactly 1, which is no
    flight, also with weights."""
    rest, target = ball(300), sphere(3, 8.0)
    carriers = Carriers.of(device, rest, seed=1)
    rng = np.random.default_rng(6)
    select = np.float32(rng.uniform(0.1, 1, 300))
    slow = knobs(conform={**SOON, "weight": 0.7, "duration": 1.0, "stagger": 1.0})
    ids = np.arange(300)
    order = np.float32(rng.permutation(ids) / 299)  # neighbours are torn apart
    conform = TransportConform(
        device, rest, carriers, ids=ids, select=select, order=order, up=(0, 1, 0), parameters=slow
    )

    def shown(now, some, rows):
        clouds = edit.take(rest, rows)
        return some.finished(
            Frame(time=now, cloud=clouds, uv=np.zeros((0, 2)), births=np.zeros(0))
        ).cloud

    conform.apply(target, 1.0, slow.conform, rest.positions.copy())
    whole = shown(1.0, conform, ids)
    assert (whole.scales != rest.scales).any()
    rows, few = np.concatenate([ids[::3], ids[:50]]), ids[:15:3]
    for found in (conform.selected(rows), conform.selected(ids[::3]).extended(
        np.arange(5), rest.positions[few], rest.rotations[few], rest.scales[few], ids[:5]
    )):  # fmt: skip
        own = rows if len(found) == len(rows) else np.concatenate([ids[::3], few])
        assert np.array_equal(shown(1.0, found, own).scales, whole.scales[own])
    conform.apply(target, 5.0, slow.conform, rest.positions.copy())
    assert shown(5.0, conform, ids).scales.tobytes() == rest.scales.tobytes()
    conform.apply(target, 1.0, slow.conform, rest.positions.copy())
    conform.pause()
    assert shown(1.0, conform, ids).scales.tobytes() == rest.scales.tobytes()


@pytest.mark.parametrize(("weight", "is_torn"), [(0.01, False), (1.0, True)])
def test_what_hardly_moves_keeps_its_look(device, weight, is_torn):
    """Oracle: the splats before, a hundredth of their way or half of it to a ball twice as large,
    in random order."""
    rest, target = ball(300), sphere(3, 2.0)
    slow = knobs(
        conform={**SOON, "weight": weight, "duration": 1.0, "stagger": 1.0, "order": "random"}
    )
    conform = TransportConform(
        device, rest, Carriers.of(device, rest, seed=1), ids=np.arange(300),
        select=np.ones(300, np.float32), order=None, up=(0, 1, 0), parameters=slow,
    )  # fmt: skip
    conform.apply(target, 1.0, slow.conform, rest.positions.copy())
    frame = Frame(time=1.0, cloud=rest, uv=np.zeros((0, 2)), births=np.zeros(0))
    assert (conform.finished(frame).cloud.scales != rest.scales).any() == is_torn


@pytest.mark.parametrize(("order", "is_torn"), [("distance", False), ("random", True)])
def test_what_is_not_torn_keeps_its_look_in_flight(device, order, is_torn):
    """Oracle: the splats before: a ball that grows evenly keeps its neighbours together halfway,
    unless its splats start at random."""
    rest, parameters = ball(300), knobs(conform={**SOON, "duration": 2.0, "order": order})
    conform = TransportConform(
        device, rest, Carriers.of(device, rest, seed=1), ids=np.arange(300), order=None,
        select=np.ones(300, np.float32), up=(0, 1, 0), parameters=parameters,
    )  # fmt: skip
    conform.apply(sphere(3, 2.0), 1.0, parameters.conform, rest.positions.copy())
    frame = Frame(time=1.0, cloud=rest, uv=np.zeros((0, 2)), births=np.zeros(0))
    cloud = conform.finished(frame).cloud
    assert (cloud.scales != rest.scales).any() == is_torn
    assert (cloud.sh != rest.sh).any() == is_torn
