from __future__ import annotations

import itertools

import numpy as np
import pytest

from usdsplat.delegate.default_camera import frame_subject, union
from usdsplat.render.subject import FILL, NEAREST, of_box

BOXES = [
    (np.array([-1.0, -1, -1]), np.array([1.0, 1, 1])),
    (np.array([49.0, 2, -7]), np.array([53.0, 2.5, 30])),
    (np.array([0.0, 0, 0]), np.array([1e-3, 4.0, 1e-3])),
]


def in_camera(camera, box):
    corners = np.array(list(itertools.product(*zip(*box, strict=True))))
    world = np.reshape(camera.world_to_camera, (4, 4))
    return corners @ world[:3, :3].T + world[:3, 3]


@pytest.mark.parametrize("box", BOXES, ids=["cube", "slab", "pole"])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("aspect", [0.4, 1.0, 16 / 9])
def test_the_subject_fills_the_picture_and_stays_inside(box, up_axis, aspect):
    """Oracle: each corner projected by hand: all inside, the outermost at the margin."""
    camera = frame_subject(of_box(box), box, up_axis=up_axis, aspect=aspect)
    points = in_camera(camera, box)
    depth = -points[:, 2]
    left, bottom, right, top = camera.window
    reach = np.maximum(np.abs(points[:, 0]) / right, np.abs(points[:, 1]) / top) / depth
    assert (left, bottom) == (-right, -top)
    assert right / top == pytest.approx(aspect)
    if depth.min() == pytest.approx(NEAREST * np.ptp(depth)):  # a pole that points at the eye
        assert 0.3 < reach.max() <= FILL
    else:
        assert reach.max() == pytest.approx(FILL)
    near, far = camera.clipping_range
    assert 0 < near < depth.min() and depth.max() < far


@pytest.mark.parametrize(("up_axis", "up"), [("Y", (0, 1, 0)), ("Z", (0, 0, 1))])
def test_the_stage_stands_upright_and_is_seen_from_the_front(up_axis, up):
    """Oracle: USD's frames: up is up in the picture, and the front of a stage is +z with Y up and
    -y with Z up."""
    camera = frame_subject(of_box(BOXES[0]), BOXES[0], up_axis=up_axis, aspect=1.0)
    world = np.reshape(camera.world_to_camera, (4, 4))
    x, y, _ = world[:3, :3] @ up
    eye = np.linalg.inv(world)[:3, 3]
    front = (0, 0, 1) if up_axis == "Y" else (0, -1, 0)
    assert abs(x) < 1e-12 and y > 0.8
    assert eye @ front > 0.8 * np.linalg.norm(eye)
    np.testing.assert_allclose(world[:3, :3] @ world[:3, :3].T, np.eye(3), atol=1e-12)


def test_strays_widen_the_clipping_range_and_not_the_picture():
    """Oracle: the camera of the subject alone."""
    stray = (BOXES[0][0] - 100, BOXES[0][1] + 100)
    alone = frame_subject(of_box(BOXES[0]), BOXES[0], up_axis="Y", aspect=1.0)
    camera = frame_subject(of_box(BOXES[0]), stray, up_axis="Y", aspect=1.0)
    assert (camera.world_to_camera, camera.window) == (alone.world_to_camera, alone.window)
    near, far = camera.clipping_range
    assert 0 < near < alone.clipping_range[0]
    assert far > -in_camera(camera, stray)[:, 2].min()


def test_nothing_is_framed_as_a_unit_cube():
    """Oracle: the camera of that cube."""
    cube = (np.full(3, -0.5), np.full(3, 0.5))
    assert frame_subject(None, None, up_axis="Y", aspect=2.0) == frame_subject(
        of_box(cube), cube, up_axis="Y", aspect=2.0
    )


def test_the_union_of_boxes_holds_them_all():
    """Oracle: written out by hand; what has no box does not count."""
    low, high = union([None, BOXES[0], BOXES[1]])
    assert (low.tolist(), high.tolist()) == ([-1, -1, -7], [53, 2.5, 30])
    assert union([None]) is None
