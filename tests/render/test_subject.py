"""Tests of what automatic cameras frame."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.render.rendering import scene_of
from usdsplat.core.cloud import SplatCloud
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec
from usdsplat.render.subject import FILL, MOST, joined, of_box, of_points

WINDOW = (0.8, 0.45)
"""Half of the width and of the height of a picture at distance 1."""
FRONT = np.eye(3)
"""Directions of a camera that looks along -z."""
WITHIN = 0.01
"""Relative error of a distance that other random splats make."""


def cloud(positions, *, size=0.02, opacity=0.9):
    n = len(positions)
    return SplatCloud(
        positions=np.asarray(positions, np.float32),
        scales=np.full((n, 3), size, np.float32),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, opacity, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def both(*clouds):
    """All splats in one cloud."""
    names = ("positions", "scales", "rotations", "opacities", "sh")
    return SplatCloud(
        **{name: np.concatenate([getattr(each, name) for each in clouds]) for name in names}
    )


def block(n=6000, *, low=(-1, -1, -1), high=(1, 1, 1), seed=0, **more):
    return cloud(np.random.default_rng(seed).uniform(low, high, (n, 3)), **more)


def framed(*clouds, **more):
    return scene_of(*((each, np.eye(4)) for each in clouds)).seen().frame(FRONT, WINDOW, **more)


def span(points, target, distance):
    """Parts of the half picture that points reach to the right, left, up and down."""
    x, y, z = (np.asarray(points, np.float64) - target).T
    across, along = x / (distance - z) / WINDOW[0], y / (distance - z) / WINDOW[1]
    return across.max(), -across.min(), along.max(), -along.min()


@pytest.mark.parametrize("seed", range(4))
def test_points_fill_the_picture_exactly(seed):
    """Oracle: the pinhole projection: in one direction both edges are at the margin, in the other
    none is beyond and both are as far from it."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3)) * rng.uniform(0.3, 2, 3) + rng.normal(size=3) * 10
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    target, distance = of_points(points).frame(turn, WINDOW)
    right, left, above, below = span(points @ turn.T, turn @ target, distance)
    assert max(right, left, above, below) == pytest.approx(FILL)
    pairs = (right, left), (above, below)
    assert any(pair == pytest.approx((FILL, FILL)) for pair in pairs)
    depths = distance - ((points - target) @ turn.T)[:, 2]
    assert depths.min() > 0 and depths.max() + depths.min() == pytest.approx(2 * distance)


def test_an_orthographic_camera_frames_by_extents():
    """Oracle: the closed form: a box of 4 by 1 in a window of 16 to 9."""
    box = np.array([1.0, 2.0, 3.0]), np.array([5.0, 3.0, 9.0])
    target, distance = of_box(box).frame(FRONT, WINDOW, is_orthographic=True)
    assert target == pytest.approx((3.0, 2.5, 6.0))
    assert distance * WINDOW[0] * FILL == pytest.approx(2.0)


def test_a_point_has_no_distance_that_frames_it():
    """Oracle: the point itself."""
    target, distance = of_points(np.array([[1.0, -2.0, 1e4]])).frame(FRONT, WINDOW)
    assert target == pytest.approx((1.0, -2.0, 1e4)) and distance == 0.0


def test_a_pole_that_points_at_the_eye_is_not_touched():
    """Oracle: the closed form: a quarter of its depth in front of it."""
    pole = np.array([-0.001, -0.001, -2.0]), np.array([0.001, 0.001, 2.0])
    target, distance = of_box(pole).frame(FRONT, WINDOW)
    assert target == pytest.approx((0, 0, 0)) and distance == pytest.approx(2 + 0.25 * 4)


def test_a_block_of_splats_fills_the_picture():
    """Oracle: the projection of its centres, of which one at most may be outside; their own size is
    a hundredth of the block."""
    solid = block()
    target, distance = framed(solid)
    _, _, above, below = span(solid.positions, target, distance)
    assert (above, below) == pytest.approx((FILL, FILL), abs=0.03)


@pytest.mark.parametrize(
    "floaters",
    [
        block(200, low=(-9, -9, -9), high=(9, 9, 9), seed=1, size=0.05, opacity=0.3),
        block(40, low=(-30, -30, -30), high=(30, 30, 30), seed=2, size=0.2),
        block(3000, low=(-5, -5, -5), high=(5, 5, 5), seed=3, size=0.3, opacity=0.004),
    ],
    ids=["faint", "far", "haze"],
)
def test_floaters_do_not_matter(floaters):
    """Oracle: the camera of the block without them."""
    target, distance = framed(block())
    found, at = framed(both(block(), floaters))
    assert at == pytest.approx(distance, rel=4 * WITHIN)
    assert found == pytest.approx(target, abs=0.1)


def place():
    """The block, with ground a hundred times as far, which is thinner there, and a sky farther."""
    rng = np.random.default_rng(5)
    far = np.exp(rng.normal(0.5, 1.2, 4000))
    angle = rng.uniform(0, 2 * np.pi, 4000)
    ground = cloud(np.stack([far * np.cos(angle), np.full(4000, -1.0), far * np.sin(angle)], 1))
    ground = SplatCloud(
        positions=ground.positions, rotations=ground.rotations, opacities=ground.opacities,
        scales=np.float32(0.05) * np.repeat(far[:, None], 3, 1).astype(np.float32), sh=ground.sh,
    )  # fmt: skip
    sky = rng.normal(size=(1500, 3))
    sky = cloud(400 * sky / np.linalg.norm(sky, axis=1, keepdims=True), size=20)
    return both(block(), ground, sky)


def test_ground_and_sky_of_a_place_are_background():
    """Oracle: the distance: the camera is not much farther away than the block alone needs."""
    _, alone = framed(block())
    _, distance = framed(place())
    assert distance < 8 * alone


@pytest.mark.parametrize("subject", ["points", "splats"])
def test_the_extent_is_what_an_orthographic_camera_frames(subject):
    """Oracle: `frame` of orthographic cameras: its target, and the distance of a window that is
    narrow, and of one that is low."""
    seen = (
        of_points(block().positions)
        if subject == "points"
        else scene_of((block(), np.eye(4))).seen()
    )
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    middle, half = seen.extent(turn)
    target, wide = seen.frame(turn, (1e-6, 1), is_orthographic=True)
    _, high = seen.frame(turn, (1, 1e-6), is_orthographic=True)
    assert middle == pytest.approx(target, abs=1e-6)
    assert half[:2] == pytest.approx((FILL * 1e-6 * wide, FILL * 1e-6 * high))
    assert middle == pytest.approx((0, 0, 0), abs=0.1) and half[2] == pytest.approx(1.5, abs=0.4)


@pytest.mark.parametrize("subject", ["points", "splats"])
def test_the_width_is_that_of_the_picture_that_is_filled(subject):
    """Oracle: the camera of a window in which the width alone decides."""
    seen = (
        of_points(block().positions)
        if subject == "points"
        else scene_of((block(), np.eye(4))).seen()
    )
    target, distance = seen.frame(FRONT, (0.3, 100))
    eye = target + distance * FRONT[2]
    assert seen.half_width(FRONT, eye) == pytest.approx(FILL * 0.3, rel=0.01)
    assert seen.half_width(FRONT, np.zeros(3)) == np.inf


def test_nothing_is_framed_at_the_origin():
    """Oracle: the docstrings, for points of which none is finite."""
    nothing = of_points(np.full((1, 3), np.nan))
    target, distance = nothing.frame(FRONT, WINDOW)
    assert target.tolist() == [0, 0, 0] and distance == 0.0
    assert [each.tolist() for each in nothing.extent(FRONT)] == [[0, 0, 0]] * 2
    assert nothing.half_width(FRONT, np.ones(3)) == 0.0


def test_thin_parts_are_not_cut_off():
    """Oracle: the tip of a rod on a block, with few of the splats and three times as long, is
    inside."""
    rod = cloud(np.linspace([0, 1, 0], [0, 7, 0], 100), size=0.03)
    target, distance = framed(both(block(), rod))
    _, _, above, below = span([[0, 7, 0], [0, -1, 1]], target, distance)
    assert 0.8 < above < 0.95 and 0.8 < below < 0.95


def test_dense_parts_do_not_hide_sparse_ones():
    """Oracle: a body that is as sparse as it is long is inside, below a head of most splats."""
    head = block(10000, low=(-0.1, -0.1, -0.1), high=(0.1, 0.1, 0.1), size=0.01)
    body = block(1500, low=(-0.2, -2, -0.2), high=(0.2, -0.1, 0.2), seed=1, size=0.05)
    target, distance = framed(both(head, body))
    _, _, above, below = span([[0, 0.1, 0], [0, -2, 0]], target, distance)
    assert 0.75 < above < 0.95 and 0.75 < below < 0.95


def test_a_small_field_far_away_is_framed_too():
    """Oracle: the projection: both are inside, although the small one has a thousandth of the
    area."""
    small = block(200, low=(19.95, -0.05, -8.05), high=(20.05, 0.05, -7.95), seed=1, size=0.005)
    target, distance = framed(block(), small)
    right, left, _, _ = span([[20.05, 0, -8], [-1, 0, 0]], target, distance)
    assert 0.8 < right < 0.95 and 0.8 < left < 0.95


def test_what_crops_remove_is_not_framed():
    """Oracle: the camera of what is left."""
    scene = scene_of((both(block(), block(low=(9, -1, -1), high=(11, 1, 1))), np.eye(4)))
    ball = np.diag([0.2, 0.2, 0.2, 1.0])
    scene.set_crops(
        "/field0", (CropSpec(shape="sphere", world_to_shape=tuple(ball.ravel()), keeps=True),)
    )
    target, distance = framed(block())
    found, at = scene.seen().frame(FRONT, WINDOW)
    assert at == pytest.approx(distance, rel=WITHIN) and found == pytest.approx(target, abs=0.02)


def test_transforms_are_followed_and_what_is_not_finite_is_left_out():
    """Oracle: the same splats in place."""
    matrix = np.array([[0, -2, 0, 5], [2, 0, 0, 1], [0, 0, 2, 3], [0, 0, 0, 1.0]])
    there = block()
    expected = framed(cloud(there.positions @ matrix[:3, :3].T + matrix[:3, 3], size=0.04))
    broken = cloud(np.array([[np.nan, 0, 0], [np.inf, 0, 0]]))
    target, distance = scene_of((both(there, broken), matrix)).seen().frame(FRONT, WINDOW)
    assert distance == pytest.approx(expected[1], rel=1e-5)
    assert target == pytest.approx(expected[0], abs=1e-4)


@pytest.mark.parametrize(
    "odd",
    [cloud(np.zeros((5, 3)), size=0.0), cloud(np.eye(3), size=0.0), block(3, opacity=0.001)],
    ids=["a point", "three points", "hardly visible"],
)
def test_odd_clouds_have_a_camera(odd):
    """Oracle: finite numbers."""
    target, distance = framed(odd)
    assert np.isfinite(target).all() and 0 <= distance < 1e3


def test_nothing_has_no_subject():
    """Oracle: the empty scene, and splats that are transparent."""
    assert scene_of().seen() is None
    assert scene_of((block(opacity=0.0), np.eye(4))).seen() is None
    assert joined([None, of_points(np.empty((0, 3)))]) is None


def test_many_instances_are_framed_by_some():
    """Oracle: the corners of a lattice of 40,000 blocks, each of which is small; the number of
    splats, and the number that they stand for."""
    scene = scene_of((block(100, low=(-0.2,) * 3, high=(0.2,) * 3), np.eye(4)))
    instances = []
    for x, y in itertools.product(range(200), repeat=2):
        matrix = np.eye(4)
        matrix[:2, 3] = x - 99.5, 0.5 * (y - 99.5)
        instances.append(InstanceSpec(path="/field0", transform=tuple(matrix.ravel())))
    scene.set_instances("/field0", tuple(instances))
    seen = scene.seen()
    assert 0.8 * MOST < len(seen.centers) < 1.5 * MOST
    assert seen.counts.sum() == pytest.approx(100 * len(instances), rel=0.2)
    middle, half = seen.extent(FRONT)
    assert middle[:2] == pytest.approx((0, 0), abs=2)
    assert half[:2] == pytest.approx((99.7, 49.95), rel=0.03)


def test_joined_subjects_are_no_larger_than_one():
    """Oracle: the camera of all of them, of which each is at another place; the number of splats,
    and the number that they stand for."""
    parts = [block(20_000, low=(x, 0, 0), high=(x + 1, 1, 1), seed=x) for x in range(8)]
    whole = joined(scene_of((part, np.eye(4))).seen() for part in parts)
    assert 0.8 * MOST < len(whole.centers) < 1.5 * MOST
    assert whole.counts.sum() == pytest.approx(160_000)
    assert len(np.unique(whole.owners)) == 8
    target, distance = framed(block(160_000, low=(0, 0, 0), high=(8, 1, 1)))
    found, at = whole.frame(FRONT, WINDOW)
    assert at == pytest.approx(distance, rel=2 * WITHIN)
    assert found == pytest.approx(target, abs=0.05)


def test_a_thinned_subject_has_something_of_each_owner():
    """Oracle: the numbers by hand."""
    whole = joined([scene_of((block(n), np.eye(4))).seen() for n in (1, 5, 12)])
    few = whole.thinned(5)
    assert np.bincount(few.owners).tolist() == [1, 1, 3]
    assert np.bincount(few.owners, few.counts).tolist() == [1, 5, 12]
    assert whole.thinned(1) is whole


MOVED = np.array([[1.0, 0, 0, 7], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
BALL = CropSpec(
    shape="sphere", world_to_shape=tuple(np.diag([2.0, 2.0, 2.0, 1.0]).ravel()), keeps=True
)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (lambda scene: scene.set_field("/field0", FieldSpec(cloud=block(high=(3, 1, 1)))),
         scene_of((block(high=(3, 1, 1)), np.eye(4)))),
        (lambda scene: scene.set_instances(
            "/field0", (InstanceSpec(path="/field0", transform=tuple(MOVED.ravel())),)),
         scene_of((block(), MOVED))),
        (lambda scene: scene.set_crops("/field0", (BALL,)), None),
        (lambda scene: scene.set_visible("/field0", False), scene_of()),
    ],
    ids=["field", "instances", "crops", "visible"],
)  # fmt: skip
def test_an_edit_is_seen(edit, expected):
    """Oracle: a new scene with what was edited; of a ball that keeps half of a block, the size.
    Without an edit the same object is returned."""
    scene = scene_of((block(), np.eye(4)))
    before = scene.seen()
    assert scene.seen() is before
    edit(scene)
    if expected is None:
        assert scene.seen().extent(FRONT)[1].max() == pytest.approx(0.5, abs=0.05)
    elif expected.seen() is None:
        assert scene.seen() is None
    else:
        target, distance = expected.seen().frame(FRONT, WINDOW)
        found, at = scene.seen().frame(FRONT, WINDOW)
        assert found.tolist() == target.tolist() and at == distance
        assert found.tolist() != before.frame(FRONT, WINDOW)[0].tolist()


def test_prims_are_framed_by_their_paths():
    """Oracle: the camera of the scene with one field; a path that is only the beginning of a name
    is none of a prim."""
    scene = scene_of((block(), np.eye(4)), (block(low=(5, 5, 5), high=(6, 6, 6)), np.eye(4)))
    target, distance = framed(block())
    found, at = scene.seen(("/field0",)).frame(FRONT, WINDOW)
    assert at == pytest.approx(distance, rel=WITHIN) and found == pytest.approx(target, abs=0.02)
    assert scene.seen(("/",)).frame(FRONT, WINDOW)[1] == scene.seen().frame(FRONT, WINDOW)[1]
    assert scene.seen(("/field",)) is None
