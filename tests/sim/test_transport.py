"""Tests of ellipsoids and harmonics under a deformation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usdsplat.core import sh as harmonics
from usdsplat.core import sh_rotation
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import AppearanceParameters
from usdsplat.sim.transport import rotate_harmonics, thin, transport

PLAIN = AppearanceParameters()
IDENTITY = np.eye(3, dtype=np.float32)


def axes_of(q):
    """Rotation matrices of quaternions, float64; the columns are axes."""
    w, x, y, z = np.asarray(q, np.float64).T / np.linalg.norm(q.astype(np.float64), axis=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def half(q, s):
    """R diag(s), of which the covariance is the product with its own transpose, float64."""
    return axes_of(q) * s.astype(np.float64)[:, None, :]


def splats(n=2000, *, anisotropy=1e4, seed=1):
    """Unit quaternions and scales whose ratio reaches `anisotropy`."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    s = 0.01 * anisotropy ** -rng.random((n, 3))
    s[np.arange(n), rng.integers(0, 3, n)] = 0.01
    return np.float32(q / np.linalg.norm(q, axis=1, keepdims=True)), np.float32(s)


def gradients(n=2000, *, most=3.0, seed=2):
    """R diag(stretches) Q with stretches from 1 / most to most, no mirrors."""
    rng = np.random.default_rng(seed)
    u, v = (axes_of(rng.normal(size=(n, 4))) for _ in range(2))
    sizes = most ** rng.uniform(-0.99, 0.99, (n, 3))
    return np.float32((u * sizes[:, None, :]) @ v)


def carry(f, q, s, *, before=None, **options):
    """(rotations, scales, areas) of a transport."""
    rotations, scales = (q if before is None else before).copy(), np.empty_like(s)
    appearance = AppearanceParameters(**options)
    areas = transport(open_device(), f, q, s, rotations, scales, appearance)
    return rotations, scales, areas


@pytest.mark.parametrize("most", [1.2, 3.0])
def test_covariance_is_carried_along(most) -> None:
    """Oracle: F Sigma F^T and its singular values in float64; test 15 of the specification."""
    (q, s), f = splats(), gradients(most=most)
    rotations, scales, _ = carry(f, q, s)
    expected = f.astype(np.float64) @ half(q, s)
    found = half(rotations, scales)
    expected_sigma, sigma = (a @ a.transpose(0, 2, 1) for a in (expected, found))
    size = np.linalg.norm(expected_sigma, axis=(1, 2))
    assert (np.linalg.norm(sigma - expected_sigma, axis=(1, 2)) / size).max() < 1e-5
    sizes = np.linalg.svd(expected, compute_uv=False)
    np.testing.assert_allclose(scales.min(axis=1), sizes[:, 2], rtol=1e-4)
    np.testing.assert_allclose(scales.max(axis=1), sizes[:, 0], rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1, atol=3e-7)


def test_no_stretch_leaves_the_limits() -> None:
    """Oracle: NumPy's singular values of F, clamped; a round splat of size 1 shows them."""
    n = 500
    q, s = splats(n)
    s[:] = 1
    f = gradients(n, most=20.0)
    _, scales, _ = carry(f, q, s, max_stretch=2.0)
    sizes = np.clip(np.linalg.svd(f.astype(np.float64), compute_uv=False), 0.5, 2.0)
    np.testing.assert_allclose(np.sort(scales, axis=1)[:, ::-1], sizes, rtol=1e-5)


def test_a_mirror_only_turns() -> None:
    """Oracle: closed form: the nearest rotation to diag(1.5, 1.2, -1.1) is the identity; and to
    nothing, none is asked for."""
    q, s = splats(2)
    f = np.float32([np.diag([1.5, 1.2, -1.1]), np.diag([1.0, 1.0, 0.0])])
    rotations, scales, _ = carry(f, q, s)
    np.testing.assert_allclose(rotations, q, atol=1e-6)
    np.testing.assert_allclose(scales, s, rtol=1e-5)


def test_not_a_number_is_at_rest() -> None:
    """Oracle: what was given, bit for bit."""
    q, s = splats(2)
    f = np.full((2, 3, 3), np.nan, np.float32)
    f[1] = np.inf
    rotations, scales, _ = carry(f, q, s)
    assert np.array_equal(rotations, q) and np.array_equal(scales, s)


def test_rigid_splats_keep_their_size_and_turn_with_the_polar_rotation() -> None:
    """Oracle: R of F = R U by NumPy's singular value decomposition in float64."""
    (q, s), f = splats(), gradients()
    rotations, scales, _ = carry(f, q, s, covariance="rigid")
    u, _, v = np.linalg.svd(f.astype(np.float64))
    assert np.array_equal(scales, s)
    np.testing.assert_allclose(axes_of(rotations), u @ v @ axes_of(q), atol=3e-6)


def test_volume_is_kept_if_asked() -> None:
    """Oracle: closed form: the product of the axes."""
    (q, s), f = splats(anisotropy=100), gradients()
    _, scales, _ = carry(f, q, s, covariance="volume")
    volume = s.astype(np.float64).prod(axis=1)
    np.testing.assert_allclose(scales.astype(np.float64).prod(axis=1), volume, rtol=1e-5)


def test_what_is_not_touched_keeps_its_bits() -> None:
    """Oracle: what was given; quaternions here are not of unit length, so any work would show."""
    q, s = splats(3000)
    q *= np.float32(1.01)
    f = np.tile(IDENTITY, (3000, 1, 1))
    f[::7] = gradients(3000)[::7]
    rotations, scales, _ = carry(f, q, s)
    still = np.arange(3000) % 7 != 0
    assert np.array_equal(rotations[still], q[still]) and np.array_equal(scales[still], s[still])
    assert not np.isclose(scales[~still], s[~still], rtol=1e-3).all(axis=1).any()


def test_orientation_has_no_jumps() -> None:
    """Oracle: two whole turns and a squeeze in small steps; q moves by half the angle of a step at
    most, plus what the squeeze turns the axes by, whose lengths stay apart. After one turn q is
    -q."""
    q, s = splats(200)
    s[:] = np.random.default_rng(3).permuted(np.tile(np.float32([1, 0.5, 0.2]), (200, 1)), axis=1)
    rotations, scales = q.copy(), np.empty_like(s)
    steps = 240
    for k in range(steps + 1):
        a = 4 * math.pi * k / steps
        turn = [[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]]
        f = np.float32(turn @ np.diag([1, 1 + 0.2 * math.sin(a / 2), 1]))
        before = rotations.copy()
        transport(open_device(), np.tile(f, (200, 1, 1)), q, s, rotations, scales, PLAIN)
        dots = (before * rotations).sum(axis=1)
        assert dots.min() > 0.99
        if k == steps // 2:
            np.testing.assert_allclose(rotations, -q, atol=1e-4)
    np.testing.assert_allclose(rotations, q, atol=1e-4)


def test_faces_and_opacity() -> None:
    """Oracle: closed form: a disc across z stretched along x and z by 2 and 0.5 has twice the
    area, and two layers of the new opacity cover as one of the old did."""
    q = np.float32([[1, 0, 0, 0], [1, 0, 0, 0]])
    s = np.float32([[0.3, 0.2, 0.01]] * 2)
    f = np.stack([np.diag([2, 1, 0.5]), np.eye(3)]).astype(np.float32)
    _, _, areas = carry(f, q, s, keep_opacity=True)
    assert areas is not None
    np.testing.assert_allclose(areas, [2, 1], rtol=1e-6)
    opacities, out = np.float32([0.75, 0.75]), np.empty(2, np.float32)
    thin(open_device(), opacities, areas, out)
    np.testing.assert_allclose(out, [0.5, 0.75], rtol=1e-6)
    assert carry(f, q, s)[2] is None


def test_needles_and_nothing_at_all_stay_finite() -> None:
    """Oracle: closed form: what has no extent gets none, whatever the deformation."""
    q, _ = splats(3)
    s = np.float32([[1, 0, 0], [0, 0, 0], [1e-3, 1e-12, 1e-3]])
    rotations, scales, _ = carry(gradients(3), q, s)
    assert np.isfinite(rotations).all() and np.isfinite(scales).all()
    assert np.array_equal(scales == 0, s == 0)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_colour_turns_with_the_splat(degree) -> None:
    """Oracle: the colour seen from R d after is that from d before, in 50 directions, for F = R U;
    and `core.sh_rotation`, which shares no formula; test 16 of the specification."""
    rng = np.random.default_rng(degree)
    n = 40
    sh = np.float32(rng.normal(size=(n, (degree + 1) ** 2, 3)) / (degree + 1))
    f = gradients(n, most=1.5)
    turned, count = rotate_harmonics(open_device(), f, sh, sh, np.zeros(n, np.uint8))
    u, _, v = np.linalg.svd(f.astype(np.float64))
    d = rng.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    assert count == n and turned is not sh
    for i in range(n):
        before = harmonics.basis(d, degree) @ sh[i]
        after = harmonics.basis(d @ (u[i] @ v[i]).T, degree) @ turned[i]
        np.testing.assert_allclose(after, before, atol=1e-5)
        expected = sh_rotation.rotate(sh[i : i + 1].astype(np.float64), u[i] @ v[i])[0]
        np.testing.assert_allclose(turned[i], expected, atol=5e-6)


def about_z(degrees):
    """Rotation about z, float32."""
    a = np.radians(degrees)
    return np.float32([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def test_small_turns_are_left_out_and_taken_back() -> None:
    """Oracle: the values at rest, bit for bit, below the angle and after the way back."""
    sh = np.float32(np.random.default_rng(5).normal(size=(3, 16, 3)))
    flags = np.zeros(3, np.uint8)
    f = np.stack([about_z(0.9), about_z(1.1), IDENTITY])
    out, count = rotate_harmonics(open_device(), f, sh, sh, flags)
    assert count == 1 and flags.tolist() == [0, 1, 0]
    assert np.array_equal(out[[0, 2]], sh[[0, 2]]) and not np.array_equal(out[1], sh[1])
    back, count = rotate_harmonics(open_device(), f[[0, 0, 2]], sh, out, flags)
    assert count == 0 and np.array_equal(back, sh) and not flags.any()


def test_nothing_is_copied_while_nothing_turns() -> None:
    """Oracle: identity of arrays; colour of degree 0 never turns."""
    sh, flags = np.ones((2, 4, 3), np.float32), np.zeros(2, np.uint8)
    still = np.tile(IDENTITY, (2, 1, 1))
    assert rotate_harmonics(open_device(), still, sh, sh, flags) == (sh, 0)
    plain = sh[:, :1].copy()
    turning = np.stack([about_z(90)] * 2)
    assert rotate_harmonics(open_device(), turning, plain, plain, flags)[0] is plain


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit for bit."""
    (q, s), f = splats(5000), gradients(5000)
    f[::3] = IDENTITY
    sh = np.float32(np.random.default_rng(6).normal(size=(5000, 16, 3)))
    results = []
    for threads in (1, None):
        device = open_device(threads=threads)
        rotations, scales, flags = q.copy(), np.empty_like(s), np.zeros(5000, np.uint8)
        areas = transport(
            device, f, q, s, rotations, scales, AppearanceParameters(keep_opacity=True)
        )
        results.append((rotations, scales, areas, *rotate_harmonics(device, f, sh, sh, flags)))
    for one, all_of_them in zip(*results, strict=True):
        assert np.array_equal(one, all_of_them)
