"""Tests of the matrix of a grade."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.core.grade import UNIT, Grade
from usdsplat.images.color import COLOR_SPACES, conversion, convert, is_identity
from usdsplat.images.grade import grade_matrix, white_xyz
from usdsplat.images.science import colour_science
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.recolor import recolor

SWATCHES = np.array([(0.18, 0.5, 0.9), (0.1, 1.0, 0.05), (1.7, 0.08, 4.0), (0.5, 0.5, 0.5)])


def graded(rgb: Any, space: str = "lin_rec709_scene", **values: Any) -> Any:
    """Linear colours, graded."""
    return np.asarray(rgb) @ np.reshape(grade_matrix(Grade(**values), space), (3, 3)).T


@pytest.mark.parametrize("space", COLOR_SPACES)
def test_a_neutral_grade_is_exactly_the_unit_matrix(space: str) -> None:
    """Oracle: the unit matrix, bit for bit."""
    assert grade_matrix(Grade(), space) == UNIT


def test_exposure_is_in_stops_and_gain_a_factor() -> None:
    """Oracle: powers of two, closed form."""
    np.testing.assert_allclose(graded(SWATCHES, exposure=-1.5), SWATCHES * 2**-1.5)
    np.testing.assert_allclose(graded(SWATCHES, gain=(2, 1, 0.5)), SWATCHES * (2, 1, 0.5))


@pytest.mark.parametrize(
    ("space", "name"),
    [("srgb_rec709_scene", "ITU-R BT.709"), ("lin_ap1_scene", "ACEScg"), ("raw", "ITU-R BT.709")],
)
def test_saturation_keeps_the_luminance_of_the_own_primaries(space: str, name: str) -> None:
    """Oracle: the luminance of colour-science's primaries."""
    weights = colour_science().RGB_COLOURSPACES[name].matrix_RGB_to_XYZ[1]
    luminance = SWATCHES @ weights
    np.testing.assert_allclose(
        graded(SWATCHES, space, saturation=0.0), np.tile(luminance[:, None], 3), rtol=2e-4
    )
    expected = luminance[:, None] + 1.7 * (SWATCHES - luminance[:, None])
    np.testing.assert_allclose(graded(SWATCHES, space, saturation=1.7), expected, atol=1e-3)


def test_the_order_is_matrix_white_balance_gain_saturation() -> None:
    """Oracle: the single steps, one after the other."""
    matrix = (0.9, 0.1, 0.0, 0.05, 0.9, 0.05, 0.0, 0.2, 0.8)
    values: dict[str, Any] = {
        "matrix": matrix,
        "temperature": 4500.0,
        "gain": (1.2, 1.0, 0.7),
        "saturation": 1.3,
    }
    steps = SWATCHES
    for name, value in values.items():
        steps = graded(steps, **{name: value})
    np.testing.assert_allclose(graded(SWATCHES, **values, exposure=1.0), 2 * steps, rtol=1e-12)
    np.testing.assert_allclose(
        graded(SWATCHES, matrix=matrix), SWATCHES @ np.reshape(matrix, (3, 3)).T
    )


@pytest.mark.parametrize("kelvin", [5000.0, 5500.0, 6504.0, 7500.0, 20000.0])
def test_cool_lights_are_daylight(kelvin: float) -> None:
    """Oracle: colour-science's CIE D series."""
    xy = colour_science().temperature.CCT_to_xy_CIE_D(kelvin)
    x, _, z = white_xyz(kelvin)
    np.testing.assert_allclose((x / (x + 1 + z), 1 / (x + 1 + z)), xy, atol=1e-6)


@pytest.mark.parametrize("kelvin", [1500.0, 2000.0, 2856.0, 3200.0, 4000.0])
def test_warm_lights_are_black_bodies(kelvin: float) -> None:
    """Oracle: colour-science's method of Krystek, and of Kang 2002, which is another fit."""
    temperature = colour_science().temperature
    x, _, z = white_xyz(kelvin)
    found = 4 * x / (x + 15 + 3 * z), 6 / (x + 15 + 3 * z)
    np.testing.assert_allclose(found, temperature.CCT_to_uv_Krystek1985(kelvin), atol=1e-9)
    if kelvin > 1700:
        kang = temperature.CCT_to_xy_Kang2002(kelvin)
        np.testing.assert_allclose((x / (x + 1 + z), 1 / (x + 1 + z)), kang, atol=2e-3)


def test_the_locus_has_no_step() -> None:
    """Oracle: neighbours a tenth of a mired apart are near each other."""
    whites = np.array([white_xyz(1e6 / mired) for mired in np.arange(60, 600, 0.1)])
    assert np.abs(np.diff(whites, axis=0)).max() < 2e-3


def test_the_light_that_was_white_becomes_white() -> None:
    """Grey under 3200 K is grey again. Oracle: colour-science's adaptation and its own black body,
    seen as Rec.709."""
    colour = colour_science()
    uv = colour.temperature.CCT_to_uv_Krystek1985(3200.0)
    light = colour.xy_to_XYZ(colour.UCS_uv_to_xy(uv))
    space = colour.RGB_COLOURSPACES["ITU-R BT.709"]
    orange = np.linalg.inv(space.matrix_RGB_to_XYZ) @ light
    assert orange[0] > 1.5 > 1.0 > orange[2]
    np.testing.assert_allclose(graded(orange, temperature=3200.0), 1.0, atol=2e-3)


@pytest.mark.parametrize("space", ["lin_rec709_scene", "lin_ap1_scene"])
def test_white_balance_is_bradford_s(space: str) -> None:
    """Oracle: colour-science's chromatic_adaptation_VonKries, in XYZ."""
    colour = colour_science()
    name = {"lin_rec709_scene": "ITU-R BT.709", "lin_ap1_scene": "ACEScg"}[space]
    primaries = colour.RGB_COLOURSPACES[name]
    d65 = colour.xy_to_XYZ((0.3127, 0.3290))
    to_d65 = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        colour.xy_to_XYZ(primaries.whitepoint), d65, transform="Bradford"
    )
    xyz = SWATCHES @ (to_d65 @ primaries.matrix_RGB_to_XYZ).T
    adapted = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        white_xyz(4300.0, 0.01), white_xyz(), transform="Bradford"
    )
    expected = xyz @ (np.linalg.inv(to_d65 @ primaries.matrix_RGB_to_XYZ) @ adapted).T
    found = graded(SWATCHES, space, temperature=4300.0, tint=0.01)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_greenish_light_makes_the_picture_magenta() -> None:
    """Oracle: the sign that the schema documents; Duv is the distance in u v by definition."""
    red, green, blue = graded((0.5, 0.5, 0.5), tint=0.01)
    assert green < red and green < blue

    def uv(xyz: Any) -> Any:
        x, y, z = xyz
        return np.array((4 * x, 6 * y)) / (x + 15 * y + 3 * z)

    moved = uv(white_xyz(6504.0, 0.01)) - uv(white_xyz())
    assert moved[1] > 0
    np.testing.assert_allclose(np.hypot(*moved), 0.01, rtol=1e-6)


@pytest.mark.parametrize("target", ["lin_rec709_scene", "lin_ap1_scene", "srgb_rec709_scene"])
def test_the_thirteen_numbers_carry_the_grade(target: str) -> None:
    """Oracle: decode, grade, encode, in steps of `convert`."""
    grade = grade_matrix(
        Grade(exposure=0.5, temperature=4000.0, saturation=1.2), "lin_rec709_scene"
    )
    numbers = conversion("srgb_rec709_scene", target, grade=grade)
    assert numbers.shape == (13,) and numbers.dtype == np.float32
    linear = convert(SWATCHES, "srgb_rec709_scene", "lin_rec709_scene")
    expected = linear @ np.reshape(grade, (3, 3)).T
    expected = convert(expected, "lin_rec709_scene", target)
    image = np.concatenate([SWATCHES, np.ones((4, 1))], axis=1)[None].astype(np.float32)
    CpuDevice().run(recolor, image, numbers)
    np.testing.assert_allclose(image[0, :, :3], expected, rtol=1e-4, atol=1e-4)


def test_data_is_graded_as_it_is() -> None:
    """Oracle: the grade alone, without a curve."""
    doubled = grade_matrix(Grade(exposure=1.0), "raw")
    numbers = conversion("raw", "lin_ap1_scene", grade=doubled)
    assert numbers.tolist() == [1, 0, 2, 0, 0, 0, 2, 0, 0, 0, 2, 1, 0]


def test_without_a_grade_nothing_changes() -> None:
    """Oracle: the conversion without one."""
    assert is_identity(conversion("srgb_rec709_scene", "srgb_rec709_scene", grade=UNIT))
    doubled = grade_matrix(Grade(exposure=1.0), "srgb_rec709_scene")
    assert not is_identity(conversion("srgb_rec709_scene", "srgb_rec709_scene", grade=doubled))


def test_a_space_that_does_not_exist_is_refused() -> None:
    """Oracle: the sentence that lists those there are."""
    with pytest.raises(UsageError, match="expected one of lin_rec709_scene"):
        grade_matrix(Grade(), "teapot")
