"""Tests of transfer curves and conversions of the kernels."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from usdsplat.core import sh
from usdsplat.images.color import conversion, convert
from usdsplat.kernels import color, radiance
from usdsplat.kernels.recolor import recolor

VALUES = np.linspace(-0.2, 1.8, 101, dtype=np.float32)


def test_srgb_is_iec_61966():
    """Oracle: colour-science's sRGB transfer functions."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from colour.models import eotf_inverse_sRGB, eotf_sRGB
    x = np.linspace(0, 1, 101)
    ours = [color.decode(np.float32(v), np.float32(2.4), np.float32(0.055)) for v in x]
    np.testing.assert_allclose(ours, eotf_sRGB(x), atol=2e-6)
    ours = [color.encode(np.float32(v), np.float32(2.4), np.float32(0.055)) for v in x]
    np.testing.assert_allclose(ours, eotf_inverse_sRGB(x), atol=2e-5)


@pytest.mark.parametrize("target", ["lin_rec709_scene", "lin_ap1_scene", "g22_rec709_scene"])
def test_a_picture_is_converted_where_it_is_not_premultiplied(device, target):
    """Oracle: the float64 conversion of images.color, applied to un-premultiplied colour."""
    rng = np.random.default_rng(2)
    alpha = rng.uniform(0.1, 1, (5, 7, 1))
    rgb = rng.uniform(0, 1.5, (5, 7, 3))
    image = np.concatenate([rgb * alpha, alpha], axis=2).astype(np.float32)
    image[2, 3] = 0
    device.run(recolor, image, conversion("srgb_rec709_scene", target))
    expected = convert(rgb, "srgb_rec709_scene", target) * alpha
    expected[2, 3] = 0
    np.testing.assert_allclose(image[..., :3], expected, atol=2e-5)


@pytest.mark.parametrize("degree", range(5))
def test_harmonics_are_those_of_core(degree):
    """Oracle: core.sh in float64, itself held against splat-transform's rotations."""
    rng = np.random.default_rng(degree)
    coefficients = rng.normal(size=(40, 25, 3)).astype(np.float32)
    directions = rng.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = sh.evaluate(coefficients[:, : (degree + 1) ** 2].astype(np.float64), directions)
    ours = [
        [radiance.harmonics(c, k, degree, *np.float32(d)) for k in range(3)]
        for c, d in zip(coefficients, directions, strict=True)
    ]
    np.testing.assert_allclose(ours, expected, atol=5e-6)
