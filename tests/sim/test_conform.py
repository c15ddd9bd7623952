"""Tests of splats that move onto a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.shapes import sheet, sphere
from usdsplat.core import quaternion
from usdsplat.core.errors import StageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.conform import Conform
from usdsplat.sim.fitting import heights
from usdsplat.sim.neighbors import nearest
from usdsplat.sim.parameters import ConformParameters, Parameters, SimParameters
from usdsplat.sim.specs import Surface

MODES = ("closest", "projectAlong", "normalRay", "optimalSpread")
LATE = 100.0
"""[s] When all have arrived."""


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


@pytest.fixture(scope="module")
def ball(any_device):
    """Edges of 0.006: nowhere farther than 0.00002 from the sphere."""
    return sphere(8)


class Capture:
    """Flat splats about a dented shell, or above a sheet, with normals that are a little off."""

    def __init__(self, count, *, shell=True, seed=0):
        rng = np.random.default_rng(seed)
        if shell:
            out = rng.normal(size=(count, 3))
            out /= np.linalg.norm(out, axis=1)[:, None]
            away = 1.5 + 0.2 * np.sin(3 * out[:, :1])
            positions = away * out
        else:
            out = np.tile([0.0, 0.0, 1.0], (count, 1))
            positions = rng.uniform(-0.8, 0.8, (count, 3))
            positions[:, 2] = 0.5 + 0.1 * np.sin(5 * positions[:, 0])
        out += 0.2 * rng.normal(size=(count, 3))
        out /= np.linalg.norm(out, axis=1)[:, None]
        # Any rotation whose third column is the normal.
        across = np.cross(out, rng.normal(size=(count, 3)))
        across /= np.linalg.norm(across, axis=1)[:, None]
        frames = np.stack([across, np.cross(out, across), out], axis=2)
        self.positions = positions.astype(np.float32)
        self.rotations = quaternion.from_matrix(frames).astype(np.float32)
        self.scales = np.tile(np.array([0.05, 0.04, 0.01], np.float32), (count, 1))
        self.normals = out

    def conform(self, device, *, select=None, seed=0, **options):
        n = len(self.positions)
        return Conform(
            device,
            self.positions,
            self.rotations,
            self.scales,
            ids=np.arange(n, dtype=np.int64),
            select=np.ones(n, np.float32) if select is None else select,
            parameters=Parameters(
                conform=ConformParameters(**options), sim=SimParameters(seed=seed)
            ),
        )

    def at(self, conform, surface, now, **options):
        """Positions and gradients at a time."""
        positions = self.positions.copy()
        gradient = np.tile(np.eye(3, dtype=np.float32), (len(positions), 1, 1))
        conform.apply(surface, now, ConformParameters(**options), positions, gradient)
        return positions, gradient

    def arrived(self, device, surface, **options):
        options = {"weight": 1.0, **options}
        return self.at(self.conform(device, **options), surface, LATE, **options)

    def turned(self, gradient):
        """Normals of the splats, moved as planes are."""
        out = np.linalg.solve(gradient.astype(np.float64).swapaxes(1, 2), self.normals[..., None])
        return out[..., 0] / np.linalg.norm(out[..., 0], axis=1)[:, None]


def variation(points):
    """Coefficient of variation of the distance to the nearest other, by brute force."""
    points = points.astype(np.float64)
    square = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    np.fill_diagonal(square, np.inf)
    near = np.sqrt(square.min(axis=1))
    return near.std() / near.mean()


@pytest.mark.parametrize("mode", MODES)
def test_splats_lie_on_a_sphere(device, ball, mode):
    """Oracle: the sphere in closed form, of diameter 2 (test 18)."""
    capture = Capture(1000)
    positions, gradient = capture.arrived(device, ball, mode=mode, keep_thickness=0.0)
    radius = np.linalg.norm(positions.astype(np.float64), axis=1)
    assert np.abs(radius - 1).max() <= 1e-5 * 2
    along = np.einsum("ni,ni->n", capture.turned(gradient), positions / radius[:, None])
    assert np.abs(along).min() >= 0.9999
    squares = gradient.swapaxes(1, 2) @ gradient
    assert np.abs(squares - np.eye(3)).max() <= 1e-5, "they turn and do not stretch"
    if mode == "optimalSpread":
        assert variation(positions) <= 0.15


@pytest.mark.parametrize("mode", MODES)
def test_splats_lie_on_a_plane(device, mode):
    """Oracle: the plane z = 0, of size 2 (test 18); along an axis and by the closest point it is
    known where."""
    capture = Capture(1200, shell=False)
    options = {"mode": mode, "keep_thickness": 0.0, "axis": (0.1, 0.0, -1.0)}
    positions, gradient = capture.arrived(device, sheet(20), **options)
    assert np.abs(positions[:, 2]).max() <= 1e-5 * 2
    assert np.abs(capture.turned(gradient)[:, 2]).min() >= 0.9999
    start = capture.positions
    if mode == "closest":
        assert np.abs(positions[:, :2] - start[:, :2]).max() <= 1e-6
    if mode == "projectAlong":
        assert np.abs(positions[:, 0] - start[:, 0] - 0.1 * start[:, 2]).max() <= 1e-6
    if mode == "normalRay":
        met = start - (start[:, 2:] / capture.normals[:, 2:]) * capture.normals
        inside = (np.abs(met[:, :2]) < 1).all(axis=1)
        assert np.abs(positions[inside] - met[inside]).max() <= 1e-5
    if mode == "optimalSpread":
        assert variation(positions) <= 0.15


def test_a_box_keeps_its_edges(device):
    """Oracle: a cube's six normals: those of its corners are not mixed over its faces."""
    at = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [row for a, b, c, d in quads for row in ([a, b, c], [a, c, d])]
    box = Surface(points=at, triangles=np.array(triangles, np.int32))
    capture = Capture(1000)
    positions, gradient = capture.arrived(device, box, keep_thickness=0.0)
    size = np.abs(positions).max(axis=1)
    assert np.abs(size - 1).max() <= 1e-6
    flat = (np.abs(positions) > 1 - 1e-6).sum(axis=1) == 1
    assert flat.sum() > 300
    along = np.abs(capture.turned(gradient)[flat])
    assert np.abs(along - (np.abs(positions[flat]) > 1 - 1e-6)).max() <= 1e-5


def test_the_way_is_eased_and_everyone_sets_off_in_turn(device):
    """Oracle: the smootherstep polynomial; random delays are uniform and follow the seed, those by
    distance are ranks."""
    capture, surface = Capture(2000, shell=False), sheet(4)
    options = {
        "weight": 0.8, "start": 1.0, "duration": 2.0, "stagger": 3.0, "keep_thickness": 0.0,
        "order": "distance",
    }  # fmt: skip
    rng = np.random.default_rng(1)
    select = rng.uniform(0, 1, 2000).astype(np.float32)
    select[:10] = 0
    conform = capture.conform(device, select=select, **options)
    start = capture.positions[:, 2]
    ranks = np.argsort(np.argsort(start, kind="stable")) / 1999
    for now in (0.5, 1.7, 3.0, 4.4, 9.0):
        positions, gradient = capture.at(conform, surface, now, **options)
        s = np.clip((now - 1 - 3 * ranks) / 2, 0, 1)
        way = 0.8 * select * (6 * s**5 - 15 * s**4 + 10 * s**3)
        assert np.abs(positions[:, 2] - (1 - way) * start).max() <= 1e-6
        assert np.array_equal(positions[way == 0], capture.positions[way == 0])
        assert np.array_equal(gradient[way == 0], np.tile(np.eye(3), (np.sum(way == 0), 1, 1)))
    drawn = []
    for seed in (1, 1, 2):
        conform = capture.conform(device, seed=seed, weight=1.0, order="random")
        capture.at(conform, surface, 0.0)
        drawn.append(np.sort(conform.memory()["ranks"]) if not drawn else conform.memory()["ranks"])
    assert np.abs(drawn[0] - np.linspace(0, 1, 2000)).max() <= 0.05
    assert np.array_equal(drawn[0], np.sort(drawn[1])) and not np.array_equal(drawn[1], drawn[2])


def test_splats_turn_a_part_of_the_way(device):
    """Oracle: the angle between a splat's normal and the plane's shrinks in proportion."""
    capture, surface = Capture(500, shell=False), sheet(2)
    options = {"duration": 0.0, "stagger": 0.0, "weight": 0.6, "orient": 0.5}
    _, gradient = capture.arrived(device, surface, **options)
    before = np.arccos(np.clip(capture.normals[:, 2], -1, 1))
    after = np.arccos(np.clip(capture.turned(gradient)[:, 2], -1, 1))
    assert before.max() > 0.3
    assert np.abs(after - 0.7 * before).max() <= 1e-5


def test_height_over_the_captures_own_surface_is_kept(device):
    """Oracle: by construction: a few splats are 0.2 and -0.1 off a wavy sheet's even grid."""
    at = np.linspace(-0.8, 0.8, 45)
    x, y = (each.reshape(-1) for each in np.meshgrid(at, at))
    capture = Capture(len(x), shell=False)
    off = np.zeros(len(x))
    off[5 * 45 + 5 :: 9 * 45 + 9], off[30 * 45 + 30] = 0.2, -0.1
    capture.positions = np.stack([x, y, 3 + 0.05 * (x * x + y * y) + off], axis=1).astype("f4")
    for keep in (1.0, 0.5):
        positions, _ = capture.arrived(device, sheet(3), keep_thickness=keep)
        near, _ = nearest(device, capture.positions, capture.positions, 17)
        clean = (np.abs(off[near[:, 1:]]) < 0.01).all(axis=1)
        assert (off[clean] != 0).sum() >= 4
        assert np.abs(positions[clean, 2] - keep * off[clean]).max() <= 2e-3


def test_a_round_capture_is_on_its_own_surface(device):
    """Oracle: spheres of 2,000 and 8,000 points even in closed form (Fibonacci): a plane would be
    off by h²/4, this by less than a tenth of it, and it shrinks."""
    worst = []
    for n in (2000, 8000):
        k = np.arange(n) + 0.5
        z, turn = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
        across = np.sqrt(1 - z * z)
        points = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
        points = points.astype(np.float32)
        near, far = nearest(device, points, points, 17)
        over, normals = heights(points, near[:, 1:])
        assert np.abs(np.abs((normals * points).sum(axis=1)) - 1).max() <= 1e-3
        worst.append(np.abs(over).max())
        assert worst[-1] <= 0.1 * (far[:, -1] ** 2).mean() / 4
    assert worst[1] <= worst[0] / 2


def moved_mesh(surface, move):
    points = surface.points @ move[:3, :3].T + move[:3, 3]
    return Surface(points=points.astype(np.float32), triangles=surface.triangles)


def test_splats_ride_a_mesh_that_moves(device):
    """Oracle: the rigid motions of the mesh, through more than half a turn: places, turns and
    heights go along; and places on a mesh that bends are those of its triangles."""
    capture, surface = Capture(2000), sphere(4)
    options = {"weight": 1.0, "duration": 0.5, "stagger": 0.2}
    conform = capture.conform(device, **options)
    positions, gradient = capture.at(conform, surface, LATE, **options)
    axis = np.array([0.6, 0.0, 0.8])
    for angle in (0.4, 2.0, 3.5):
        turn = np.array([[np.cos(angle / 2), *np.sin(angle / 2) * axis]])
        move = np.eye(4)
        move[:3, :3], move[:3, 3] = quaternion.to_matrix(turn)[0], (0.3, -2.0, angle)
        found, slopes = capture.at(conform, moved_mesh(surface, move), LATE, **options)
        assert np.abs(found - (positions @ move[:3, :3].T + move[:3, 3])).max() <= 1e-5
        assert np.abs(slopes - move[:3, :3] @ gradient).max() <= 1e-4
    bent = surface.points * [1, 2, 0.5] + 0.2 * np.sin(4 * surface.points[:, [2, 0, 1]])
    bent = Surface(points=bent.astype(np.float32), triangles=surface.triangles)
    found, _ = capture.at(conform, bent, LATE, **options, keep_thickness=0.0)
    memory = conform.memory()
    corners = bent.points.astype(np.float64)[bent.triangles[memory["faces"]]]
    assert np.abs(found - np.einsum("nk,nkx->nx", memory["places"], corners)).max() <= 1e-6


def test_sliding_nears_the_mesh_by_the_same_part_everywhere(device):
    """Oracle: distance to the sphere in closed form is (1 - c) of that at the beginning, from
    outside and from inside, on a mesh within 0.0001 of it; on straight ways it is not. Both end in
    the same places."""
    capture, ball = Capture(1000), sphere(6)
    capture.positions[::2] *= 0.5
    axis = {"axis": (0.0, 1.0, 0.1), "mode": "projectAlong", "keep_thickness": 0.0}
    before = np.linalg.norm(capture.positions, axis=1) - 1
    conform = capture.conform(device, path="slide", **axis)
    straight = capture.conform(device, path="straight", **axis)
    off = []
    for c in (0.2, 0.5, 0.8, 1.0):
        options = {"weight": c, "duration": 0.0, "stagger": 0.0, **axis}
        slid, _ = capture.at(conform, ball, 0.0, path="slide", **options)
        after = np.linalg.norm(slid, axis=1) - 1
        assert np.abs(after - (1 - c) * before).max() <= 3e-4
        line, _ = capture.at(straight, ball, 0.0, **options)
        off.append(np.abs(np.linalg.norm(line, axis=1) - 1 - (1 - c) * before).max())
    assert np.abs(slid - line).max() <= 1e-5 and max(off) > 0.05


@pytest.mark.parametrize("scale_mode", ["preserve", "density", "flatten"])
def test_sizes_stay_grow_with_spacing_or_become_flat(device, scale_mode):
    """Oracle: closed form: a shell of half the radius, so spacing doubles, but for the mesh's
    corners, on average; what is flat has 0.15 of the mean size along the surface."""
    capture = Capture(4000)
    out = capture.positions / np.linalg.norm(capture.positions, axis=1)[:, None]
    capture.positions = (0.5 * out).astype(np.float32)
    capture.scales[:] = (0.05, 0.04, 0.03)
    positions, gradient = capture.arrived(device, sphere(6), scale_mode=scale_mode)
    stretch = np.linalg.svd(gradient.astype(np.float64), compute_uv=False)
    expected = {
        "preserve": [1, 1, 1],
        "density": [2, 2, 1],
        "flatten": [1, 1, 0.15 * np.sqrt(0.05 * 0.04) / 0.03],
    }[scale_mode]
    assert np.abs(stretch.mean(axis=0) - expected).max() <= 1e-2
    assert np.abs(stretch - expected).max() <= (0.15 if scale_mode == "density" else 1e-5)
    up = positions / np.linalg.norm(positions, axis=1)[:, None]
    thin = gradient.astype(np.float64) @ capture.normals[..., None]
    assert np.abs(np.linalg.norm(thin[..., 0], axis=1) - expected[2]).max() <= 1e-5
    assert np.abs(np.einsum("ni,ni->n", capture.turned(gradient), up)).min() >= 0.9999


def test_what_came_before_is_turned_from_the_left(device):
    """Oracle: the splats' planes as the earlier gradient moved them lie on the mesh, and no angle
    or length changes."""
    capture, surface = Capture(400, shell=False), sheet(3)
    rng = np.random.default_rng(4)
    before = (np.eye(3) + 0.2 * rng.normal(size=(400, 3, 3))).astype(np.float32)
    options = {"weight": 1.0}
    positions, gradient = capture.positions.copy(), before.copy()
    conform = capture.conform(device, **options)
    conform.apply(surface, LATE, ConformParameters(**options), positions, gradient)
    assert np.abs(capture.turned(gradient)[:, 2]).min() >= 0.9999
    metric, expected = gradient.swapaxes(1, 2) @ gradient, before.swapaxes(1, 2) @ before
    assert np.abs(metric - expected).max() <= 1e-5
    alone = capture.positions.copy()
    capture.conform(device, **options).apply(surface, LATE, ConformParameters(**options), alone)
    assert np.abs(alone - positions).max() <= 1e-6


def test_a_restart_goes_on_with_the_same_bits(device):
    """Oracle: the run that was not interrupted, on a mesh that bends."""
    capture, surface = Capture(1500), sphere(3)
    options = {"weight": 1.0, "mode": "normalRay", "path": "slide", "scale_mode": "density"}
    meshes = [
        Surface(
            points=(surface.points * [1 + 0.3 * k, 1, 1 - 0.2 * k]).astype(np.float32),
            triangles=surface.triangles,
        )
        for k in range(3)
    ]
    whole = capture.conform(device, **options)
    capture.at(whole, meshes[0], 0.0, **options)
    kept = {name: array.copy() for name, array in whole.memory().items()}
    capture.at(whole, meshes[1], 1.0, **options)
    expected = capture.at(whole, meshes[2], 1.7, **options)
    resumed = capture.conform(device, **options)
    resumed.restore(kept)
    found = capture.at(resumed, meshes[2], 1.7, **options)
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_children_set_off_with_their_parents_for_places_of_their_own(device):
    """Oracle: by hand on a plane; the dead are gone, the others' bits are those of before."""
    capture, surface = Capture(300, shell=False), sheet(3)
    options = {"weight": 1.0, "duration": 1.0, "stagger": 2.0}
    conform = capture.conform(device, **options)
    before, _ = capture.at(conform, surface, 1.3, **options)
    parents = np.array([7, 7, 250])
    moved = capture.positions[parents] + np.array([0.01, 0, 0], np.float32)
    more = conform.extended(
        parents, moved, capture.rotations[parents], capture.scales[parents], np.arange(300, 303)
    )
    positions = np.concatenate([capture.positions, moved])
    more.apply(surface, 1.3, ConformParameters(**options), positions)
    assert np.array_equal(positions[:300], before)
    shift = positions[300:] - before[parents]
    assert np.abs(shift - [0.01, 0, 0]).max() <= 1e-6
    rows = np.arange(303)[::3]
    fewer = np.concatenate([capture.positions, moved])[rows]
    more.selected(rows).apply(surface, 1.3, ConformParameters(**options), fewer)
    assert np.array_equal(fewer, positions[rows])


@pytest.mark.parametrize("mode", ["normalRay", "optimalSpread"])
def test_conforming_has_the_same_bits_on_any_number_of_threads(mode):
    """Oracle: one thread."""
    capture, surface = Capture(3000), sphere(4)
    options = {"weight": 1.0, "mode": mode, "path": "slide", "scale_mode": "density"}
    results = []
    for threads in (1, 2):
        conform = capture.conform(open_device(threads=threads), **options)
        results.append(capture.at(conform, surface, 1.2, **options))
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))


def test_places_that_are_nowhere_stay_and_other_triangles_are_refused(device):
    """Oracle: bits, and the sentence."""
    capture = Capture(50)
    capture.positions[3] = np.nan
    options = {"weight": 1.0, "path": "slide"}
    conform = capture.conform(device, **options)
    positions, _ = capture.at(conform, sphere(1), LATE, **options)
    assert np.isnan(positions[3]).all() and np.isfinite(np.delete(positions, 3, axis=0)).all()
    with pytest.raises(StageError, match="other triangles than before"):
        capture.at(conform, sphere(2), LATE, **options)
