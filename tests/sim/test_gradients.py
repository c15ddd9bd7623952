"""Gradients measured from neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.device import open_device
from usdsplat.sim.gradients import LocalGradients

K = 12


def nearest(points, k=K):
    """The k nearest others of each point, by brute force."""
    square = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    np.fill_diagonal(square, np.inf)
    return np.argsort(square, axis=1)[:, :k].astype(np.int32)


def measured(rest, now, *, normals=None, neighbours=None, threads=None):
    """F of every point."""
    device = open_device(threads=threads)
    neighbours = nearest(rest) if neighbours is None else neighbours
    out = np.empty((len(rest), 3, 3), np.float32)
    local = LocalGradients.of(device, np.float32(rest), neighbours, normals)
    local.measure(device, np.float32(now), out)
    return out


def rotation(seed):
    """A rotation, float64."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


@pytest.mark.parametrize("seed", range(4))
def test_linear_maps_are_found(seed) -> None:
    """Oracle: the map itself, random and moved along; test 14 of the specification."""
    rng = np.random.default_rng(seed)
    rest = np.float32(rng.random((800, 3)))
    f = rng.normal(size=(3, 3))
    found = measured(rest, rest @ f.T + rng.normal(size=3))
    assert np.abs(found - f).max() < 1e-4 * np.linalg.norm(f)


def test_size_and_place_do_not_matter() -> None:
    """Oracle: the map itself, for a cloud a thousand times smaller, and one far away. There the
    rounding of positions, 4e-6 at 50, is seen against the spacing of 0.1."""
    rng = np.random.default_rng(5)
    rest, f = rng.random((500, 3)), np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    small = np.float32(rest * 1e-3)
    assert np.abs(measured(small, small @ f.T) - f).max() < 1e-4
    far = np.float32(rest + 50)
    assert np.abs(measured(far, far @ f.T) - f).max() < 4e-3


@pytest.mark.parametrize("given", [True, False])
def test_a_sheet_turns_with_its_normal(given) -> None:
    """Oracle: closed form: a flat sheet stretched in its plane and turned has F = R diag(a, b, 1),
    whether normals are given or seen."""
    rng = np.random.default_rng(6)
    flat = np.column_stack([rng.random((400, 2)), np.zeros(400)])
    base, r = rotation(1), rotation(2)
    f = r @ base @ np.diag([1.5, 0.7, 1]) @ base.T
    normals = np.float32(np.tile(base[:, 2], (400, 1))) if given else None
    rest = np.float32(flat @ base.T)
    found = measured(rest, rest @ f.T, normals=normals)
    assert np.abs(found - f).max() < 1e-4


def test_a_curved_sheet_that_is_turned_is_only_turned() -> None:
    """Oracle: closed form: F = R on a sphere whose normals are those of the sphere."""
    normals = np.random.default_rng(7).normal(size=(1500, 3))
    normals = np.float32(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    r = rotation(3)
    found = measured(normals, normals @ r.T, normals=normals)
    assert np.abs(found - r).max() < 2e-3


def test_where_neighbours_say_nothing_it_stays_as_it_was() -> None:
    """Oracle: closed form: the identity for lonely and coincident points; a line that grows by 2
    grows along itself, and not across."""
    line = np.zeros((20, 3), np.float32)
    line[:, 0] = np.linspace(0, 1, 20)
    none = np.full((20, K), -1, np.int32)
    assert np.array_equal(measured(line, line * 2, neighbours=none), np.tile(np.eye(3), (20, 1, 1)))
    found = measured(line, line * 2)
    np.testing.assert_allclose(found[:, 0, 0], 2, atol=0.03)
    np.testing.assert_allclose(found[:, 1:, 1:], np.tile(np.eye(2), (20, 1, 1)), atol=1e-6)
    same = np.ones((20, 3), np.float32)
    assert np.array_equal(measured(same, line), np.tile(np.eye(3), (20, 1, 1)))


def test_what_did_not_move_is_the_identity_to_the_bit() -> None:
    """Oracle: the identity; and rows that nobody asked for keep what they had."""
    rest = np.random.default_rng(8).random((300, 3)).astype(np.float32)
    now = rest.copy()
    now[:10] += np.float32(0.05)
    device, neighbours = open_device(), nearest(rest)
    local = LocalGradients.of(device, rest, neighbours)
    out = np.full((300, 3, 3), 7, np.float32)
    rows = np.ones(300, np.uint8)
    rows[200:] = 0
    local.measure(device, now, out, rows=rows)
    still = np.flatnonzero(~(np.isin(neighbours, np.arange(10)).any(axis=1)))
    still = still[(still >= 10) & (still < 200)]
    assert len(still) > 50
    assert np.array_equal(out[still], np.tile(np.eye(3), (len(still), 1, 1)))
    assert (out[200:] == 7).all() and not (out[:10] == np.eye(3)).all()


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit for bit."""
    rng = np.random.default_rng(9)
    rest = rng.random((3000, 3)).astype(np.float32)
    neighbours = rng.integers(-1, 3000, (3000, K)).astype(np.int32)
    now = rest + np.float32(0.1) * np.sin(rest[:, ::-1])
    one, many = (measured(rest, now, neighbours=neighbours, threads=t) for t in (1, None))
    assert np.array_equal(one, many)
