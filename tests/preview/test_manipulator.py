"""Tests of handles: positions, hits and drags."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.preview.test_camera import CAMERA
from usdsplat.core.cloud import F64
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.dragging import SCALE, TURN, as_matrix, begin_drag, snapping_step
from usdsplat.preview.manipulator import (
    AXES,
    LENGTH,
    PLANES,
    RING,
    Handle,
    Manipulator,
    Mode,
    Space,
)
from usdsplat.preview.projection import Pixel, Projection

SIZE = (800, 600)


def projection(camera: FreeCamera = CAMERA) -> Projection:
    """Of a camera on the viewport of these tests."""
    return Projection.of(camera.spec(aspect=SIZE[0] / SIZE[1], bounds=None), SIZE)


def placed() -> F64:
    """Turned, scaled differently along each axis, and off the middle of the picture."""
    angle = 0.5
    turn = np.array(
        [
            (math.cos(angle), -math.sin(angle), 0.0),
            (math.sin(angle), math.cos(angle), 0.0),
            (0.0, 0.0, 1.0),
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ np.diag((2.0, 0.5, 1.5))
    matrix[:3, 3] = (0.9, -0.1, 1.3)
    return matrix


def pixel_of(point: F64, camera: FreeCamera = CAMERA) -> Pixel:
    """Where a point of the world is seen."""
    x, y = projection(camera).pixels(point)[0]
    return float(x), float(y)


def grip(manipulator: Manipulator, handle: Handle, camera: FreeCamera = CAMERA) -> Pixel:
    """A pixel of a handle: the middle of its line, plane or of what is seen of its ring."""
    shapes = manipulator.shapes(projection(camera))
    shape = next(shape for shape in shapes if shape.handle == handle)
    if shape.kind == "ring":
        seen = shape.points[shape.front]
        x, y = seen[len(seen) // 5]
    else:
        x, y = shape.points.mean(axis=0)
    return float(x), float(y)


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("distance", [1.0, 50.0])
def test_handles_have_the_same_size_however_far_away(
    is_orthographic: bool, distance: float
) -> None:
    """Oracle: the closed form: an axis across the sight, in the middle, has its length."""
    camera = FreeCamera(eye=(0.0, 0.0, distance), is_orthographic=is_orthographic)
    for ratio in (1.0, 2.0):
        manipulator = Manipulator(matrix=np.eye(4), ratio=ratio)
        shapes = {each.handle: each for each in manipulator.shapes(projection(camera))}
        tip = shapes["x"].points[1]
        assert tip - (400.0, 300.0) == pytest.approx((LENGTH * ratio, 0.0))


@pytest.mark.parametrize("mode", ["translate", "rotate", "scale"])
@pytest.mark.parametrize("space", ["world", "local"])
def test_each_handle_is_hit_where_it_is_seen(mode: Mode, space: Space) -> None:
    """Oracle: points of its own shape; and nothing is hit far from all of them."""
    manipulator = Manipulator(matrix=placed(), mode=mode, space=space)
    expected = {"translate": {*AXES, *PLANES}, "rotate": {*AXES}, "scale": {*AXES}}[mode]
    shapes = manipulator.shapes(projection())
    assert {shape.handle for shape in shapes} == expected | {"view"}
    for shape in shapes:
        assert manipulator.hit(grip(manipulator, shape.handle), projection()) == shape.handle
    assert manipulator.hit((5.0, 5.0), projection()) is None


def test_an_axis_seen_from_its_end_and_a_plane_from_its_edge_cannot_be_hit() -> None:
    """Oracle: the closed form: a camera along z sees the xy plane alone."""
    manipulator = Manipulator(matrix=np.eye(4))
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    can = {each.handle for each in manipulator.shapes(projection(camera)) if each.can_be_hit}
    assert can == {"x", "y", "xy", "view"}


def test_the_far_side_of_a_ring_cannot_be_hit() -> None:
    """Oracle: a person's expectation: what is behind the ball is not what is grabbed."""
    manipulator = Manipulator(matrix=placed(), mode="rotate")
    shapes = {shape.handle: shape for shape in manipulator.shapes(projection())}
    ring = shapes["y"]
    hidden = ring.points[~ring.front]
    farthest = hidden[len(hidden) // 2]
    assert manipulator.hit((farthest[0], farthest[1]), projection()) != "y"


def test_nothing_is_seen_of_handles_behind_the_eye() -> None:
    """Oracle: the closed form."""
    matrix = np.eye(4)
    matrix[:3, 3] = np.array(CAMERA.eye) + projection().axes[2]
    manipulator = Manipulator(matrix=matrix)
    assert manipulator.shapes(projection()) == ()
    assert manipulator.hit((400.0, 300.0), projection()) is None


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("space", ["world", "local"])
@pytest.mark.parametrize("handle", AXES)
def test_a_drag_along_an_axis_keeps_it_under_the_pointer(
    is_orthographic: bool, space: Space, handle: Handle
) -> None:
    """Oracle: the closed form: a prim moved by d along the axis is seen where it was dragged to."""
    camera = replace(CAMERA, is_orthographic=is_orthographic)
    manipulator = Manipulator(matrix=placed(), space=space)
    axis = manipulator.axes[AXES.index(handle)]
    begun = manipulator.origin + 0.4 * axis
    drag = begin_drag(manipulator, handle, pixel_of(begun, camera), projection(camera))
    for distance in (0.3, -0.5, 1.0):
        found = drag(pixel_of(begun + distance * axis, camera))
        assert found[:3, 3] == pytest.approx(manipulator.origin + distance * axis)
        assert found[:3, :3] == pytest.approx(manipulator.matrix[:3, :3])


def test_a_pointer_beside_the_axis_counts_where_it_is_nearest_on_the_screen() -> None:
    """Oracle: the same drag with the pointer on the axis."""
    manipulator = Manipulator(matrix=placed())
    begun, end = (np.array(pixel_of(np.add(manipulator.origin, (d, 0.0, 0.0)))) for d in (0.2, 0.5))
    way = (end - begun) / np.linalg.norm(end - begun)
    beside = end + 60.0 * np.array((-way[1], way[0]))
    drag = begin_drag(manipulator, "x", (begun[0], begun[1]), projection())
    assert drag((beside[0], beside[1])) == pytest.approx(drag((end[0], end[1])))


@pytest.mark.parametrize("is_orthographic", [False, True])
@pytest.mark.parametrize("handle", [*PLANES, "view"])
def test_a_drag_on_a_plane_keeps_it_under_the_pointer(
    is_orthographic: bool, handle: Handle
) -> None:
    """Oracle: the closed form: both of its directions, and nothing across."""
    camera = replace(CAMERA, is_orthographic=is_orthographic)
    manipulator = Manipulator(matrix=placed(), space="local")
    kept = (
        projection(camera).axes[:2]
        if handle == "view"
        else np.delete(manipulator.axes, PLANES.index(handle), axis=0)
    )
    begun, shift = manipulator.origin + 0.1 * kept[0], np.array((0.2, -0.3)) @ kept
    drag = begin_drag(manipulator, handle, pixel_of(begun, camera), projection(camera))
    found = drag(pixel_of(begun + shift, camera))
    assert found[:3, 3] == pytest.approx(manipulator.origin + shift)


def test_a_drag_beyond_the_horizon_stays_where_it_was() -> None:
    """Oracle: the closed form: rays upwards never meet the ground."""
    camera = FreeCamera(eye=(0.0, 1.0, 5.0))
    manipulator = Manipulator(matrix=np.eye(4))
    begun = np.array((0.1, 0.0, 0.1))
    drag = begin_drag(manipulator, "zx", pixel_of(begun, camera), projection(camera))
    before = drag(pixel_of(np.add(begun, (1.0, 0.0, -1.0)), camera)).copy()
    assert before[:3, 3] == pytest.approx((1.0, 0.0, -1.0))
    assert drag((400.0, 1.0)) == pytest.approx(before)


@pytest.mark.parametrize("space", ["world", "local"])
@pytest.mark.parametrize("handle", AXES)
def test_a_ring_turns_by_the_angle_about_its_axis(space: Space, handle: Handle) -> None:
    """Oracle: Rodrigues' formula, over more than a whole turn in small steps."""
    manipulator = Manipulator(matrix=placed(), mode="rotate", space=space)
    axis = manipulator.axes[AXES.index(handle)]
    side = np.cross(axis, (0.3, 0.5, 0.8))
    side = 0.2 * side / np.linalg.norm(side)

    def at(angle: float) -> F64:
        return math.cos(angle) * side + math.sin(angle) * np.cross(axis, side)

    drag = begin_drag(manipulator, handle, pixel_of(manipulator.origin + at(0.0)), projection())
    for angle in np.linspace(0.2, 7.5, 38):
        found = drag(pixel_of(manipulator.origin + at(float(angle))))
        columns = manipulator.matrix[:3, :3]
        along = np.outer(axis, axis @ columns)
        expected = (
            along
            + math.cos(angle) * (columns - along)
            + math.sin(angle) * np.cross(axis, columns, axis=0)
        )
        assert found[:3, :3] == pytest.approx(expected)
        assert found[:3, 3] == pytest.approx(manipulator.origin)
    snapped = drag(pixel_of(manipulator.origin + at(7.5)), snaps=True)
    steps = math.radians(TURN) * round(7.5 / math.radians(TURN))
    assert snapped[:3, :3].T @ columns == pytest.approx(
        drag_free(manipulator, handle, steps)[:3, :3].T @ columns
    )


def drag_free(manipulator: Manipulator, handle: Handle, angle: float) -> F64:
    """The matrix turned by an angle, by the exponential series."""
    x, y, z = manipulator.axes[AXES.index(handle)] * angle
    generator = np.array([(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)])
    term, turn = np.eye(3), np.eye(3)
    for n in range(1, 60):
        term = term @ generator / n
        turn = turn + term
    result = manipulator.matrix.copy()
    result[:3, :3] = turn @ result[:3, :3]
    return result


def test_a_ring_seen_from_its_edge_turns_its_near_side_with_the_pointer() -> None:
    """Oracle: the closed form: a radius of pixels is a radian, to the right about +y."""
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    manipulator = Manipulator(matrix=np.eye(4), mode="rotate")
    drag = begin_drag(manipulator, "y", (400.0, 300.0), projection(camera))
    found = drag((400.0 + RING * LENGTH, 300.0))
    assert found[:3, 2] == pytest.approx((math.sin(1.0), 0.0, math.cos(1.0)))


def test_the_outer_ring_turns_in_the_picture() -> None:
    """Oracle: the closed form: a quarter round the middle takes right to up."""
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    manipulator = Manipulator(matrix=np.eye(4), mode="rotate")
    drag = begin_drag(manipulator, "view", (500.0, 300.0), projection(camera))
    assert drag((400.0, 200.0))[:3, 0] == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("space", ["world", "local"])
@pytest.mark.parametrize("handle", AXES)
def test_a_drag_of_a_scale_multiplies_the_prims_own_axis(space: Space, handle: Handle) -> None:
    """Oracle: the closed form: where the pointer is, over where it began."""
    manipulator = Manipulator(matrix=placed(), mode="scale", space=space)
    i = AXES.index(handle)
    axis = manipulator.axes[i]
    drag = begin_drag(manipulator, handle, pixel_of(manipulator.origin + 0.3 * axis), projection())
    factors = np.ones(3)
    factors[i] = 1.7
    found = drag(pixel_of(manipulator.origin + 0.51 * axis))
    assert found[:3, :3] == pytest.approx(manipulator.matrix[:3, :3] * factors)
    factors[i] = 17 * SCALE
    found = drag(pixel_of(manipulator.origin + 0.52 * axis), snaps=True)
    assert found[:3, :3] == pytest.approx(manipulator.matrix[:3, :3] * factors)
    through = drag(pixel_of(manipulator.origin - 0.2 * axis))
    assert np.linalg.det(through[:3, :3]) > 0, "never turned inside out"


def test_the_middle_scales_all_axes_alike() -> None:
    """Oracle: the closed form: twice as large for each length to the right or up."""
    manipulator = Manipulator(matrix=placed(), mode="scale")
    drag = begin_drag(manipulator, "view", (300.0, 300.0), projection())
    found = drag((300.0 + LENGTH, 300.0 - LENGTH))
    assert found[:3, :3] == pytest.approx(4.0 * manipulator.matrix[:3, :3])


def test_a_snapping_move_goes_in_whole_steps() -> None:
    """Oracle: whole multiples of 1, 2 or 5 times a power of ten."""
    manipulator = Manipulator(matrix=placed())
    step = snapping_step(manipulator.length(projection()))
    begun = np.add(manipulator.origin, (0.1, 0.0, 0.1))
    drag = begin_drag(manipulator, "zx", pixel_of(begun), projection())
    shift = np.array((2.3 * step, 0.0, -1.6 * step))
    found = drag(pixel_of(begun + shift), snaps=True)
    assert found[:3, 3] - manipulator.origin == pytest.approx((2 * step, 0.0, -2 * step))


@pytest.mark.parametrize(
    ("length", "step"), [(1.0, 0.1), (19.0, 2.0), (55.0, 5.0), (0.092, 0.01), (3e-5, 2e-6)]
)
def test_a_step_is_round_and_about_a_tenth_of_a_handle(length: float, step: float) -> None:
    """Oracle: by hand."""
    assert snapping_step(length) == pytest.approx(step)


@pytest.mark.parametrize(
    ("mode", "handle", "words"),
    [
        ("translate", "x", "X +0.5"),
        ("translate", "zx", "X +0.5   Z -0.25"),
        ("rotate", "z", "Z +30.0°"),
        ("scale", "y", "Y ×1.500"),
        ("scale", "view", "×2.000"),
    ],
)
def test_a_drag_says_what_it_changes(mode: Mode, handle: Handle, words: str) -> None:
    """Oracle: the numbers of the drag, by hand; nothing before it moves."""
    manipulator = Manipulator(matrix=np.eye(4), mode=mode)
    ends = {
        ("translate", "x"): ((0.4, 0.0, 0.0), (0.9, 0.0, 0.0)),
        ("translate", "zx"): ((0.1, 0.0, 0.1), (0.6, 0.0, -0.15)),
        ("rotate", "z"): ((0.3, 0.0, 0.0), (0.3 * math.cos(math.pi / 6), 0.15, 0.0)),
        ("scale", "y"): ((0.0, 0.4, 0.0), (0.0, 0.6, 0.0)),
    }
    begun, ended = (
        (pixel_of(np.array(point)) for point in ends[mode, handle])
        if (mode, handle) in ends
        else ((300.0, 300.0), (300.0 + LENGTH, 300.0))
    )
    drag = begin_drag(manipulator, handle, begun, projection())
    assert drag.words == ""
    drag(ended)
    assert drag.words == words


def test_a_turn_in_the_picture_counts_as_the_user_sees_it() -> None:
    """Oracle: a quarter from right to up is counter-clockwise."""
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    manipulator = Manipulator(matrix=np.eye(4), mode="rotate")
    drag = begin_drag(manipulator, "view", (500.0, 300.0), projection(camera))
    drag((400.0, 200.0))
    assert drag.words == "+90.0°"


@pytest.mark.parametrize("up", [3.0, -3.0])
def test_a_turn_that_snaps_to_zero_says_so_without_a_sign(up: float) -> None:
    """Oracle: by hand: three pixels up or down are far below a step; zero is "+0.0" either way."""
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    manipulator = Manipulator(matrix=np.eye(4), mode="rotate")
    drag = begin_drag(manipulator, "view", (500.0, 300.0), projection(camera))
    drag((500.0, 300.0 - up), snaps=True)
    assert drag.words == "+0.0°"


def test_a_small_turn_is_rounded_to_zero_without_a_sign() -> None:
    """Oracle: by hand: a thousandth of a pixel at a radius of 100 is less than 0.001 degrees."""
    camera = FreeCamera(eye=(0.0, 0.0, 9.0))
    manipulator = Manipulator(matrix=np.eye(4), mode="rotate")
    drag = begin_drag(manipulator, "view", (500.0, 300.0), projection(camera))
    drag((500.0, 300.001))
    assert drag.words == "+0.0°"


def test_a_matrix_crosses_as_sixteen_numbers_row_by_row() -> None:
    """Oracle: `specs.Matrix`: row-major, for column vectors."""
    assert as_matrix(placed())[3::4] == pytest.approx((0.9, -0.1, 1.3, 1.0))
