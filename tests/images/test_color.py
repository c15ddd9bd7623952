"""Tests of colour spaces and conversions between them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pxr import Gf

from usdsplat.core.errors import UsageError
from usdsplat.images.color import COLOR_SPACES, color_space, conversion, convert, is_identity

NAMES = [name for name in COLOR_SPACES if name != "srgb_rec709_display"]
SWATCHES = [(0.18, 0.5, 0.9), (0.1, 1.0, 0.05), (1.7, 0.08, 4.0), (-0.2, 0.03, 0.5)]


def apply(numbers, rgb):
    """The thirteen numbers, spelled out by their published meaning."""
    g, a, *matrix, h, b = (float(x) for x in numbers)

    def decode(t):
        if g == 1.0:
            return t
        end = a / (g - 1.0)
        slope = end / ((end + a) / (1 + a)) ** g if a else 1.0
        return t / slope if t < end else ((t + a) / (1 + a)) ** g

    def encode(t):
        if h == 1.0:
            return t
        end = b / (h - 1.0)
        slope = end / ((end + b) / (1 + b)) ** h if b else 1.0
        return t * slope if t * slope < end else (1 + b) * t ** (1 / h) - b

    return [encode(v) for v in np.reshape(matrix, (3, 3)) @ [decode(v) for v in rgb]]


@pytest.mark.parametrize("target", NAMES)
@pytest.mark.parametrize("source", NAMES)
def test_every_pair_of_spaces_agrees_with_gf(source, target):
    """Oracle: GfColorSpace.Convert (float32) of OpenUSD; negative and over-range values too."""
    for swatch in SWATCHES:
        expected = Gf.ColorSpace(target).Convert(Gf.ColorSpace(source), Gf.Vec3f(*swatch)).GetRGB()
        np.testing.assert_allclose(convert(swatch, source, target), expected, rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize("source", NAMES)
def test_the_thirteen_numbers_are_the_conversion(source):
    """Oracle: the curve as `GfColorSpace` documents it, written out here by hand."""
    for target in ("lin_rec709_scene", "srgb_p3d65_scene", "g22_ap1_scene"):
        numbers = conversion(source, target)
        assert numbers.shape == (13,)
        assert numbers.dtype == np.float32
        for swatch in SWATCHES:
            np.testing.assert_allclose(
                apply(numbers, swatch), convert(swatch, source, target), rtol=1e-5, atol=1e-5
            )


def test_we_know_every_rgb_space_that_gf_names():
    """Oracle: the names in Gf.ColorSpaceNames; CIE XYZ is the only one that is not RGB."""
    names = {getattr(Gf.ColorSpaceNames, n) for n in dir(Gf.ColorSpaceNames) if n[0].isupper()}
    assert names - {"lin_ciexyzd65_scene"} == set(NAMES)


def test_srgb_is_the_curve_of_iec_61966_within_its_own_rounding():
    """Oracle: colour-science's sRGB, whose two pieces miss each other by 1e-5 at the joint."""
    ramp = np.linspace(0.0, 1.0, 401)
    linear = convert(np.repeat(ramp[:, None], 3, axis=1), "srgb_rec709_scene", "lin_rec709_scene")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    np.testing.assert_allclose(linear[:, 0], colour.models.eotf_sRGB(ramp), atol=3e-5)


@pytest.mark.parametrize(
    ("name", "theirs"),
    [
        ("lin_ap1_scene", "ACEScg"),
        ("lin_ap0_scene", "ACES2065-1"),
        ("lin_p3d65_scene", "P3-D65"),
        ("lin_rec2020_scene", "ITU-R BT.2020"),
        ("lin_adobergb_scene", "Adobe RGB (1998)"),
    ],
)
def test_matrices_are_those_of_colour_science(name, theirs):
    """Oracle: colour.matrix_RGB_to_RGB with Bradford, from colour-science's own primaries."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    spaces = colour.RGB_COLOURSPACES
    expected = colour.matrix_RGB_to_RGB(spaces[theirs], spaces["sRGB"], "Bradford")
    matrix = conversion(name, "lin_rec709_scene")[2:11].reshape(3, 3)
    np.testing.assert_allclose(matrix, expected, atol=5e-4)


@given(st.tuples(*[st.floats(-4.0, 64.0)] * 3), st.sampled_from(NAMES), st.sampled_from(NAMES))
def test_there_and_back_is_the_same_colour(rgb, source, target):
    """Oracle: the colour that went in (round trip), for any pair of spaces.

    Not closer than 1e-5: a pure power has an infinite slope at 0, where it magnifies rounding.
    """
    back = convert(convert(rgb, source, target), target, source)
    np.testing.assert_allclose(back, rgb, atol=1e-5 * (1 + max(abs(v) for v in rgb)))


def test_conversions_that_change_nothing_say_so():
    """Oracle: a space to itself, an alias and data are no conversion, by definition."""
    assert is_identity(conversion("srgb_rec709_scene", "srgb_rec709_scene"))
    assert is_identity(conversion("srgb_rec709_display", "srgb_rec709_scene"))
    assert is_identity(conversion("raw", "lin_ap1_scene"))
    assert is_identity(conversion("lin_ap1_scene", "data"))
    assert not is_identity(conversion("srgb_rec709_scene", "lin_rec709_scene"))
    assert not is_identity(conversion("lin_ap1_scene", "lin_rec709_scene"))


def test_spaces_with_one_gamut_keep_grey_exactly():
    """Oracle: a shared gamut has the unit matrix, with no rounding in it."""
    matrix = conversion("srgb_rec709_scene", "g22_rec709_scene")[2:11]
    np.testing.assert_array_equal(matrix, np.eye(3).ravel())


def test_an_unknown_space_is_refused_with_the_names_there_are():
    """Oracle: the shape of every error of ours, where: found X, expected Y."""
    with pytest.raises(UsageError, match=r"/World/Tree: found 'sRGB', expected one of lin_rec709"):
        color_space("sRGB", where="/World/Tree")
    with pytest.raises(UsageError, match="'acescg'"):
        conversion("acescg", "lin_rec709_scene")
