"""Tests of the errors of nodes, measured on pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.interchange.lod.worlds import ground
from usdsplat.core import edit
from usdsplat.interchange.decimating import decimate
from usdsplat.interchange.lod import levels
from usdsplat.interchange.lod.pictures import LEAST_EDGE, SMALLEST, Comparison, Pair
from usdsplat.kernels.device import CpuDevice


@pytest.fixture(scope="module")
def comparison():
    """A comparison on the CPU."""
    return Comparison(CpuDevice())


def test_equal_splats_have_the_smallest_error(comparison):
    """Oracle: closed form: their pictures are equal."""
    cloud = ground(500)
    assert comparison.error(Pair(node=cloud, leaves=cloud), 0.1) == SMALLEST * 0.1


def test_a_node_of_another_colour_is_never_good(comparison):
    """Oracle: the range: pictures of all sizes are equally wrong, so that the first within 1 dB of
    the best counts, which is at most as large as pictures of LEAST_EDGE pixels."""
    cloud = ground(500)
    other = replace(cloud, sh=cloud.sh + np.float32(1))
    error = comparison.error(Pair(node=other, leaves=cloud), 0.1)
    assert 0.1 <= error <= 4 / LEAST_EDGE


def test_far_fewer_proxies_have_larger_errors(comparison):
    """Oracle: the order of the numbers of splats; lengths scale with the world."""
    cloud = ground(8000)
    errors = []
    for count in (2000, 100):
        proxies = decimate(cloud, count)
        size = levels.typical_size(proxies)
        errors.append(comparison.error(Pair(node=proxies, leaves=cloud), size))
    assert errors[1] > 1.25 * errors[0]
    large = [edit.transform(each, np.diag([10.0, 10, 10, 1])) for each in (proxies, cloud)]
    scaled = comparison.error(Pair(node=large[0], leaves=large[1]), 10 * size)
    assert scaled == pytest.approx(10 * errors[-1], rel=0.02)
