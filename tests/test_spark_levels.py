"""Tests of the reading of Spark's trees for `benchmarks.spark_levels`."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.spark_levels import decoded, drawable
from usdsplat.core.sh import rgb_to_dc


def half(value: float) -> int:
    """Bits of a number in half precision."""
    return int(np.float16(value).view(np.uint16))


def test_a_splat_is_decoded_as_it_was_encoded() -> None:
    """Oracle: by hand: half numbers, logarithms of scales, and a turn by 180 degrees about the
    axis z, whose octahedral coordinates are in the middle."""
    where = np.float32([1.5, -2.0, 3.0]).view(np.uint32)
    turn = 512 | 512 << 10 | 4095 << 20
    words = [half(0.25) | half(0.5) << 16, half(0.75) | half(-1) << 16, half(-2) | half(-3) << 16]
    ext0, ext1 = np.uint32([[*where, half(1.25)]]), np.uint32([[*words, turn]])
    cloud, opacities = decoded(ext0, ext1)
    assert cloud.positions.tolist() == [[1.5, -2.0, 3.0]]
    np.testing.assert_allclose(cloud.scales, np.exp([[-1, -2, -3]]), rtol=1e-6)
    np.testing.assert_allclose(np.abs(cloud.rotations), [[0, 0, 0, 1]], atol=2e-3)
    np.testing.assert_allclose(cloud.sh[:, 0], rgb_to_dc(np.array([[0.25, 0.5, 0.75]])), atol=1e-6)
    assert (cloud.opacities.tolist(), opacities.tolist()) == ([1.0], [1.25])


@pytest.mark.parametrize("opacity", [0.5, 1.0, 1.1, 1.25, 1.5, 3.0])
def test_a_stack_is_flat_topped(opacity: float) -> None:
    """Oracle: Spark's shader: 1 - (1 - g)^a, a = exp((o^2 - 1) / e) for the stretched opacity o;
    the last splat of the stack is linear in the rest of a."""
    ext0 = np.uint32([[0, 0, 0, half(opacity)]])
    cloud, opacities = decoded(ext0, np.uint32([[0, 0, 0, 4095 << 20]]))
    stack = drawable(cloud, opacities, stacked=True)
    a = np.exp((min(4 * opacity - 3, 5) ** 2 - 1) / np.e) if opacity > 1 else 1.0
    for g in (0.02, 0.3, 0.9):
        found = 1 - np.prod(1 - stack.opacities.astype(np.float64) * g)
        expected = opacity * g if opacity <= 1 else 1 - (1 - g) ** a
        assert abs(found - expected) < 0.05 * g
    (alone,) = drawable(cloud, opacities, stacked=False).scales[:, 0] / cloud.scales[:, 0]
    assert alone == pytest.approx(a ** (1 / 3), rel=1e-3)
