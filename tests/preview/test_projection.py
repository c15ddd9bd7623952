"""Tests of pixels and rays of a viewport. Oracle: the renderer's own projection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.preview.test_camera import CAMERA, HEIGHT, pixels
from usdsplat.preview.projection import Projection

POINTS = np.array([(0.2, -0.5, 0.7), (0.8, 0.1, 1.2), (0.5, -0.25, 1.0)])


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("aspect", [0.5, 2.0])
def test_points_are_where_the_renderer_has_them(is_orthographic: bool, aspect: float) -> None:
    """Oracle: `Screen`, whose pixel (0, 0) is centred on (0, 0): half a pixel from here."""
    spec = replace(CAMERA, is_orthographic=is_orthographic, roll=10.0).spec(aspect=1.3, bounds=None)
    projection = Projection.of(spec, (round(HEIGHT * aspect), HEIGHT))
    expected = pixels(spec, POINTS, aspect=aspect) + 0.5
    assert projection.pixels(POINTS) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_a_ray_goes_through_what_is_seen_there(is_orthographic: bool) -> None:
    """Oracle: the closed form: the point is on the ray of its own pixel, as far as it is deep."""
    spec = replace(CAMERA, is_orthographic=is_orthographic).spec(aspect=1.0, bounds=None)
    projection = Projection.of(spec, (HEIGHT, HEIGHT))
    for point, pixel in zip(POINTS, projection.pixels(POINTS), strict=True):
        start, ray = projection.ray((pixel[0], pixel[1]))
        assert np.cross(point - start, ray) == pytest.approx(np.zeros(3), abs=1e-9)
        assert np.linalg.norm(ray) == pytest.approx(1.0)
        assert ray == pytest.approx(projection.towards(point))
        assert (point - start) @ -projection.axes[2] == pytest.approx(projection.depths(point)[0])


@pytest.mark.parametrize("is_orthographic", [False, True])
def test_a_unit_is_a_pixel_at_that_depth(is_orthographic: bool) -> None:
    """Oracle: two points that far apart are a pixel apart."""
    spec = replace(CAMERA, is_orthographic=is_orthographic).spec(aspect=1.0, bounds=None)
    projection = Projection.of(spec, (HEIGHT, HEIGHT))
    unit = projection.unit(POINTS[0])
    first, second = projection.pixels([POINTS[0], POINTS[0] + unit * projection.axes[1]])
    assert second - first == pytest.approx((0.0, -1.0), abs=1e-9)


def test_a_line_is_cut_where_nothing_is_seen() -> None:
    """Oracle: the closed form: the end behind the eye becomes the one at the near plane."""
    spec = CAMERA.spec(aspect=1.0, bounds=None)
    projection = Projection.of(spec, (HEIGHT, HEIGHT))
    before, behind = np.array(CAMERA.target), np.array(CAMERA.eye) + 3.0 * projection.axes[2]
    behind = behind + 0.7 * projection.axes[0]
    for line in (projection.line(before, behind), projection.line(behind, before)):
        assert line is not None
        ends = sorted(line, key=lambda end: abs(end[0] - 0.5 * HEIGHT))
        assert ends[0] == pytest.approx((0.5 * HEIGHT, 0.5 * HEIGHT))
        share = (projection.depths(before)[0] - projection.near) / (
            projection.depths(before)[0] - projection.depths(behind)[0]
        )
        assert ends[1] == pytest.approx(projection.pixels(before + share * (behind - before))[0])
    assert projection.line(behind, behind + projection.axes[1]) is None
    whole = projection.line(before, before + projection.axes[1])
    assert whole is not None
    expected = projection.pixels([before, before + projection.axes[1]])
    assert np.array(whole) == pytest.approx(expected)
