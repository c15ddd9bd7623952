"""Tests of the free camera. Oracles: closed forms, and the renderer's own projection."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from usdsplat.core.cloud import F64
from usdsplat.delegate.default_camera import frame_subject
from usdsplat.preview.camera import FreeCamera, UpAxis, Vector
from usdsplat.render.screen import Screen
from usdsplat.render.specs import CameraSpec, Framing, View
from usdsplat.render.subject import FILL, of_box

CAMERA = FreeCamera(eye=(3.0, 2.0, 5.0), target=(0.5, -0.25, 1.0), field_of_view=35.0)
BOX = (np.array((-1.0, -2.0, 0.5)), np.array((3.0, 0.25, 4.0)))
HEIGHT = 600


def pixels(spec: CameraSpec, points: object, *, aspect: float) -> F64:
    """Where the renderer has points, x right and y down [pixel], shape (n, 2)."""
    framing = Framing(resolution=(round(HEIGHT * aspect), HEIGHT))
    screen = Screen.of(View(camera=spec, framing=framing))
    local = np.atleast_2d(points) @ screen.world_to_camera[:3, :3].T + screen.world_to_camera[:3, 3]
    depth = np.ones(len(local)) if spec.orthographic else local[:, 2]
    return np.asarray(local[:, :2] / depth[:, None] * screen.focal + screen.center)


def corners(box: tuple[F64, F64]) -> F64:
    """Of a box, shape (8, 3)."""
    return np.array([np.where(np.array(bits), box[1], box[0]) for bits in np.ndindex(2, 2, 2)])


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_an_orbit_keeps_the_distance_and_the_horizon(up_axis: UpAxis) -> None:
    """Oracle: the closed form: a turn about the target, right level with the ground."""
    camera = replace(CAMERA, up_axis=up_axis)
    for right, down in [(0.2, 0.1), (-1.3, 0.4), (0.0, -0.3)]:
        orbited = camera.orbited(right, down)
        assert orbited.target == camera.target
        assert orbited.distance == pytest.approx(camera.distance)
        assert orbited.axes[0]["XYZ".index(up_axis)] == pytest.approx(0.0, abs=1e-12)


def test_an_orbit_over_the_height_goes_halfway_round() -> None:
    """Oracle: the closed form: the eye mirrored at the target's vertical."""
    eye = np.array(CAMERA.orbited(1.0, 0.0).eye)
    target = np.array(CAMERA.target)
    assert eye - target == pytest.approx((CAMERA.eye - target) * (-1, 1, -1))


@pytest.mark.parametrize("down", [5.0, -5.0])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_an_orbit_never_goes_over_the_top(down: float, up_axis: UpAxis) -> None:
    """Oracle: the closed form: the camera's up never points below the horizon."""
    camera = replace(CAMERA, up_axis=up_axis).orbited(0.0, down)
    side = np.array(camera.axes[0])
    assert camera.axes[1]["XYZ".index(up_axis)] >= 0.0
    assert camera.axes[2]["XYZ".index(up_axis)] == pytest.approx(np.sign(down))
    assert camera.axes[0] == pytest.approx(replace(CAMERA, up_axis=up_axis).axes[0], abs=1e-6)
    assert camera.orbited(0.0, -0.5 * np.sign(down)).axes[0] == pytest.approx(side, abs=1e-6)


def test_what_is_dragged_follows_the_pointer() -> None:
    """Oracle: a person's expectation: the near side of a thing goes where the hand goes."""
    near = np.array(CAMERA.target) + 0.2 * CAMERA.axes[2]
    before = pixels(CAMERA.spec(aspect=1.0, bounds=None), near, aspect=1.0)[0]
    after = pixels(CAMERA.orbited(0.05, 0.03).spec(aspect=1.0, bounds=None), near, aspect=1.0)[0]
    assert after[0] > before[0]
    assert after[1] > before[1]


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("roll", [0.0, 30.0])
def test_a_pan_keeps_what_is_at_the_targets_depth_under_the_pointer(
    aspect: float, is_orthographic: bool, roll: float
) -> None:
    """Oracle: the renderer's projection: the point moves by as many pixels as the drag."""
    camera = replace(CAMERA, is_orthographic=is_orthographic, roll=roll)
    right, up, _ = camera.axes
    point = np.array(camera.target) + 0.4 * right - 0.3 * up
    moved = camera.panned(0.25, -0.1, aspect=aspect)
    before, after = (
        pixels(each.spec(aspect=aspect, bounds=None), point, aspect=aspect)[0]
        for each in (camera, moved)
    )
    assert after - before == pytest.approx((0.25 * HEIGHT, -0.1 * HEIGHT))


def test_a_dolly_multiplies_the_distance_and_never_arrives() -> None:
    """Oracle: the closed form."""
    nearer = CAMERA.dollied(0.5)
    assert nearer.distance == pytest.approx(0.5 * CAMERA.distance)
    assert nearer.axes == pytest.approx(CAMERA.axes)
    arrived = CAMERA.dollied(1e-30)
    assert arrived.distance > 0
    assert arrived.axes == pytest.approx(CAMERA.axes, abs=1e-6)
    assert math.isfinite(CAMERA.dollied(1e300).dollied(1e300).distance)


def test_looking_around_keeps_the_eye() -> None:
    """Oracle: the closed form: half a height turns by one field of view."""
    turned = CAMERA.looked_around(0.5, 0.0)
    level = CAMERA.axes * (1.0, 0.0, 1.0)
    cosine = level[0] @ turned.axes[0]
    assert turned.eye == CAMERA.eye
    assert turned.distance == pytest.approx(CAMERA.distance)
    assert math.degrees(math.acos(cosine)) == pytest.approx(CAMERA.field_of_view)
    assert turned.axes[0] @ level[2] > 0, "to the right"


def test_a_flight_goes_along_the_cameras_axes() -> None:
    """Oracle: the closed form."""
    flown = CAMERA.flown(1.0, 2.0, 3.0)
    right, up, back = CAMERA.axes
    shift = right + 2.0 * up - 3.0 * back
    assert np.subtract(flown.eye, CAMERA.eye) == pytest.approx(shift)
    assert np.subtract(flown.target, CAMERA.target) == pytest.approx(shift)


def test_what_is_aimed_at_is_in_the_middle_and_as_far_away() -> None:
    """Oracle: the closed form."""
    aimed = CAMERA.aimed((7.0, -3.0, 2.0))
    assert aimed.target == pytest.approx((7.0, -3.0, 2.0))
    assert aimed.distance == pytest.approx(CAMERA.distance)
    assert aimed.axes == pytest.approx(CAMERA.axes)


@pytest.mark.parametrize("aspect", [0.3, 1.0, 1.7, 4.0])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_a_framed_box_is_seen_whole_and_fills_the_picture(
    aspect: float, is_orthographic: bool
) -> None:
    """Oracle: the renderer's projection of its corners, and the margin."""
    camera = replace(CAMERA, is_orthographic=is_orthographic, roll=20.0)
    framed = camera.framing(of_box(BOX), aspect=aspect)
    spec = framed.spec(aspect=aspect, bounds=BOX)
    seen = (pixels(spec, corners(BOX), aspect=aspect) + 0.5) / HEIGHT / (aspect, 1.0)
    assert seen.min() >= 0.0
    assert seen.max() <= 1.0
    assert np.ptp(seen, axis=0).max() == pytest.approx(FILL)
    assert framed.axes == pytest.approx(replace(CAMERA, roll=0.0).axes)


def test_a_framed_point_is_seen_from_as_far_as_before() -> None:
    """Oracle: the closed form: a point has no size that says how far to go."""
    point = np.array((1.0, 2.0, 3.0))
    framed = CAMERA.framing(of_box((point, point)), aspect=1.0)
    assert framed.target == pytest.approx(point)
    assert framed.distance == pytest.approx(CAMERA.distance)


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("distance", [0.01, 3.0, 1e5])
def test_clipping_contains_the_bounds(is_orthographic: bool, distance: float) -> None:
    """Oracle: planar depths of the corners."""
    camera = replace(CAMERA, is_orthographic=is_orthographic).framing(of_box(BOX), aspect=1.0)
    camera = camera.dollied(distance / camera.distance)
    spec = camera.spec(aspect=1.0, bounds=BOX)
    matrix = np.reshape(spec.world_to_camera, (4, 4))
    depths = -(corners(BOX) @ matrix[:3, :3].T + matrix[:3, 3])[:, 2]
    near, far = spec.clipping_range
    assert 0 < near < far
    assert depths.max() < far
    if depths.min() > 0:
        assert near < depths.min()
    else:
        assert not is_orthographic
        assert near < 0.01 * np.linalg.norm(BOX[1] - BOX[0])


def test_a_flight_inside_a_capture_sees_what_is_near() -> None:
    """Oracle: the closed form: a thousandth of the way to the target, however large the stage."""
    huge = (np.full(3, -1e4), np.full(3, 1e4))
    near, far = CAMERA.spec(aspect=1.0, bounds=huge).clipping_range
    assert near <= 1e-3 * CAMERA.distance
    assert far > 1e4


CAMERAS = {
    "frames all": frame_subject(of_box(BOX), BOX, up_axis="Y", aspect=1.0),
    "rolled": replace(CAMERA, roll=-50.0).spec(aspect=1.0, bounds=BOX),
    "upside down": replace(CAMERA, roll=180.0).spec(aspect=1.0, bounds=BOX),
    "orthographic": replace(CAMERA, is_orthographic=True).spec(aspect=1.6, bounds=None),
    "from above": CameraSpec(
        world_to_camera=(0, 0, 1, 1, 1, 0, 0, 0, 0, 1, 0, -20, 0, 0, 0, 1), exposure=2.0
    ),
    "from below": CameraSpec(
        world_to_camera=(0, 0, 1, 1, -1, 0, 0, 0, 0, -1, 0, -20, 0, 0, 0, 1), exposure=2.0
    ),
}


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("aspect", [0.4, 1.0, 2.5])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_a_free_camera_sees_what_a_stages_camera_saw(
    name: str, aspect: float, up_axis: UpAxis
) -> None:
    """Oracle: the renderer's projection of points before the camera, to a millionth."""
    stages = CAMERAS[name]
    target = (0.5, -0.25, 1.0)
    free = FreeCamera.like(stages, target=target, up_axis=up_axis, aspect=aspect)
    spec = free.spec(aspect=aspect, bounds=None)
    points = corners((np.array((-0.2, -0.5, 0.7)), np.array((0.8, 0.1, 1.2))))
    before, after = (pixels(each, points, aspect=aspect) for each in (stages, spec))
    assert after == pytest.approx(before, abs=2e-6 * HEIGHT)
    assert spec.exposure == stages.exposure
    if name != "orthographic":
        eye = np.linalg.inv(np.reshape(stages.world_to_camera, (4, 4)))[:3, 3]
        assert free.eye == pytest.approx(eye)


@pytest.mark.parametrize("name", ["from above", "from below"])
def test_a_camera_from_above_tilts_about_its_own_horizon(name: str) -> None:
    """Oracle: a person's expectation: the side of the picture stays where it is, and level."""
    free = FreeCamera.like(CAMERAS[name], target=(0.0, 0.0, 0.0), up_axis="Y", aspect=1.0)
    down = -0.2 if name == "from above" else 0.2
    tilted = free.orbited(0.0, down)
    assert free.roll == 0.0
    assert tilted.axes[0] == pytest.approx(free.axes[0], abs=1e-6)
    assert abs(tilted.axes[2][1]) == pytest.approx(math.cos(0.2 * math.pi), abs=1e-5)


def test_an_orthographic_camera_keeps_its_lens_shift() -> None:
    """Oracle: the renderer's projection: parallel rays shifted are parallel rays elsewhere."""
    shifted = replace(CAMERAS["orthographic"], window=(-1.0, -2.5, 4.0, 1.5))
    free = FreeCamera.like(shifted, target=(0.0, 0.0, 0.0), up_axis="Y", aspect=1.25)
    points = corners(BOX)
    before = pixels(shifted, points, aspect=1.25)
    after = pixels(free.spec(aspect=1.25, bounds=BOX), points, aspect=1.25)
    assert after == pytest.approx(before, abs=1e-6 * HEIGHT)


def test_a_shifted_lens_keeps_the_middle_of_its_picture() -> None:
    """Oracle: the closed form of the ray through the middle of the window."""
    spec = CameraSpec(window=(-0.2, 0.1, 0.6, 0.9))
    free = FreeCamera.like(spec, target=(0.0, 0.0, -4.0), up_axis="Y", aspect=1.0)
    seen = pixels(free.spec(aspect=1.0, bounds=None), [(0.8, 2.0, -4.0)], aspect=1.0)[0]
    assert seen == pytest.approx(np.full(2, 0.5 * HEIGHT - 0.5))


@pytest.mark.parametrize("target", [(0.0, 0.0, 7.0), (0.0, 0.0, 0.0)])
def test_a_target_behind_the_eye_is_one_before_it(target: Vector) -> None:
    """Oracle: a person's expectation: an orbit turns about what is seen."""
    free = FreeCamera.like(CameraSpec(), target=target, up_axis="Y", aspect=1.0)
    assert free.target[2] < 0.0
