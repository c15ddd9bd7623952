"""Tests of the errors of nodes, measured on pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.interchange.lod.worlds import ground
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange.decimating import decimate
from usdsplat.interchange.lod import levels
from usdsplat.interchange.lod.pictures import LEAST_EDGE, SMALLEST, Comparison, Pair
from usdsplat.kernels.device import CpuDevice
from usdsplat.render.specs import RasterizeMode


@pytest.fixture(scope="module")
def comparison():
    """A comparison on the CPU."""
    return Comparison(CpuDevice())


def pair_of(node: SplatCloud, leaves: SplatCloud, *, mode: RasterizeMode = "antialiased") -> Pair:
    """A node without residents, whose children are leaves."""
    none = edit.take(leaves, np.arange(0))
    return Pair(node=node, proxies=none, captured=leaves, captured_mode=mode, leaves=leaves)


def test_equal_splats_have_the_smallest_error(comparison):
    """Oracle: closed form: the node is drawn as its children, with more samples."""
    cloud = ground(500)
    assert comparison.error(pair_of(cloud, cloud), 0.1) == SMALLEST * 0.1
    assert comparison.error(pair_of(cloud, cloud), 0.1, 0.07) == 0.07


def test_a_node_of_another_colour_is_never_good(comparison):
    """Oracle: the range: pictures of all sizes are equally wrong, so that the first within 1 dB of
    the best counts, which is at most as large as pictures of LEAST_EDGE pixels."""
    cloud = ground(500)
    other = replace(cloud, sh=cloud.sh + np.float32(1))
    error = comparison.error(pair_of(other, cloud), 0.1)
    assert SMALLEST * 0.1 <= error <= 4 / LEAST_EDGE


def test_far_fewer_proxies_have_larger_errors(comparison):
    """Oracle: the order of the numbers of splats; lengths scale with the world."""
    cloud = ground(8000)
    errors = []
    for count in (2000, 100):
        proxies = decimate(cloud, count)
        size = levels.typical_size(proxies)
        errors.append(comparison.error(pair_of(proxies, cloud), size))
    assert errors[1] > 1.25 * errors[0]
    large = [edit.transform(each, np.diag([10.0, 10, 10, 1])) for each in (proxies, cloud)]
    scaled = comparison.error(pair_of(*large), 10 * size)
    assert scaled == pytest.approx(10 * errors[-1], rel=0.02)


def test_a_node_replaces_leaves_that_look_worse(comparison):
    """From afar, classic splats are too dense, and antialiased ones are not. A node is therefore
    good from a smaller pixel if its leaves are drawn in classic mode. Oracle: the order."""
    cloud = ground(8000)
    proxies = decimate(cloud, 500)
    size = levels.typical_size(proxies)
    classic, antialiased = (
        comparison.error(pair_of(proxies, cloud, mode=mode), size)
        for mode in ("classic", "antialiased")
    )
    assert classic < 0.8 * antialiased
