"""Tests of captured colours in every colour mode, on a chart of 24 flat patches.

Oracles: colour-science for spaces and grades, and OCIO's own Python binding for views. None of our
own colour code computes an expected number here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Usd

from tests import chart
from usdsplat import schema
from usdsplat.images.science import colour_science

VIEWS = [
    ("ocio://studio-config-latest", "ACES 2.0 - SDR 100 nits (Rec.709)"),
    ("ocio://cg-config-v2.1.0_aces-v1.3_ocio-v2.3", "ACES 1.0 - SDR Video"),
]
DISPLAY = {VIEWS[0][0]: "sRGB - Display", VIEWS[1][0]: "sRGB - Display"}
SPACES = {"lin_rec709_scene": "sRGB", "lin_ap1_scene": "ACEScg"}
JND = 1.0
"""ΔE2000 that people just notice."""


def linear() -> Any:
    """The chart as an sRGB capture holds it, decoded: linear Rec.709."""
    return colour_science().models.eotf_sRGB(chart.chart_codes())


def in_space(rgb: Any, space: str) -> Any:
    """Linear Rec.709 in other primaries."""
    return colour_science().RGB_to_RGB(rgb, "sRGB", SPACES[space], "Bradford")


def test_display_shows_the_captured_code_values() -> None:
    """Oracle: the code values that the splats were made of."""
    found = chart.patches(chart.picture(chart.chart_stage(), color_mode="display"))
    np.testing.assert_allclose(found, chart.chart_codes(), atol=1e-4)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("blend_space", ["auto", "linear"])
def test_scene_holds_the_light_of_the_chart(space: str, blend_space: str) -> None:
    """Oracle: colour-science's decoding and primaries, adapted by Bradford."""
    found = chart.patches(
        chart.picture(
            chart.chart_stage(), color_mode="scene", working_space=space, blend_space=blend_space
        )
    )
    np.testing.assert_allclose(found, in_space(linear(), space), atol=3e-4)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize(("config", "view"), VIEWS, ids=["ACES 2.0", "ACES 1.3"])
def test_inverse_view_is_shown_as_captured(config: str, view: str, space: str) -> None:
    """Through the studio's view the chart looks as in a splat viewer. Oracle: OCIO's own binding,
    forward; no patch differs by what people notice, nor by a step of 8 bits."""
    ocio = pytest.importorskip("PyOpenColorIO")
    found = chart.patches(
        chart.picture(
            chart.chart_stage(),
            color_mode="inverseView",
            working_space=space,
            ocio_config=config,
            ocio_view=view,
        )
    )
    known = ocio.Config.CreateFromFile(config)
    name = known.getColorSpace(space) or known.getColorSpace(
        {"lin_ap1_scene": "ACEScg", "lin_rec709_scene": "Linear Rec.709 (sRGB)"}[space]
    )
    processor = known.getProcessor(
        name.getName(), DISPLAY[config], view, ocio.TRANSFORM_DIR_FORWARD
    ).getDefaultCPUProcessor()
    shown = found.astype(np.float32).copy()
    processor.applyRGB(shown)
    assert np.abs(shown - chart.chart_codes()).max() < 1 / 255
    decoded = colour_science().models.eotf_sRGB(np.clip(shown, 0, 1))
    assert chart.delta_e(decoded, linear()).max() < 0.5 * JND
    plain = in_space(linear(), space)
    assert np.abs(found - plain).max() > 0.05, "a view that changes something was meant"


def test_without_a_view_inverse_view_is_scene() -> None:
    """Oracle: colour-science's decoding."""
    found = chart.patches(chart.picture(chart.chart_stage(), color_mode="inverseView"))
    np.testing.assert_allclose(found, linear(), atol=3e-4)


def test_inverse_max_clamps() -> None:
    """Oracle: the number itself."""
    settings = {"ocio_config": VIEWS[0][0], "inverse_max": 1.0, "color_mode": "inverseView"}
    codes = np.tile((0.9, 0.5, 0.2), (24, 1))
    found = chart.patches(chart.picture(chart.chart_stage(codes=codes), **settings))
    np.testing.assert_allclose(found[:, 0], 1.0, rtol=1e-5)
    assert (found[:, 1:] < 0.9).all()


@pytest.mark.parametrize("source", ["srgb_rec709_scene", "srgb_p3d65_scene"])
def test_a_grade_is_of_linear_light_in_the_capture_s_primaries(source: str) -> None:
    """Exposure, tungsten to daylight, saturation and gain. Oracle: each by colour-science."""
    colour = colour_science()
    stage = chart.chart_stage()
    prim = stage.GetPrimAtPath(chart.FIELD)
    Usd.ColorSpaceAPI(prim).GetColorSpaceNameAttr().Set(source)
    schema.author_grade(
        prim, exposure=-0.7, temperature=3200.0, saturation=0.8, gain=(1.1, 1.0, 0.9)
    )
    own = {"srgb_rec709_scene": "sRGB", "srgb_p3d65_scene": "P3-D65"}[source]
    primaries = colour.RGB_COLOURSPACES[own]
    tungsten = colour.UCS_uv_to_xy(colour.temperature.CCT_to_uv_Krystek1985(3200.0))
    daylight = colour.temperature.CCT_to_xy_CIE_D(6504.0)
    xyz = linear() @ primaries.matrix_RGB_to_XYZ.T
    xyz = colour.chromatic_adaptation(
        xyz, colour.xy_to_XYZ(tungsten), colour.xy_to_XYZ(daylight), transform="Bradford"
    )
    rgb = xyz @ primaries.matrix_XYZ_to_RGB.T * (1.1, 1.0, 0.9) * 2**-0.7
    luminance = (rgb @ primaries.matrix_RGB_to_XYZ[1])[:, None]
    rgb = luminance + 0.8 * (rgb - luminance)
    expected = colour.RGB_to_RGB(rgb, own, "sRGB", "Bradford")
    # linear blending, so that what a display cannot show is not lost on the way
    found = chart.patches(chart.picture(stage, color_mode="scene", blend_space="linear"))
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert np.median(chart.delta_e(np.maximum(found, 0), np.maximum(expected, 0))) < 0.1
