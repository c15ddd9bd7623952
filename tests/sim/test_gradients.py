"""Tests of gradients measured from neighbours."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.sim.gradients import LocalGradients

K = 12


def nearest(points, k=K):
    """The k nearest others of each point, by brute force."""
    square = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    np.fill_diagonal(square, np.inf)
    return np.argsort(square, axis=1)[:, :k].astype(np.int32)


def measured(rest, now, *, normals=None, neighbours=None, threads=None, sizes=None):
    """F of every point."""
    device = open_device(threads=threads)
    neighbours = nearest(rest) if neighbours is None else neighbours
    out = np.empty((len(rest), 3, 3), np.float32)
    local = LocalGradients.of(device, np.float32(rest), neighbours, normals)
    local.measure(device, np.float32(now), out, sizes=sizes)
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


def test_torn_neighbourhoods_do_not_stretch() -> None:
    """Oracle: closed form: two halves of a cloud that move apart do not deform at all. Without
    trust in how well F explains the neighbours, splats at the tear were stretched by `raw`."""
    rest = np.random.default_rng(10).random((1500, 3)).astype(np.float32)
    neighbours = nearest(rest)
    right = rest[:, 0] > 0.5
    at_tear = (right[neighbours] != right[:, None]).any(axis=1)
    now = rest + np.float32([[1.0, 0, 0]]) * right[:, None]
    found = measured(rest, now, neighbours=neighbours)
    x = rest[neighbours].astype(float) - rest[:, None]
    d = (now[neighbours] - now[:, None]).astype(float)
    raw = np.stack([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(x, d, strict=True)])
    assert at_tear.sum() > 200
    assert np.median(np.linalg.norm(raw[at_tear], 2, axis=(1, 2))) > 3
    size = np.linalg.norm(found[at_tear] - np.eye(3), 2, axis=(1, 2))
    assert np.quantile(size, 0.9) < 1e-3 and size.max() < 1
    assert np.abs(found[~at_tear] - np.eye(3)).max() < 1e-5


def test_a_tear_opens_smoothly() -> None:
    """Oracle: continuity: the largest change of F between two steps of a tear that opens halves as
    steps do."""
    rest = np.random.default_rng(11).random((600, 3)).astype(np.float32)
    neighbours, right = nearest(rest), rest[:, :1] > 0.5

    def largest(steps):
        way = np.linspace(0, 0.3, steps + 1)
        every = [
            measured(rest, rest + np.float32([[t, t / 2, 0]]) * right, neighbours=neighbours)
            for t in way
        ]
        return max(np.abs(b - a).max() for a, b in itertools.pairwise(every))

    coarse, fine = largest(60), largest(120)
    assert 0.01 < fine < 0.65 * coarse


def test_a_splat_larger_than_its_neighbourhood_follows_in_part() -> None:
    """Oracle: closed form: by the part c that its neighbourhood is of it, a stretch U becomes
    I + c (U - I), and a turn by a small angle one by c times that angle."""
    rest = np.random.default_rng(12).random((400, 3)).astype(np.float32)
    neighbours = nearest(rest)
    reach = np.linalg.norm(rest[neighbours] - rest[:, None], axis=2).max(axis=1)
    stretch = np.diag([1.8, 1.0, 0.7])
    sizes = np.float32(reach * np.repeat([0.5, 1.0, 2.0, 4.0], 100))
    part = np.minimum(reach / sizes, 1)[:, None, None]
    found = measured(rest, rest @ stretch, neighbours=neighbours, sizes=sizes)
    np.testing.assert_allclose(found, np.eye(3) + part * (stretch - np.eye(3)), atol=1e-4)
    angle = 0.1
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    found = measured(rest, rest @ turn.T, neighbours=neighbours, sizes=sizes)
    np.testing.assert_allclose(
        np.arctan2(found[:, 1, 0], found[:, 0, 0]), part[:, 0, 0] * angle, atol=1e-4
    )


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
