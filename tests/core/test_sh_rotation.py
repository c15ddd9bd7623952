"""Tests of rotating and mirroring harmonics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.core.strategies import SEEDS, directions, orthogonal
from usdsplat.core import sh, sh_rotation

SIGNS = st.sampled_from([1, -1])
DEGREES = st.integers(0, 4)


def block(bands: list[np.ndarray]) -> np.ndarray:
    """All bands as one matrix."""
    size = sum(len(band) for band in bands)
    out, first = np.zeros((size, size)), 0
    for band in bands:
        out[first : first + len(band), first : first + len(band)] = band
        first += len(band)
    return out


@settings(max_examples=50, deadline=None)
@given(SEEDS, SIGNS, DEGREES)
def test_turned_colour_seen_along_turned_directions_is_the_same(
    seed: int, determinant: int, degree: int
) -> None:
    """Oracle: the definition, at random directions, for rotations and mirrorings."""
    q = orthogonal(seed, determinant)
    d = directions(seed, 20)
    c = np.random.default_rng(seed).normal(size=(20, (degree + 1) ** 2, 3))
    c[:, 0] += 10  # so that the clamp at zero never acts
    turned = sh_rotation.rotate(c, q)
    np.testing.assert_allclose(sh.evaluate(turned, d @ q.T), sh.evaluate(c, d), atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(SEEDS, SIGNS, SIGNS)
def test_bands_are_orthogonal_and_compose_as_the_turns_do(seed: int, a: int, b: int) -> None:
    """Oracle: representation theory: D(PQ) = D(P) D(Q), D(Q^T) = D(Q)^T, D(1) = 1."""
    p, q = orthogonal(seed, a), orthogonal(seed + 1, b)
    dp, dq = (block(sh_rotation.band_matrices(m, 4)) for m in (p, q))
    np.testing.assert_allclose(block(sh_rotation.band_matrices(p @ q, 4)), dp @ dq, atol=1e-12)
    np.testing.assert_allclose(block(sh_rotation.band_matrices(p.T, 4)), dp.T, atol=1e-12)
    np.testing.assert_allclose(dp @ dp.T, np.eye(25), atol=1e-12)
    np.testing.assert_allclose(
        block(sh_rotation.band_matrices(np.eye(3), 4)), np.eye(25), atol=1e-13
    )


@settings(max_examples=20, deadline=None)
@given(SEEDS, SIGNS)
def test_degree_one_turns_like_a_vector(seed: int, determinant: int) -> None:
    """Oracle: degree 1 is C1 (-y, z, -x), so (-c3, -c1, c2) is a gradient and turns by q itself."""
    q = orthogonal(seed, determinant)
    to_vector = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    band = sh_rotation.band_matrices(q, 1)[1]
    np.testing.assert_allclose(band, to_vector.T @ q @ to_vector, atol=1e-13)


def test_a_turn_about_z_mixes_plus_and_minus_m_by_m_times_the_angle() -> None:
    """Oracle: Fourier series: cos(m (p - a)) = cos mp cos ma + sin mp sin ma."""
    a = 0.7
    q = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    for degree, band in enumerate(sh_rotation.band_matrices(q, 4)):
        expected = np.eye(2 * degree + 1)
        for m in range(1, degree + 1):
            rows = [degree - m, degree + m]  # the sine, then the cosine
            c, s = np.cos(m * a), np.sin(m * a)
            expected[np.ix_(rows, rows)] = [[c, s], [-s, c]]
        np.testing.assert_allclose(band, expected, atol=1e-13)


def test_point_reflection_flips_odd_degrees_and_a_mirror_in_z_odd_l_plus_m() -> None:
    """Oracle: the parity of the associated Legendre polynomials."""
    for degree, band in enumerate(sh_rotation.band_matrices(-np.eye(3), 4)):
        np.testing.assert_allclose(band, (-1) ** degree * np.eye(2 * degree + 1), atol=1e-13)
    for degree, band in enumerate(sh_rotation.band_matrices(np.diag([1, 1, -1.0]), 4)):
        parity = [(-1) ** (degree + m) for m in range(-degree, degree + 1)]
        np.testing.assert_allclose(band, np.diag(parity), atol=1e-13)


def read_sh(path: Path) -> np.ndarray:
    """Harmonics of a 3DGS .ply by plyfile, shape (n, 16, 3), channel-major as the format has it."""
    from plyfile import PlyData

    rows = PlyData.read(path)["vertex"]
    dc = np.stack([rows[f"f_dc_{c}"] for c in range(3)], axis=1)[:, None]
    rest = np.stack([rows[f"f_rest_{i}"] for i in range(45)], axis=1).reshape(-1, 3, 15)
    return np.concatenate([dc, rest.transpose(0, 2, 1)], axis=1)


@pytest.mark.parametrize("angles", [(90, 0, 0), (0, 0, 90), (10, 20, 30)])
def test_agrees_with_splat_transform(data: Path, angles: tuple[int, int, int]) -> None:
    """Oracle: files turned by splat-transform 3.7.0, T Rz Ry Rx T with T = diag(-1, -1, 1)."""
    x, y, z = np.radians(angles)
    rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    t = np.diag([-1, -1, 1])
    folder = data / "oracle"
    found = sh_rotation.rotate(read_sh(folder / "tiny.ply"), t @ rz @ ry @ rx @ t)
    expected = read_sh(folder / "rot_{}_{}_{}.ply".format(*angles))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_matrices_that_are_no_turn_and_degrees_that_do_not_exist_are_refused() -> None:
    """Oracle: the documented preconditions."""
    for matrix in (2 * np.eye(3), np.eye(4), np.diag([1, 1, 0]), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="expected rotation or reflection"):
            sh_rotation.band_matrices(matrix, 1)
    with pytest.raises(ValueError, match="expected 0 to 4"):
        sh_rotation.band_matrices(np.eye(3), 5)
