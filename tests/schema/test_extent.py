"""Tests of the authored extent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.extent import REACH
from usdsplat.schema.extent import compute_extent


def surface(source: SplatCloud, count: int = 400) -> np.ndarray:
    """Points on the ellipsoids of REACH standard deviations, turned by Gf, shape (m, 3)."""
    rng = np.random.default_rng(5)
    unit = rng.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    points = []
    for centre, scale, (w, x, y, z) in zip(
        source.positions.astype(float), source.scales.astype(float), source.rotations, strict=True
    ):
        turn = Gf.Matrix3d(Gf.Quatd(float(w), float(x), float(y), float(z)).GetNormalized())
        points.append(unit * scale * REACH @ np.array(turn) + centre)
    return np.concatenate(points)


def test_reach_is_where_an_opaque_splat_falls_below_one_255th() -> None:
    """Oracle: the Gaussian itself."""
    assert math.exp(-(REACH**2) / 2) == pytest.approx(1 / 255)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_box_holds_every_ellipsoid_and_little_more(seed: int) -> None:
    """Oracle: points on the ellipsoids, rotated by Gf and not by us."""
    source = cloud(seed, n=12)
    low, high = compute_extent(source)
    points = surface(source)
    assert (points >= low).all()
    assert (points <= high).all()
    slack = 0.05 * (high - low)  # as far as random points miss the tips
    assert (points.min(axis=0) <= low + slack).all()
    assert (points.max(axis=0) >= high - slack).all()


def test_an_axis_aligned_splat_reaches_its_scales() -> None:
    """Oracle: centre +- REACH times the scale of that axis."""
    source = replace(
        cloud(n=1), scales=np.float32([[1, 2, 3]]), rotations=np.float32([[1, 0, 0, 0]])
    )
    low, high = compute_extent(source)
    reach = REACH * np.array([1, 2, 3])
    np.testing.assert_allclose(low, source.positions[0] - reach, rtol=1e-4)
    np.testing.assert_allclose(high, source.positions[0] + reach, rtol=1e-4)


def test_a_quarter_turn_swaps_the_axes() -> None:
    """Oracle: a rotation of 90 degrees about z takes x to y."""
    root = math.sqrt(0.5)
    source = replace(
        cloud(n=1),
        positions=np.zeros((1, 3), np.float32),
        scales=np.float32([[1, 2, 3]]),
        rotations=np.float32([[root, 0, 0, root]]),
    )
    np.testing.assert_allclose(compute_extent(source)[1], REACH * np.array([2, 1, 3]), rtol=1e-4)


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_the_authored_extent_holds_what_the_form_decodes_to(stage: Usd.Stage, form: str) -> None:
    """Oracle: ellipsoids of the decoded splats against USD's own bound."""
    prim = schema.author(stage, "/Splats", cloud(3, n=60), form=form)
    bound = UsdGeom.BBoxCache(0, ["default", "render"]).ComputeLocalBound(prim).GetRange()
    points = surface(schema.fetch(prim))
    assert (points >= np.array(bound.GetMin())).all()
    assert (points <= np.array(bound.GetMax())).all()


def test_splats_that_are_not_finite_do_not_spoil_the_box() -> None:
    """Oracle: the box of the others."""
    source = cloud(n=6)
    positions, scales = source.positions.copy(), source.scales.copy()
    positions[0, 1], positions[1, 2], scales[2, 0] = np.nan, -np.inf, np.nan
    others = slice(3, None)
    rest = SplatCloud(
        positions=source.positions[others],
        scales=source.scales[others],
        rotations=source.rotations[others],
        opacities=source.opacities[others],
        sh=source.sh[others],
    )
    spoilt = replace(source, positions=positions, scales=scales)
    np.testing.assert_array_equal(compute_extent(spoilt), compute_extent(rest))


def test_an_empty_cloud_has_a_point_for_a_box() -> None:
    """Oracle: the documented corners."""
    assert compute_extent(cloud(n=0)).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_a_zero_quaternion_counts_as_no_rotation() -> None:
    """Oracle: the box with the identity."""
    source = cloud(n=1)
    zero = replace(source, rotations=np.zeros((1, 4), np.float32))
    identity = replace(source, rotations=np.float32([[1, 0, 0, 0]]))
    np.testing.assert_array_equal(compute_extent(zero), compute_extent(identity))
