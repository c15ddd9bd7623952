"""Tests of distances from solids and their gradients."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.jit import serial
from usdsplat.kernels.sim.blend_solids import join
from usdsplat.kernels.sim.solids import (
    BOX,
    FIELD_COLUMNS,
    MESH,
    PLANE,
    ROUND,
    round_distance,
    solid,
)
from usdsplat.kernels.sim.sweep import capsule_hit


@serial
def measure(kind, sizes, fields, voxels, points, out):
    """`solid` from Python."""
    a, b, c, d = sizes
    for i in range(points.shape[0]):
        x, y, z = points[i]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = solid(
            kind, x, y, z, a, b, c, d, fields, 0, voxels
        )


@serial
def measure_single(sizes, points, out):
    """`round_distance` in float32."""
    a, b, c, d = sizes
    for i in range(points.shape[0]):
        out[i] = round_distance(points[i, 0], points[i, 1], points[i, 2], a, b, c, d)


@serial
def join_all(d, e, blend, out):
    """`join` from Python."""
    for i in range(d.shape[0]):
        out[i] = join(d[i], e[i], blend)[1]


@serial
def hit(p, q, half, radius):
    """`capsule_hit` from Python."""
    return capsule_hit(p[0], p[1], p[2], q[0], q[1], q[2], half, radius)


def solids(kind, sizes, points, fields=None, voxels=None):
    """(distances, gradients) in float64."""
    fields = np.zeros((1, FIELD_COLUMNS)) if fields is None else fields
    voxels = np.zeros(1, np.float32) if voxels is None else voxels
    out = np.empty((len(points), 4))
    measure(kind, sizes, fields, voxels, points, out)
    return out[:, 0], out[:, 1:]


def differences(kind, sizes, points, fields=None, voxels=None, h=1e-6):
    """Gradients by central differences."""
    columns = []
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = h
        above = solids(kind, sizes, points + step, fields, voxels)[0]
        below = solids(kind, sizes, points - step, fields, voxels)[0]
        columns.append((above - below) / (2 * h))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(("first", "second"), [(0.4, 0.4), (0.6, 0.2), (0.1, 0.5)])
def test_round_cones(first: float, second: float) -> None:
    """Oracle: the least distance from 20,001 balls between the ends', in float64: above the true
    one by less than their spacing squared; gradients by central differences."""
    half = 0.7
    grow = (first - second) / (2 * half)
    sizes = (0.5 * (first + second), grow, half, grow / np.sqrt(1 - grow * grow))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (500, 3))
    found, gradients = solids(ROUND, sizes, points)
    s = np.linspace(-half, half, 20_001)
    across = np.hypot(points[:, 0], points[:, 1])[:, None]
    balls = np.hypot(across, points[:, 2:] - s) - (first + (second - first) * (s + half) / 2 / half)
    assert np.abs(found - balls.min(axis=1)).max() < 1e-6
    assert np.linalg.norm(gradients, axis=1) == pytest.approx(np.ones(500), abs=1e-12)
    assert np.abs(gradients - differences(ROUND, sizes, points)).max() < 1e-6
    single = np.empty(500, np.float32)
    measure_single(np.float32(sizes), points.astype(np.float32), single)
    assert np.abs(single - found).max() < 1e-6


def test_boxes() -> None:
    """Oracle: float64 NumPy, outside by the closest point and inside by the nearest face; gradients
    by central differences away from where two faces are equally near."""
    half = np.array([0.5, 0.8, 0.3])
    points = np.random.default_rng(1).uniform(-1.2, 1.2, (4000, 3))
    found, gradients = solids(BOX, (*half, 0.0), points)
    closest = np.clip(points, -half, half)
    inside = (np.abs(points) < half).all(axis=1)
    exact = np.linalg.norm(points - closest, axis=1)
    exact[inside] = -(half - np.abs(points[inside])).min(axis=1)
    assert inside.sum() > 100
    assert np.abs(found - exact).max() < 1e-12
    sorted_gaps = np.sort(half - np.abs(points), axis=1)
    clear = ~inside | (sorted_gaps[:, 1] - sorted_gaps[:, 0] > 1e-4)
    error = np.abs(gradients - differences(BOX, (*half, 0.0), points)).max(axis=1)
    assert np.quantile(error[clear], 0.999) < 1e-5


def test_planes() -> None:
    """Oracle: the height."""
    points = np.random.default_rng(2).normal(size=(10, 3))
    found, gradients = solids(PLANE, (0.0, 0.0, 0.0, 0.0), points)
    assert (found == points[:, 2]).all()
    assert (gradients == [0, 0, 1]).all()


SIZE, LOW = 0.25, np.array([-0.5, 0.1, 0.2])
HIGH = LOW + SIZE * np.array([4, 5, 6])


def field_of(value):
    """Header and voxels of a field between LOW and HIGH."""
    z, y, x = np.indices((7, 6, 5))
    grid = LOW + SIZE * np.stack((x, y, z), axis=-1).reshape(-1, 3)
    voxels = np.concatenate([np.zeros(3), value(grid)]).astype(np.float32)
    return np.array([[*LOW, SIZE, 5, 6, 7, 3]]), voxels


def test_fields() -> None:
    """Oracle: a trilinear function, which interpolation repeats exactly; gradients by central
    differences."""

    def value(p):
        x, y, z = p.T
        return 0.3 + x - 2 * y + 0.5 * z + x * y - y * z + 0.7 * x * y * z

    field = field_of(value)
    points = np.random.default_rng(3).uniform(LOW, HIGH, (2000, 3))
    found, gradients = solids(MESH, (0.0,) * 4, points, *field)
    assert np.abs(found - value(points)).max() < 1e-6
    error = np.abs(gradients - differences(MESH, (0.0,) * 4, points, *field))
    assert np.quantile(error, 0.99) < 1e-6
    nan = solids(MESH, (0.0,) * 4, np.full((1, 3), np.nan), *field)[0]
    assert len(nan) == 1  # read from within the field, whatever it says


def test_outside_of_fields() -> None:
    """Oracle: closed form for the field of a plane, whose closest points are known: a point outside
    is as far as the one that is closest to the box's nearest point."""
    normal = np.array([2.0, -1.0, 2.0]) / 3
    field = field_of(lambda p: p @ normal + 2.0)
    points = np.random.default_rng(3).uniform(LOW - 1, HIGH + 1, (2000, 3))
    nearest = np.clip(points, LOW, HIGH)
    feet = nearest - (nearest @ normal + 2.0)[:, None] * normal
    found, gradients = solids(MESH, (0.0,) * 4, points, *field)
    assert np.abs(found - np.linalg.norm(points - feet, axis=1)).max() < 1e-5
    outside = (nearest != points).any(axis=1)
    directions = (points - feet)[outside] / found[outside, None]
    assert np.abs(gradients[outside] - directions).max() < 1e-5


def test_joining() -> None:
    """Oracle: Quilez's other form, min(a, b) - h² k / 4 with h = max(k - |a - b|, 0) / k."""
    rng = np.random.default_rng(4)
    d, e = rng.normal(size=(2, 1000))
    for blend in (0.0, 0.1, 2.0):
        out = np.empty(1000)
        join_all(d, e, blend, out)
        h = np.maximum(blend - np.abs(d - e), 0) / blend if blend else 0.0
        assert np.abs(out - (np.minimum(d, e) - h * h * blend / 4)).max() < 1e-12
        assert (out <= np.minimum(d, e) + 1e-15).all()


def test_where_a_segment_hits_a_capsule() -> None:
    """Oracle: the first of 20,001 points of it that is inside, by the distance."""
    rng = np.random.default_rng(5)
    half, radius = 0.6, 0.3
    part = np.linspace(0, 1, 20_001)
    hits = 0
    for _ in range(300):
        p, way = rng.uniform(-1.5, 1.5, 3), rng.normal(size=3)
        way = way * 0.3 - 1.5 * p
        path = p + part[:, None] * way
        gap = solids(ROUND, (radius, 0.0, half, 0.0), path)[0] - 0.0
        if gap[0] < 0:
            continue
        found = hit(p, way, half, radius)
        inside = np.flatnonzero(gap < 0)
        if len(inside):
            hits += 1
            assert found == pytest.approx(part[inside[0]], abs=1e-4)
        else:
            assert found > 1 or np.abs(gap.min()) < 1e-4
    assert hits > 40
