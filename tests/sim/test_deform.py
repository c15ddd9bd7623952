"""Tests of deformers and their stack."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.deform import deform
from usdsplat.sim.parameters import DeformParameters
from usdsplat.sim.specs import Deformer

RNG = np.random.default_rng(11)
CORNERS = [(x, y, z) for z in (0, 0.4, 1) for y in (0, 1) for x in (0, 0.3, 0.6, 1)]
BULGE = tuple(tuple(row) for row in np.array(CORNERS) + 0.3 * RNG.normal(size=(24, 3)))
KINDS: dict[str, dict[str, Any]] = {
    "transform": {"translate": (0.1, 0.2, 0.3), "rotate": (20, 30, -40), "scale": (1.5, 0.7, 1.1)},
    "bend": {"angle": 80.0, "length": 1.3},
    "twist": {"angle": 200.0, "length": 0.8},
    "taper": {"scale": (0.3, 1.4, 1.8), "length": 1.5},
    "lattice": {"divisions": (4, 2, 3), "points": BULGE},
    "noise": {"amount": 0.1, "size": 0.7, "speed": 0.5, "seed": 3},
    "curl": {"amount": 0.1, "size": 0.7, "speed": 0.5, "seed": 3},
    "wave": {"amount": 0.1, "size": 0.9, "speed": 0.5},
}
FRAME = np.eye(4)
FRAME[:3, :3] = np.linalg.qr(np.random.default_rng(12).normal(size=(3, 3)))[0] @ np.diag([2, 1, 1])
FRAME[:3, 3] = 0.1, -0.2, 0.3


def one(kind, *, frame=None, mask=None, **values):
    """A deformer of a kind, by the numbers above unless told otherwise."""
    parameters = DeformParameters(type=kind, **{**KINDS[kind], **values})
    return Deformer(
        name=kind, parameters=parameters, frame=np.eye(4) if frame is None else frame, mask=mask
    )


def run(deformers, points, *, seconds=0.3, threads=None):
    """(positions, gradients) of a stack, from the identity."""
    positions = np.array(points, np.float32)
    gradient = np.tile(np.eye(3, dtype=np.float32), (len(positions), 1, 1))
    deform(open_device(threads=threads), deformers, seconds, positions, gradient)
    return positions, gradient


def cloud(n=400, *, seed=1, clear=0.02):
    """Points in [-1, 2]^3, none near the planes at which a deformer begins or ends."""
    points = np.random.default_rng(seed).uniform(-1, 2, (n, 3))
    for plane in (0, 0.8, 1, 1.3, 1.5):
        points[np.abs(points - plane) < clear] += 2 * clear
    return np.float32(points)


def by_differences(deformers, points, h):
    """J by central differences of positions, float64 differences of float32 results."""
    out = np.empty((len(points), 3, 3))
    for c in range(3):
        ahead, behind = points.copy(), points.copy()
        ahead[:, c] += np.float32(h)
        behind[:, c] -= np.float32(h)
        base = ahead[:, c].astype(np.float64) - behind[:, c]
        change = run(deformers, ahead)[0].astype(np.float64) - run(deformers, behind)[0]
        out[:, :, c] = change / base[:, None]
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_that_of_the_map(kind) -> None:
    """Oracle: central differences, to 1e-3 of the size of J; test 19 of the specification. Curl has
    a gradient by differences itself, of a map that is C1 only at the faces of its cells."""
    points = cloud(150 if kind == "curl" else 400)
    _, gradient = run([one(kind)], points)
    expected = by_differences([one(kind)], points, 4e-3)
    error = np.abs(gradient - expected).max(axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert error.max() < (5e-3 if kind == "curl" else 1e-3)
    assert np.median(error) < 1e-3


@pytest.mark.parametrize("kind", ["bend", "noise", "taper"])
def test_gradient_knows_frame_and_falloff_and_weight(kind) -> None:
    """Oracle: central differences through a frame that scales unevenly, for all of them at once."""
    deformer = one(kind, frame=FRAME, falloff=1.4, weight=0.7)
    points = cloud(300, seed=2) * np.float32(0.6)
    local = np.linalg.inv(FRAME) @ np.column_stack([points, np.ones(300)]).T
    near = np.abs(local[1, :, None] - [0, 1.3, 1.5]).min(axis=1) < 0.02
    _, gradient = run([deformer], points)
    expected = by_differences([deformer], points, 4e-3)
    error = np.abs(gradient - expected).max(axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    assert error[~near].max() < 2e-3 and np.abs(gradient - np.eye(3)).max() > 0.05


@pytest.mark.parametrize(("axis", "order"), [("X", [1, 2, 0]), ("Y", [2, 0, 1]), ("Z", [0, 1, 2])])
def test_twist_turns_about_each_axis_and_keeps_volume(axis, order) -> None:
    """Oracle: closed form: at half of the length half of the angle; |J| = 1 to 1e-5, test 19."""
    deformer = one("twist", axis=axis, angle=180.0, length=2.0)
    point = np.zeros((1, 3))
    point[0, order] = 1, 0, 1
    expected = np.zeros(3)
    expected[order] = 0, 1, 1
    np.testing.assert_allclose(run([deformer], point)[0][0], expected, atol=1e-6)
    _, gradient = run([deformer], cloud())
    assert np.abs(np.linalg.det(gradient.astype(np.float64)) - 1).max() < 1e-5


def test_bend_is_an_arc() -> None:
    """Oracle: closed form: Y from 0 to pi / 2 by 90 degrees is a quarter of the unit circle about
    (p, s) = (1, 0), p being Z; after it goes on straight; |J| = 1 - p."""
    deformer = one("bend", angle=90.0, length=math.pi / 2)
    s = np.linspace(0.01, 1.56, 20)
    points = np.column_stack([np.zeros(20), s, np.zeros(20)])
    found, gradient = run([deformer], points)
    np.testing.assert_allclose(found[:, 2], 1 - np.cos(s), atol=1e-6)
    np.testing.assert_allclose(found[:, 1], np.sin(s), atol=1e-6)
    off, gradient = run([deformer], points + np.array([0.5, 0, 0.25]))
    np.testing.assert_allclose(np.linalg.det(gradient), 0.75, atol=1e-5)
    np.testing.assert_allclose(off[:, 0], 0.5)
    beyond, _ = run([deformer], [[0, math.pi / 2 + 1, 0], [0, -1, 0.2]])
    np.testing.assert_allclose(beyond, [[0, 1, 2], [0, -1, 0.2]], atol=1e-6)


def test_no_angle_is_no_bend() -> None:
    """Oracle: the points; and an angle of a millionth moves them by no more than that."""
    points = cloud(50)
    assert np.array_equal(run([one("bend", angle=0.0)], points)[0], points)
    near = run([one("bend", angle=1e-4)], points)[0]
    np.testing.assert_allclose(near, points, atol=1e-5)


def test_transform_is_scale_then_x_then_y_then_z_then_move() -> None:
    """Oracle: closed form: (1, 1, 1), stretched to (2, 1, 1), by 90 degrees about X (2, -1, 1),
    then Z (1, 2, 1), moved; and J in a frame is B A B^-1."""
    values = {"scale": (2.0, 1.0, 1.0), "rotate": (90.0, 0.0, 90.0), "translate": (1.0, 0.0, 0.0)}
    found, gradient = run([one("transform", **values)], [[1, 1, 1]])
    np.testing.assert_allclose(found[0], [2, 2, 1], atol=1e-6)
    _, framed = run([one("transform", frame=FRAME, **values)], [[1, 1, 1]])
    b = FRAME[:3, :3]
    np.testing.assert_allclose(framed[0], b @ gradient[0] @ np.linalg.inv(b), atol=1e-6)


def test_taper_scales_across_its_axis() -> None:
    """Oracle: closed form: half way, half of the scale; along Y its own is not looked at."""
    deformer = one("taper", scale=(3.0, 9.0, 2.0), length=2.0)
    found, _ = run([deformer], [[1, 1, 1], [1, 5, 1], [1, -1, 1]])
    np.testing.assert_allclose(found, [[2, 1, 1.5], [3, 5, 2], [1, -1, 1]], atol=1e-6)


def test_wave_runs_and_comes_back() -> None:
    """Oracle: closed form: Y moves by a sin 2 pi (z / size - speed t)."""
    points = cloud(50)
    found, _ = run([one("wave", amount=0.2, size=0.5, speed=2.0)], points, seconds=0.35)
    expected = points[:, 1] + 0.2 * np.sin(2 * math.pi * (points[:, 2] / 0.5 - 0.7))
    np.testing.assert_allclose(found[:, 1], expected, atol=1e-6)
    assert np.array_equal(found[:, [0, 2]], points[:, [0, 2]])


def bernstein(n, k, t):
    """The k-th polynomial of degree n."""
    return math.comb(n, k) * t**k * (1 - t) ** (n - k)


@pytest.mark.parametrize("divisions", [(4, 2, 3), (16, 2, 2), (2, 2, 16)])
def test_lattice_is_the_mixture_of_its_points(divisions) -> None:
    """Oracle: Bernstein's polynomials, summed one by one; at the corners its corner points."""
    nx, ny, nz = divisions
    control = np.random.default_rng(4).random((nz, ny, nx, 3))
    points = tuple(map(tuple, control.reshape(-1, 3)))
    where = np.vstack([np.random.default_rng(5).random((20, 3)), [[0, 0, 0], [1, 1, 1]]])
    found, _ = run([one("lattice", divisions=divisions, points=points)], where)
    expected = np.zeros((22, 3))
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                w = bernstein(nx - 1, i, where[:, 0]) * bernstein(ny - 1, j, where[:, 1])
                w = w * bernstein(nz - 1, k, where[:, 2])
                expected += w[:, None] * control[k, j, i]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(found[-2:], [control[0, 0, 0], control[-1, -1, -1]], atol=1e-6)


def test_lattice_outside_of_its_cube_moves_with_the_nearest_point() -> None:
    """Oracle: the displacement at that point."""
    outside = np.float32([[1.5, 0.5, 0.25], [-1, -1, 2]])
    nearest = np.clip(outside, 0, 1)
    a, b = (run([one("lattice")], p)[0] - p for p in (outside, nearest))
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_lattice_at_rest_moves_nothing_and_wrong_ones_are_told() -> None:
    """Oracle: the points; and one sentence that names both counts."""
    grid = np.moveaxis(np.indices((2, 2, 2))[::-1], 0, 3).reshape(-1, 3)
    still = one("lattice", divisions=(2, 2, 2), points=tuple(map(tuple, grid * 1.0)))
    points = cloud(50)
    for deformer in (still, one("lattice", points=())):
        positions, gradient = run([deformer], points)
        assert np.array_equal(positions, points)
        assert np.array_equal(gradient, np.tile(np.eye(3), (50, 1, 1)))
    with pytest.raises(UsageError, match=r"lattice.points: found 24 points, expected 27, for"):
        run([one("lattice", divisions=(3, 3, 3))], points)


def test_curl_keeps_volume_and_moves() -> None:
    """Oracle: a flow without divergence has |J| = 1; four steps of a fixed length keep that to 2%
    where it has carried a quarter of a wavelength."""
    positions, gradient = run([one("curl", amount=0.25, size=1.0)], cloud())
    change = np.linalg.norm(positions - cloud(), axis=1)
    det = np.linalg.det(gradient.astype(np.float64))
    assert 0.1 < change.mean() < 0.3 and np.abs(gradient - np.eye(3)).max() > 0.3
    assert np.abs(det - 1).mean() < 0.02


def test_noise_moves_on_and_depends_on_its_seed() -> None:
    """Oracle: definition: a second at one wavelength a second is one wavelength along the axis."""
    points = cloud(50)
    base = run([one("noise", size=0.5, speed=1.0)], points, seconds=0.0)[0] - points
    later = run([one("noise", size=0.5, speed=1.0)], points + np.array([0, 0.5, 0]), seconds=1.0)[0]
    np.testing.assert_allclose(later - points - [0, 0.5, 0], base, atol=1e-5)
    other = run([one("noise", size=0.5, seed=4)], points, seconds=0.0)[0] - points
    assert np.abs(np.corrcoef(base.ravel(), other.ravel())[0, 1]) < 0.3
    assert np.abs(np.corrcoef(base.T) - np.eye(3)).max() < 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_no_weight_keeps_every_bit(kind) -> None:
    """Oracle: what was given, minus zero included: by weight, by mask, and beyond the falloff."""
    points = cloud(100)
    points[:50] *= np.float32(-0.0)
    given = np.random.default_rng(6).normal(size=(100, 3, 3)).astype(np.float32)
    mask = np.zeros(100, np.float32)
    far = np.eye(4)
    far[:3, 3] = 10
    for deformer in (one(kind, weight=0), one(kind, mask=mask), one(kind, frame=far, falloff=3.0)):
        positions, gradient = points.copy(), given.copy()
        deform(open_device(), [deformer], 1.0, positions, gradient)
        assert positions.tobytes() == points.tobytes() and gradient.tobytes() == given.tobytes()


def test_weight_and_mask_blend_positions() -> None:
    """Oracle: x + w (f(x) - x), mask times weight; smoothstep of the distance for the falloff."""
    points = cloud(60)
    whole = run([one("twist")], points)[0]
    mask = np.random.default_rng(7).random(60).astype(np.float32)
    found = run([one("twist", weight=0.5, mask=mask)], points)[0]
    expected = points + 0.5 * mask[:, None] * (whole - points)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    t = np.minimum(np.linalg.norm(points, axis=1, keepdims=True) / 2, 1)
    expected = points + (1 - t * t * (3 - 2 * t)) * (whole - points)
    np.testing.assert_allclose(run([one("twist", falloff=2.0)], points)[0], expected, atol=1e-6)


def test_the_stack_is_one_map_after_the_other() -> None:
    """Oracle: the chain rule, J = J2 J1; the other order is another map."""
    points, first, second = cloud(80), one("bend", frame=FRAME), one("twist")
    between, j1 = run([first], points)
    end, j2 = run([second], between)
    found, gradient = run([first, second], points)
    assert np.array_equal(found, end)
    np.testing.assert_allclose(gradient, j2 @ j1, atol=2e-6)
    assert np.abs(run([second, first], points)[0] - found).max() > 0.1


def test_positions_do_not_depend_on_who_wants_gradients() -> None:
    """Oracle: the same call with gradients, bit for bit."""
    points = cloud(50)
    stack = [one(kind) for kind in KINDS]
    positions = points.copy()
    deform(open_device(), stack, 0.3, positions)
    assert np.array_equal(positions, run(stack, points)[0])


def test_what_cannot_be_is_told() -> None:
    """Oracle: one sentence each."""
    points, flat = cloud(5), np.diag([1.0, 1.0, 0.0, 1.0])
    with pytest.raises(UsageError, match=r"bend.frame: found a singular matrix"):
        run([one("bend", frame=flat)], points)
    with pytest.raises(UsageError, match=r"bend.mask: found 4 values, expected 5"):
        run([one("bend", mask=np.ones(4, np.float32))], points)


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit for bit."""
    points = np.random.default_rng(8).uniform(-1, 2, (5000, 3))
    stack = [dataclasses.replace(one(kind), frame=FRAME) for kind in KINDS if kind != "curl"]
    a, b = (run(stack, points, threads=threads) for threads in (1, None))
    assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
