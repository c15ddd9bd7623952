"""Tests of edits of clouds."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.core.strategies import SEEDS, directions, orthogonal, quaternions
from usdsplat.core import covariance, edit, sh
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError


def cloud(seed: int = 0, n: int = 40, degree: int = 3, moving: bool = True) -> SplatCloud:
    """A random cloud with every field."""
    rng = np.random.default_rng(seed)
    return SplatCloud(
        positions=rng.normal(size=(n, 3)).astype(np.float32),
        scales=np.exp(rng.normal(-2, 1, (n, 3))).astype(np.float32),
        rotations=quaternions(seed, n).astype(np.float32),
        opacities=rng.random(n).astype(np.float32),
        sh=rng.normal(size=(n, (degree + 1) ** 2, 3)).astype(np.float32),
        ids=rng.permutation(n) if moving else None,
        velocities=rng.normal(size=(n, 3)).astype(np.float32) if moving else None,
    )


def affine(linear: np.ndarray, offset: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    """Column-vector 4x4."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = linear, offset
    return out


def world(c: SplatCloud) -> np.ndarray:
    """Covariances in float64."""
    return covariance.from_scale_rotation(c.scales.astype(float), c.rotations.astype(float))


def assert_same(a: SplatCloud, b: SplatCloud) -> None:
    """Every array equal, bit for bit."""
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert (x is None) == (y is None), field.name
        if x is not None:
            np.testing.assert_array_equal(x, y, err_msg=field.name)


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.booleans())
def test_a_general_map_carries_covariances_exactly(seed: int, is_similar: bool) -> None:
    """Oracle: A S A^T in float64, centres and velocities by matrix product."""
    rng = np.random.default_rng(seed)
    sign = rng.choice([1, -1])
    linear = 3 * orthogonal(seed, sign) if is_similar else rng.normal(size=(3, 3))
    before = cloud(seed)
    after = edit.transform(before, affine(linear, (1, 2, 3)))
    expected = linear @ world(before) @ linear.T
    size = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert (np.abs(world(after) - expected) <= 2e-6 * size).all()
    np.testing.assert_allclose(after.positions, before.positions @ linear.T + [1, 2, 3], atol=1e-5)
    np.testing.assert_allclose(after.velocities, before.velocities @ linear.T, atol=1e-5)
    np.testing.assert_array_equal(after.ids, before.ids)
    np.testing.assert_array_equal(after.opacities, before.opacities)
    np.testing.assert_allclose(np.linalg.norm(after.rotations, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("determinant", [1, -1])
@pytest.mark.parametrize("stretch", [1.0, 0.25])
def test_colour_turns_with_similar_maps(determinant: int, stretch: float) -> None:
    """Oracle: the same colour is seen along the turned direction; a mirror image mirrors it."""
    q = orthogonal(11, determinant)
    before = cloud(3)
    after = edit.transform(before, affine(stretch * q))
    d = directions(5, len(before)).astype(np.float32)
    np.testing.assert_allclose(
        sh.evaluate(after.sh, (d @ q.T).astype(np.float32)), sh.evaluate(before.sh, d), atol=2e-5
    )


def test_colour_turns_by_the_orthogonal_factor_of_a_shear() -> None:
    """Oracle: A = Q P with P symmetric positive definite, built from both factors."""
    q = orthogonal(21, -1)
    root = orthogonal(22)
    stretch = root @ np.diag([0.5, 1.0, 4.0]) @ root.T
    before = cloud(4)
    after = edit.transform(before, affine(q @ stretch))
    alone = edit.transform(before, affine(q))
    np.testing.assert_allclose(after.sh, alone.sh, atol=1e-5)


def test_similar_maps_keep_the_order_of_axes_and_scales() -> None:
    """Oracle: uniform scale multiplies every scale; nothing is factored anew."""
    before = cloud(5)
    after = edit.transform(before, affine(-2.0 * orthogonal(6)))
    np.testing.assert_allclose(after.scales, 2 * before.scales, rtol=1e-6)


def test_the_identity_changes_nothing_and_maps_undo_each_other() -> None:
    """Oracle: the cloud itself; the rotated quaternion up to sign."""
    before = cloud(6)
    same = edit.transform(before, np.eye(4))
    for name in ("positions", "scales", "rotations", "sh", "velocities"):
        np.testing.assert_allclose(getattr(same, name), getattr(before, name), atol=1e-6)
    matrix = affine(0.5 * orthogonal(7, -1), (4, 5, 6))
    back = edit.transform(edit.transform(before, matrix), np.linalg.inv(matrix))
    for name in ("positions", "scales", "sh", "velocities"):
        np.testing.assert_allclose(getattr(back, name), getattr(before, name), atol=5e-6)
    dots = np.sum(back.rotations * before.rotations, axis=1)
    np.testing.assert_allclose(np.abs(dots), 1, atol=1e-6)


def test_more_splats_than_one_chunk_are_all_carried() -> None:
    """Oracle: the same splats taken alone give the same rows."""
    before = cloud(8, n=20_000, degree=0, moving=False)
    matrix = affine(np.diag([1, 2, 3]))
    whole = edit.transform(before, matrix)
    rows = np.array([0, 8191, 8192, 19_999])
    assert_same(edit.take(whole, rows), edit.transform(edit.take(before, rows), matrix))


def test_a_flattening_map_gives_flat_splats() -> None:
    """Oracle: projection on z = 0 leaves no extent along z."""
    after = edit.transform(cloud(9), affine(np.diag([1, 1, 0])))
    assert np.abs(after.positions[:, 2]).max() == 0
    assert np.abs(world(after)[:, 2, 2]).max() < 1e-12


@pytest.mark.parametrize("angles", ["0_0_90", "90_0_0", "10_20_30"])
def test_turned_capture_agrees_with_splat_transform(data: Path, angles: str) -> None:
    """Oracle: .ply files turned by splat-transform 3.7.0; see data/README.md for its matrix."""
    from plyfile import PlyData

    def read(name: str) -> SplatCloud:
        rows = PlyData.read(data / "oracle" / name)["vertex"]
        raw = {k: np.stack([rows[f"{k}_{i}"] for i in range(m)], 1) for k, m in
               (("scale", 3), ("rot", 4), ("f_dc", 3))}  # fmt: skip
        return SplatCloud(
            positions=np.stack([rows[k] for k in "xyz"], axis=1),
            scales=np.exp(raw["scale"]),
            rotations=raw["rot"] / np.linalg.norm(raw["rot"], axis=1, keepdims=True),
            opacities=np.zeros(len(rows), np.float32),
            sh=raw["f_dc"][:, None],
        )

    x, y, z = np.radians([float(a) for a in angles.split("_")])
    rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    t = np.diag([-1, -1, 1])
    found = edit.transform(read("tiny.ply"), affine(t @ rz @ ry @ rx @ t))
    expected = read(f"rot_{angles}.ply")
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-5)
    np.testing.assert_allclose(world(found), world(expected), rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize(
    "matrix", [np.eye(3), np.full((4, 4), np.nan), np.diag([1, 1, 1, 2]), np.ones((4, 4))]
)
def test_matrices_that_are_not_affine_are_refused(matrix: np.ndarray) -> None:
    """Oracle: the documented precondition."""
    with pytest.raises(UsageError, match="expected a finite affine 4x4"):
        edit.transform(cloud(), matrix)


def test_take_keeps_rows_together_by_mask_and_by_index() -> None:
    """Oracle: NumPy indexing of each array."""
    c = cloud(1)
    assert_same(edit.take(c, np.arange(40) < 3), edit.take(c, np.array([0, 1, 2])))
    swapped = edit.take(c, np.array([5, 2]))
    np.testing.assert_array_equal(swapped.ids, c.ids[[5, 2]])
    np.testing.assert_array_equal(swapped.sh, c.sh[[5, 2]])
    assert len(edit.take(c, np.zeros(40, bool))) == 0
    assert_same(edit.take(c, slice(None, None, 20)), edit.take(c, np.array([0, 20])))


def test_crops_keep_centres_inside_edges_included() -> None:
    """Oracle: points on, in and outside a unit box and a sphere of radius 5."""
    c = edit.take(cloud(2, moving=False), np.arange(4))
    c = replace(c, positions=np.float32([[0, 0, 0], [1, 1, 1], [3, 4, 0], [3, 4, 0.1]]))
    np.testing.assert_array_equal(edit.crop_box(c, (0, 0, 0), (1, 1, 1)).positions, c.positions[:2])
    np.testing.assert_array_equal(edit.crop_sphere(c, (0, 0, 0), 5).positions, c.positions[:3])


def test_prune_drops_what_is_not_finite_and_what_the_limits_name() -> None:
    """Oracle: one bad row of each kind among good ones."""
    c = cloud(3, n=12)
    good = replace(c, opacities=np.full(12, 0.5, np.float32), scales=np.ones((12, 3), np.float32))
    bad = pickle.loads(pickle.dumps(good))
    names = ("positions", "scales", "rotations", "opacities", "sh", "velocities")
    for row, name in enumerate(names):
        getattr(bad, name)[row] = np.nan
    bad.positions[6, 1] = np.inf
    bad.opacities[7] = 0.001
    bad.scales[8, 2] = 100
    assert_same(edit.prune(good), good)
    np.testing.assert_array_equal(edit.prune(bad).ids, good.ids[7:])
    limited = edit.prune(bad, min_opacity=1 / 255, max_scale=10)
    np.testing.assert_array_equal(limited.ids, good.ids[9:])


def test_merge_joins_in_order_and_pads_with_zeros() -> None:
    """Oracle: the parts, cut out again."""
    a, b = cloud(1, n=3, degree=1), cloud(2, n=2, degree=3, moving=False)
    whole = edit.merge([a, b])
    assert (len(whole), whole.sh_degree) == (5, 3)
    np.testing.assert_array_equal(whole.positions, np.concatenate([a.positions, b.positions]))
    np.testing.assert_array_equal(whole.sh[:3, :4], a.sh)
    assert not whole.sh[:3, 4:].any()
    np.testing.assert_array_equal(whole.velocities[:3], a.velocities)
    assert not whole.velocities[3:].any()
    assert whole.ids is None


def test_merged_ids_survive_only_when_each_means_one_splat() -> None:
    """Oracle: the ids of both parts, disjoint or not."""
    a = cloud(1, n=3)
    b = replace(a, ids=a.ids + 3)
    assert edit.merge([a, b]).ids.tolist() == [*a.ids, *b.ids]
    assert edit.merge([a, a]).ids is None
    assert edit.merge([replace(a, velocities=None)]).velocities is None


def test_merging_nothing_is_refused() -> None:
    """Oracle: there is no degree for an empty list."""
    with pytest.raises(UsageError, match="expected at least one"):
        edit.merge([])


def test_degrees_are_cut_and_padded() -> None:
    """Oracle: the first coefficients stay, the rest are zero."""
    c = cloud(1, degree=2)
    np.testing.assert_array_equal(edit.with_sh_degree(c, 1).sh, c.sh[:, :4])
    assert edit.with_sh_degree(c, 1).sh.flags.c_contiguous
    wide = edit.with_sh_degree(c, 4)
    assert wide.sh.shape == (40, 25, 3) and not wide.sh[:, 9:].any()
    np.testing.assert_array_equal(wide.sh[:, :9], c.sh)
    for degree in (-1, 5):
        with pytest.raises(UsageError, match="expected 0 to 4"):
            edit.with_sh_degree(c, degree)


def test_what_only_moves_or_grows_keeps_its_harmonics_bit_for_bit() -> None:
    """Oracle: the arrays before; a mere move keeps shapes bit for bit too."""
    before = cloud(n=9, degree=3)
    grown = edit.transform(before, np.diag([2.5, 2.5, 2.5, 1]))
    np.testing.assert_array_equal(grown.sh, before.sh)
    move = np.eye(4)
    move[:3, 3] = 1, 2, 3
    moved = edit.transform(before, move)
    for name in ("sh", "scales", "rotations", "opacities"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(before, name))
