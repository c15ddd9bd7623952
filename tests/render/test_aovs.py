"""Tests of AOVs, in scenes small enough to compute every number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.folded import folded
from tests.images.exr_file import ExrFile
from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    random_transform,
    scene_of,
    settings_of,
    view_of,
)
from tests.render.surface_scenes import add, mesh
from usdsplat.core.cloud import SplatCloud
from usdsplat.images.cryptomatte import object_hash
from usdsplat.images.exr import ExrWriter
from usdsplat.images.layout import ImageLayout
from usdsplat.kernels import reference
from usdsplat.kernels.devices import open_device
from usdsplat.render.renderer import Renderer

SIZE = (61, 45)
MIDDLE = (22, 30)
"""Row and column of the pixel whose ray is the camera's axis."""
ORDERS = ["zDepth", "rayHitDistance"]


def eye(model="perspective"):
    """Looks along z, from 4 before the origin; x goes right and y down, as in the world."""
    focal = (10.0, 11.0) if model == "orthographic" else (60.0, 64.0)
    return replace(lens(model), size=SIZE, focal=focal, center=(30.5, 22.5))


def splats(positions, opacities, *, scales=(0.3, 0.3, 0.3), rotations=None, ids=None) -> SplatCloud:
    n = len(positions)
    turns = np.broadcast_to([1.0, 0, 0, 0], (n, 4)) if rotations is None else rotations
    return SplatCloud(
        positions=np.float32(positions),
        scales=np.array(np.broadcast_to(scales, (n, 3)), np.float32),
        rotations=np.array(turns, np.float32),
        opacities=np.broadcast_to(np.float32(opacities), n).copy(),
        sh=np.ones((n, 1, 3), np.float32),
        ids=ids,
    )


def wall(z, half=9.0, **options):
    """A square that faces the camera."""
    x, y = np.array([-half, half, half, -half]), np.array([-half, -half, half, half])
    points = np.stack([x, y, np.full(4, z)], axis=1)
    return mesh(points, [[0, 1, 2], [0, 2, 3]], **options)


def moved(by) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


# --- depth -------------------------------------------------------------------------------

STACK = splats([(0, 0, -1), (0, 0, 0), (0, 0, 1)], (0.3, 0.4, 0.5))
"""Depths 3, 4 and 5; they let 0.7, 0.42 and 0.21 through: half of 0.79 is passed at the second."""
MEAN = (0.3 * 3 + 0.7 * 0.4 * 4 + 0.42 * 0.5 * 5) / 0.79


@pytest.mark.parametrize("sorting", ORDERS)
@pytest.mark.parametrize("model", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("cloud", "surface", "median", "front", "expected", "element"),
    [
        (STACK, None, 4, 3, MEAN, 1),
        (STACK, 6, 4, 3, 0.79 * MEAN + 0.21 * 6, 1),
        (STACK, 4.5, 4, 3, 0.3 * 3 + 0.28 * 4 + 0.42 * 4.5, 1),
        (STACK, 3.5, 3.5, 3, 0.3 * 3 + 0.7 * 3.5, 1234),
        (STACK, 2, 2, 2, 2, 1234),
        (splats([(0, 0, -1), (0, 0, 1)], (0.1, 0.999)), None, 5, 3, None, 1),
        (splats([(0, 0, -1), (0, 0, 1)], (0.6, 0.9)), 9, 3, 3, None, 0),
        (splats([(0, 0, 2)], (0.003,)), None, np.inf, np.inf, np.inf, -1),
    ],
)
def test_depths_of_a_stack(model, sorting, cloud, surface, median, front, expected, element):
    """Median, first and mean depth along the axis. Oracle: transmittances, worked out by hand."""
    scene = scene_of((cloud, np.eye(4)))
    if surface is not None:
        add(scene, "/wall", wall(surface - 4, faces=np.int32([1234, 1234])))
    aovs = ("depth", "depthFront", "depthExpected", "elementId", "primId", "color")
    found = picture(scene, view_of(eye(model)), sorting=sorting, aovs=aovs)
    at = {name: found[name][MIDDLE] for name in aovs}
    assert at["depth"] == pytest.approx(median, rel=1e-6)
    assert at["depthFront"] == pytest.approx(front, rel=1e-6)
    if expected is not None:
        assert at["depthExpected"] == pytest.approx(expected, rel=1e-5)
    assert at["elementId"] == element
    assert at["primId"] == (-1 if element < 0 else element == 1234)


@pytest.mark.parametrize("sorting", ORDERS)
def test_half_of_what_is_left_by_a_matte_is_the_median(sorting: str) -> None:
    """A splat in front of a wall, both behind a matte splat of opacity 0.9. Oracle: of the coverage
    of 0.1 the splat has 0.06, so it is what is seen; by hand."""
    near, far = splats([(0, 0, -1)], 0.9), splats([(0, 0, 0)], 0.6)
    scene = add(scene_of((near, np.eye(4)), (far, np.eye(4))), "/wall", wall(1))
    view = replace(view_of(eye()), matte=(("/field0", True),))
    found = picture(scene, view, sorting=sorting, aovs=("depth", "primId", "color"))
    assert found["color"][MIDDLE][3] == pytest.approx(0.1, abs=1e-6)
    assert found["primId"][MIDDLE] == 1
    assert found["depth"][MIDDLE] == pytest.approx(4)


# --- normals and places ------------------------------------------------------------------


@pytest.mark.parametrize("model", ["perspective", "orthographic"])
@pytest.mark.parametrize("seed", folded(range(6)))
def test_normals_are_those_of_flat_discs(seed: int, model: str) -> None:
    """In turned, mirrored and sheared fields. Oracle: the eigenvector of the least eigenvalue of
    the covariance in camera space, on the side of the eye."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(1, 4))
    matrix = random_transform(seed + 20)
    place = np.array([0.4, 0.2, 0.1])
    matrix[:3, 3] = place - matrix[:3, :3] @ place
    cloud = splats(
        [place], 0.9, scales=(0.3, 3e-4, 0.2), rotations=q / np.linalg.norm(q)
    )  # fmt: skip
    found = picture(scene_of((cloud, matrix)), view_of(eye(model)), aovs=("Neye", "color"))
    seen = reference.footprints([(cloud, matrix)], eye(model))
    normal = np.linalg.eigh(seen.covariance[0])[1][:, 0]
    sight = np.array([0, 0, 1.0]) if model == "orthographic" else seen.camera[0]
    normal *= -np.sign(normal @ sight)
    normal *= (1, -1, -1)  # USD's camera space: y up, z towards the eye
    there = found["color"][..., 3] > 0
    assert there.any()
    np.testing.assert_allclose(found["Neye"][there], np.tile(normal, (there.sum(), 1)), atol=2e-3)
    assert (found["Neye"][~there] == 0).all()


@pytest.mark.parametrize("model", ["perspective", "orthographic"])
def test_what_a_transform_flattens_is_a_picture_on_a_plane(model: str) -> None:
    """Splats in a field without thickness. Oracle: the plane that the matrix has made of space: its
    normal, and where pixels' rays meet it."""
    matrix = moved((0, 0, 0.2))
    matrix[:3, :3] = [[1, 0, 0], [0, 1, 0], [0.5, 0, 0]]
    cloud = splats([(0, 0, 0), (0.3, 0.2, 7), (-0.4, -0.2, 9)], 0.999, scales=(0.2, 0.2, 0.1))
    options = {"sorting": "rayHitDistance", "aovs": ("Neye", "P", "depth", "color")}
    found = picture(scene_of((cloud, matrix)), view_of(eye(model)), **options)
    solid = found["color"][..., 3] > 0.05
    assert solid.mean() > 0.02
    p = found["P"][solid] + (0, 0, 4)
    np.testing.assert_allclose(p[:, 2], 4.2 + 0.5 * p[:, 0], atol=1e-3)
    normal = np.array([0.5, 0, 1]) / np.sqrt(1.25)
    np.testing.assert_allclose(found["Neye"][solid], np.tile(normal, (solid.sum(), 1)), atol=1e-4)


def test_normals_of_splats_and_a_surface_mix_by_weight() -> None:
    """Oracle: a disc of opacity 0.5 before a wall: the sum of both normals, made unit."""
    half = np.radians(40) / 2
    turn = [[np.cos(half), 0, np.sin(half), 0]]  # about y: the normal is (sin 40, 0, cos 40)
    cloud = splats([(0, 0, 0)], 0.5, scales=(0.5, 0.5, 1e-4), rotations=turn)
    scene = add(scene_of((cloud, np.eye(4))), "/wall", wall(1))
    found = picture(scene, view_of(eye()), aovs=("Neye",))["Neye"][MIDDLE]
    normal = 0.5 * np.array([-np.sin(2 * half), 0, np.cos(2 * half)]) + 0.5 * np.array([0, 0, 1])
    np.testing.assert_allclose(found, normal / np.linalg.norm(normal), atol=1e-5)


@pytest.mark.parametrize("model", ["perspective", "orthographic"])
def test_positions_lie_on_what_is_seen(model: str) -> None:
    """Of a tilted plane, from a camera that stands anywhere. Oracle: the plane's equation, and the
    pixel's own ray; 0 where nothing is."""
    x, y = np.array([-1.0, 1, 1, -1]), np.array([-0.8, -0.8, 0.8, 0.8])
    plane = mesh(np.stack([x, y, 0.3 * x - 0.2 * y], 1), [[0, 1, 2], [0, 2, 3]])
    scene = add(scene_of(), "/plane", plane)
    turn = 0.4
    view = np.eye(4)
    view[:3, :3] = [
        [np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]
    ]  # fmt: skip
    view[:3, 3] = (0.2, -0.1, 4.0)
    here = replace(eye(model), world_to_camera=view)
    found = picture(scene, view_of(here), aovs=("P", "depth"))
    there = np.isfinite(found["depth"])
    assert 0.05 < there.mean() < 0.95
    p = found["P"][there].astype(np.float64)
    np.testing.assert_allclose(p[:, 2], 0.3 * p[:, 0] - 0.2 * p[:, 1], atol=2e-5)
    camera = p @ view[:3, :3].T + view[:3, 3]
    scale = 1.0 if model == "orthographic" else camera[:, 2:]
    pixel = camera[:, :2] / scale * here.focal + here.center
    rows, columns = np.nonzero(there)
    np.testing.assert_allclose(pixel, np.stack([columns, rows], 1) + 0.5, atol=2e-3)
    assert (found["P"][~there] == 0).all()


def test_albedo_is_the_picture_without_view_dependence() -> None:
    """Oracle: the colour of the same cloud cut to degree 0."""
    cloud, matrix = random_cloud(1), random_transform(2)
    plain = replace(cloud, sh=cloud.sh[:, :1].copy())
    for options in ({}, {"blend_space": "linear", "color_mode": "scene"}):
        found = picture(
            scene_of((cloud, matrix)), view_of(eye()), aovs=("albedo", "color"), **options
        )
        expected = picture(scene_of((plain, matrix)), view_of(eye()), aovs=("color",), **options)
        np.testing.assert_allclose(found["albedo"], expected["color"][..., :3], atol=1e-6)
        assert np.abs(found["albedo"] - found["color"][..., :3]).max() > 0.1


def test_only_colour_counts_among_the_pixels_that_a_view_cannot_show() -> None:
    """Oracle: the same counts whether the albedo is asked for or not."""
    renderer = Renderer(open_device())
    scene = scene_of((random_cloud(1), np.eye(4)))
    settings = settings_of(color_mode="inverseView", inverse_max=1.0)
    counts = []
    for aovs in (("color",), ("color", "albedo")):
        list(renderer.render(scene, view_of(eye()), settings, aovs))
        counts.append((renderer.stats.failed, renderer.stats.asked))
    assert counts[0] == counts[1]
    assert counts[0][1] > 0


# --- motion ------------------------------------------------------------------------------

MOTION = ("motionForward", "motionBackward", "depth", "primId", "elementId")


def test_what_a_prim_moves() -> None:
    """Splats and a wall behind them go different ways. Oracle: f·d/z pixels, v upwards."""
    cloud, view = splats([(0.1, 0.1, 0.0), (-0.5, 0.2, 0.5)], 0.999, scales=0.2), view_of(eye())

    def sampler(time):
        scene = scene_of((cloud, moved((0.2 * time, 0.1 * time, 0))))
        return add(scene, "/wall", wall(2), moved((-0.3 * time, 0, 0))), view

    found = picture(sampler(0)[0], view, aovs=MOTION, sampler=sampler)
    splat = found["primId"] == 0
    assert 0.01 < splat.mean() < 0.5
    z = found["depth"]
    u = np.where(splat, 60 * 0.2 / z, 60 * -0.3 / 6)
    v = np.where(splat, -64 * 0.1 / z, 0)
    for name in MOTION[:2]:
        np.testing.assert_allclose(found[name], np.stack([u, v], -1), atol=1e-4)


def test_what_a_camera_moves() -> None:
    """Everything, the further the less; going along its axis the more outward. Oracle: the
    perspective projection of the point that is seen."""
    scene = add(scene_of((splats([(0.2, 0.1, 0)], 0.999), np.eye(4))), "/wall", wall(3))
    here = eye()

    def sampler(time):
        moving = np.eye(4)
        moving[:3, 3] = (-0.1 * time, 0.2 * time, 4.0 - 0.5 * time)
        return scene, view_of(replace(here, world_to_camera=moving))

    found = picture(scene, view_of(here), aovs=MOTION, sampler=sampler)
    z = found["depth"].astype(np.float64)
    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    x, y = (columns - 30.5) / 60 * z, (rows - 22.5) / 64 * z
    for name, time in (("motionForward", 1), ("motionBackward", -1)):
        u = 60 * (x - 0.1 * time) / (z - 0.5 * time) + 30.5
        v = 64 * (y + 0.2 * time) / (z - 0.5 * time) + 22.5
        expected = time * np.stack([u - columns, rows - v], -1)
        np.testing.assert_allclose(found[name], expected, atol=1e-4)


def test_splats_are_known_again_by_their_ids() -> None:
    """Samples in another order, where each splat has gone its own way. Oracle: f·d/z of each."""
    start = np.array([(-0.6, 0, 0), (0.5, 0.1, 1), (0, -0.5, 2)])
    steps = np.array([(0.1, 0, 0), (0, 0.2, 0), (-0.1, -0.1, 0.0)])
    view = view_of(eye())

    def sampler(time):
        order = [0, 1, 2] if time == 0 else [2, 0, 1]
        ids = np.array([70, 5, 9], np.int64)[order]
        cloud = splats((start + time * steps)[order], 0.999, scales=0.15, ids=ids)
        return scene_of((cloud, np.eye(4))), view

    found = picture(sampler(0)[0], view, aovs=MOTION, sampler=sampler)
    element, z = found["elementId"], found["depth"]
    assert set(np.unique(element)) == {-1, 0, 1, 2}
    step = steps[element]
    with np.errstate(invalid="ignore"):
        expected = np.stack([60 * step[..., 0] / z, -64 * step[..., 1] / z], -1)
    expected[element < 0] = 0
    for name in MOTION[:2]:
        np.testing.assert_allclose(found[name], expected, atol=1e-4)


def test_a_mesh_that_deforms_moves_within_itself() -> None:
    """A wall that widens by a tenth in each frame. Oracle: pixels move by a tenth of their own
    distance from the axis, sideways."""
    view = view_of(eye())

    def sampler(time):
        made = wall(0)
        points = made.points * np.float32([1 + 0.1 * time, 1, 1])
        return add(scene_of(), "/wall", replace(made, points=points)), view

    found = picture(sampler(0)[0], view, aovs=MOTION, sampler=sampler)
    u = 0.1 * np.broadcast_to(np.arange(SIZE[0]) - 30.0, SIZE[::-1])
    expected = np.stack([u, np.zeros_like(u)], -1)
    for name in MOTION[:2]:
        np.testing.assert_allclose(found[name], expected, atol=1e-4)


# --- Cryptomatte and ids -----------------------------------------------------------------


def crowd(time=0.0):
    """Four overlapping captures, one of which moves, and a mesh."""
    parts = [(random_cloud(seed, n=150, degree=0), np.eye(4)) for seed in range(4)]
    parts[1] = parts[1][0], moved((time, 0.2 * time, 0))
    return add(scene_of(*parts), "/wall", wall(0.4, half=0.8))


def weights_of(mattes, path) -> np.ndarray:
    """Coverage by one prim."""
    ids, weights = mattes[..., ::2], mattes[..., 1::2]
    return np.where(ids == object_hash(path), weights, 0).sum(axis=-1)


@pytest.mark.parametrize("samples", [1, 6])
@pytest.mark.parametrize("sorting", ORDERS)
def test_mattes_are_what_each_prim_covers(sorting: str, samples: int) -> None:
    """Of prims that overlap, also while one moves. Oracle: the alpha of a picture in which all
    others hold out; together they are the coverage, the most first."""
    view = view_of(eye())
    view = replace(view, camera=replace(view.camera, shutter=(-0.25, 0.25)))

    def sampler(time):
        return crowd(time), view

    options = {"sorting": sorting, "samples": samples}
    found = picture(crowd(), view, sampler=sampler, aovs=("cryptoObject", "color"), **options)
    mattes, alpha = found["cryptoObject"], found["color"][..., 3]
    paths = ["/field0", "/field1", "/field2", "/field3", "/wall"]
    ids, weights = mattes[..., ::2], mattes[..., 1::2]
    assert set(np.unique(ids)) == {np.float32(0), *(object_hash(path) for path in paths)}
    np.testing.assert_allclose(weights.sum(axis=-1), alpha, atol=1e-5)
    assert (np.diff(weights, axis=-1) <= 0).all()
    assert (ids[weights == 0] == 0).all()
    for path in paths:
        held = replace(view, matte=tuple((other, True) for other in paths if other != path))

        def alone(time, held=held):
            return crowd(time), held

        one = picture(crowd(), held, sampler=alone, aovs=("color",), **options)["color"][..., 3]
        np.testing.assert_allclose(weights_of(mattes, path), one, atol=1e-5)


def test_great_ids_come_through_to_the_file(tmp_path) -> None:
    """Faces beyond 2**24, which a float cannot count. Oracle: a byte-level reader of EXR files."""
    first = 2**24 + 1
    faces = np.array([first, first + 2], np.int32)
    scene = add(scene_of(), "/wall", wall(0, half=1.0, faces=faces))
    found = picture(scene, view_of(eye()), aovs=("elementId", "color"))
    assert set(np.unique(found["elementId"])) == {-1, first, first + 2}
    layout = ImageLayout(resolution=SIZE, aovs=("color", "splatId"), compression="none")
    with ExrWriter(tmp_path / "a.exr", layout) as writer:
        ids = found["elementId"].view(np.uint32)
        writer.write_band(0, {"color": found["color"], "splatId": ids})
    channels = {k: v for _, part in ExrFile(tmp_path / "a.exr").parts for k, v in part.items()}
    np.testing.assert_array_equal(channels["splatId"].view(np.int32), found["elementId"])


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("sorting", [*ORDERS, "cameraDistance"])
@pytest.mark.parametrize("what", ["nothing", "a wall", "a wall behind", "splats behind"])
def test_where_nothing_is_every_aov_says_so(what: str, sorting: str, samples: int) -> None:
    """Of scenes with no splats, or none that is seen. Oracle: 0, +inf and -1 where nothing is."""
    scene = scene_of()
    if what == "splats behind":
        scene = scene_of((splats([(0, 0, -9)], 0.9), np.eye(4)))
    if what.startswith("a wall"):
        add(scene, "/wall", wall(0 if what == "a wall" else -9, half=0.5))
    found = picture(scene, view_of(eye()), sorting=sorting, samples=samples)
    empty = found["primId"] < 0
    assert empty.all() == (what != "a wall")
    corner = {name: array[0, 0] for name, array in found.items()}
    for name in ("depth", "depthFront", "depthExpected"):
        assert corner[name] == np.inf
    for name in ("primId", "instanceId", "elementId"):
        assert corner[name] == -1
    for name in ("color", "albedo", "Neye", "P", "motionForward", "motionBackward", "cryptoObject"):
        assert (corner[name] == 0).all()
