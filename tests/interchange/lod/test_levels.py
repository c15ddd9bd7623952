"""Tests of the steps from the children of a node to its proxies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.formats.samples import random_cloud
from usdsplat.core import covariance
from usdsplat.core.extent import REACH
from usdsplat.interchange.lod import levels


def test_the_low_pass_is_added_to_covariances():
    """Oracle: the covariance plus 0.3 pixel² times the identity, in float64."""
    cloud = random_cloud(50, 0)
    found = levels.baked(cloud, 0.2)
    before, after = (
        covariance.from_scale_rotation(c.scales.astype(np.float64), c.rotations.astype(np.float64))
        for c in (cloud, found)
    )
    np.testing.assert_allclose(after, before + 0.3 * 0.04 * np.eye(3), rtol=1e-5, atol=1e-8)
    assert found.opacities is cloud.opacities
    assert levels.baked(cloud, 0.0) is cloud


def test_a_quarter_is_left():
    """Oracle: closed form: a quarter, rounded up, within the limits."""
    cases = [(1, 9), (4, 9), (5, 9), (36, 9), (37, 9), (1000, 9)]
    assert [levels.proxy_count(*case) for case in cases] == [1, 1, 2, 9, 9, 9]


def test_the_size_of_a_node_ignores_outliers():
    """Oracle: closed form: of 101 points at 0 to 100, the middle nine tenths are 5 to 95."""
    points = np.zeros((101, 3), np.float32)
    points[:, 1] = np.random.default_rng(0).permutation(101)
    assert levels.node_size(points) == 90
    points[points[:, 1] == 100] = 1e9
    assert levels.node_size(points) == 90
    assert levels.node_size(points[:1]) == 0
    assert levels.node_size(points[:0]) == 0


def test_strays_are_larger_than_half_their_node():
    """Oracle: closed form: the radius is REACH standard deviations; of many, the largest."""
    cloud = random_cloud(32, 0)
    scales = np.full((32, 3), 0.01, np.float32)
    scales[3, 1], scales[7, 2] = 5.1 / REACH, 4.9 / REACH
    cloud = replace(cloud, scales=scales)
    assert np.flatnonzero(levels.strays(cloud, 10.0)).tolist() == [3]
    assert np.flatnonzero(levels.strays(cloud, 9.0)).tolist() == [3, 7]
    assert np.flatnonzero(levels.strays(cloud, 9.0, most=1)).tolist() == [3]
    assert levels.strays(cloud, 0.0).all()


def test_the_typical_size_is_that_of_half_the_visible_area():
    """Oracle: closed form: discs of the radii 1 and 2 with equal area in total, and a needle."""
    cloud = random_cloud(6, 0)
    scales = np.tile(np.float32([0.1, 1, 1]), (6, 1))
    scales[5] = 2, 2, 0.1
    cloud = replace(cloud, scales=scales, opacities=np.ones(6, np.float32))
    assert levels.typical_size(cloud) == 1.0
    heavier = replace(cloud, opacities=np.float32([0.7] * 5 + [1]))
    assert levels.typical_size(heavier) == 2.0
    assert levels.typical_size(replace(cloud, opacities=np.zeros(6, np.float32))) == 0.0
