from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.render.framing import CONFORM, conform, data_window
from usdsplat.render.specs import Framing

SQUARE = (-1.0, -1.0, 1.0, 1.0)
OFF_AXIS = (-1.0, 0.5, 3.0, 2.5)
"""4 wide, 2 high, around (1, 1.5)."""


def framing(policy, resolution, pixel_aspect=1.0):
    return Framing(resolution=resolution, conform=policy, pixel_aspect_ratio=pixel_aspect)


@pytest.mark.parametrize(
    ("policy", "resolution", "expected"),
    [
        ("expandAperture", (100, 100), (-1.0, -0.5, 3.0, 3.5)),
        ("expandAperture", (300, 100), (-2.0, 0.5, 4.0, 2.5)),
        ("cropAperture", (100, 100), (0.0, 0.5, 2.0, 2.5)),
        ("cropAperture", (400, 100), (-1.0, 1.0, 3.0, 2.0)),
        ("adjustApertureWidth", (100, 100), (0.0, 0.5, 2.0, 2.5)),
        ("adjustApertureWidth", (400, 100), (-3.0, 0.5, 5.0, 2.5)),
        ("adjustApertureHeight", (100, 100), (-1.0, -0.5, 3.0, 3.5)),
        ("adjustApertureHeight", (400, 100), (-1.0, 1.0, 3.0, 2.0)),
    ],
)
def test_a_policy_changes_one_side_about_the_middle(policy, resolution, expected):
    """Oracle: the schema's definition of each policy, worked out by hand for a 4 x 2 window."""
    window, pixel_aspect = conform(OFF_AXIS, framing(policy, resolution))
    assert window == pytest.approx(expected)
    assert pixel_aspect == 1.0


def test_pixels_can_take_up_the_difference():
    """Oracle: a square shown by 200 x 100 pixels has pixels half as wide as high."""
    window, pixel_aspect = conform(SQUARE, framing("adjustPixelAspectRatio", (200, 100)))
    assert window == SQUARE
    assert pixel_aspect == pytest.approx(0.5)


@pytest.mark.parametrize("policy", CONFORM)
@pytest.mark.parametrize("resolution", [(64, 48), (48, 64), (50, 50)])
@pytest.mark.parametrize("pixel_aspect", [0.5, 1.0, 2.0])
def test_pixels_cover_the_window_whatever_the_policy(policy, resolution, pixel_aspect):
    """Oracle: the identity that all policies exist for: window aspect = pixel aspect * columns /
    rows; expanding never loses and cropping never gains."""
    columns, rows = resolution
    window, result = conform(OFF_AXIS, framing(policy, resolution, pixel_aspect))
    width, height = window[2] - window[0], window[3] - window[1]
    assert width / height == pytest.approx(result * columns / rows)
    if policy == "expandAperture":
        assert width >= 4 - 1e-12 and height >= 2 - 1e-12
    if policy == "cropAperture":
        assert width <= 4 + 1e-12 and height <= 2 + 1e-12


@pytest.mark.parametrize(
    ("window", "asked"),
    [
        (SQUARE, framing("stretch", (10, 10))),
        ((0.0, 0.0, 0.0, 1.0), framing("expandAperture", (10, 10))),
        (SQUARE, framing("expandAperture", (0, 10))),
        (SQUARE, framing("expandAperture", (10, 10), 0.0)),
    ],
)
def test_what_has_no_area_or_name_is_refused_in_a_sentence(window, asked):
    """Oracle: the error's class and shape."""
    with pytest.raises(UsageError, match=r"found .*expected "):
        conform(window, asked)


@pytest.mark.parametrize("resolution", [(10, 7), (3, 2)])
def test_a_pixel_is_in_the_data_window_when_its_centre_is(resolution):
    """Oracle: every centre tested by itself in exact fractions, left and bottom edges included."""
    columns, rows = resolution
    rng = np.random.default_rng(5)
    edges = [0.0, 0.25, 0.5, 0.75, 1.0, -0.5, 1.5, *rng.uniform(-1, 2, 8)]
    for _ in range(60):
        x0, x1 = sorted(rng.choice(edges, 2))
        y0, y1 = sorted(rng.choice(edges, 2))
        inside = {
            (x, y)
            for x in range(-2 * columns, 3 * columns)
            for y in range(-2 * rows, 3 * rows)
            if x0 <= Fraction(2 * x + 1, 2 * columns) < x1
            and y0 <= 1 - Fraction(2 * y + 1, 2 * rows) < y1
        }
        if not inside:
            with pytest.raises(UsageError, match="dataWindowNDC"):
                data_window((x0, y0, x1, y1), resolution)
            continue
        left, top, right, bottom = data_window((x0, y0, x1, y1), resolution) or (0, 0, *resolution)
        assert inside == {(x, y) for x in range(left, right) for y in range(top, bottom)}


def test_the_whole_display_window_is_none():
    """Oracle: `Framing.data_window`'s own meaning of None."""
    assert data_window((0.0, 0.0, 1.0, 1.0), (1920, 1080)) is None
    assert data_window((0.0, 0.5, 1.0, 1.0), (10, 10)) == (0, 0, 10, 5)
