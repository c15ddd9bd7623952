"""Tests of opaque prims. Oracles: closed forms, and a ray caster."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.ray_caster import cast, rays, steady
from tests.render.surface_scenes import (
    add,
    arrays_of,
    assert_same,
    draw,
    mesh,
    screen_of,
    sheet,
    sphere,
    to_camera,
)
from usdsplat.kernels.device import cores
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import InstanceSpec, MaterialSpec, TextureSpec
from usdsplat.render.surface_cache import SurfaceCache
from usdsplat.render.surfaces import Surfaces

FLIP = np.array([1.0, -1.0, -1.0])
"""From the kernels' camera space to USD's, and back."""


def moved(x=0.0, y=0.0, z=0.0, scale=(1.0, 1.0, 1.0)):
    matrix = np.diag([*scale, 1.0])
    matrix[:3, 3] = x, y, z
    return matrix


def soup(seed, n=60, *, depth=-2.5):
    """Triangles of all sizes, some of which reach behind the eye."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-1.3, 0.4, (n, 1, 1))
    center = rng.normal(size=(n, 1, 3)) * [1.2, 1.0, 1.5] + [0, 0, depth]
    return center + size * rng.normal(size=(n, 3, 3))


def varied_scene():
    """Several meshes, instances, textures, lights."""
    rng = np.random.default_rng(3)
    points, triangles = sphere(24, 12)
    picture = TextureSpec(pixels=rng.random((13, 7, 3), np.float32), wrap=("mirror", "clamp"))
    spec = mesh(
        points, triangles, normals=points[triangles].astype(np.float32),
        uvs=rng.uniform(-1, 2, (len(triangles), 3, 2)).astype(np.float32),
        colors=rng.random((len(triangles), 3, 3), np.float32),
        material_of=rng.integers(0, 2, len(triangles)).astype(np.int32),
        materials=(
            MaterialSpec(diffuse=(0.5, 0.6, 0.7), texture=picture),
            MaterialSpec(uses_colors=True),
        ),
    )  # fmt: skip
    scene = RenderScene()
    add(scene, "/ball", spec, moved(z=-3), moved(x=1, z=-4, scale=(0.5, -1, 2)))
    add(scene, "/soup", mesh(soup(5, 14, depth=-4.0)))
    scene.set_light("/sun", LightSpec(direction=(0.6, 0.0, -0.8), irradiance=(1, 2, 3)))
    return scene


# --- closed forms ------------------------------------------------------------------------


@pytest.mark.parametrize("orthographic", [False, True])
def test_depth_of_a_slanted_plane_is_where_the_ray_meets_it(orthographic):
    """Oracle: the plane's equation, from the eye into the distance."""
    normal, at = np.array([0.3, 0.9, 0.25]), np.array([0.0, -0.6, -2.0])
    side = np.cross(normal, [1.0, 0.0, 0.0])
    points, triangles, _ = sheet(
        1, 1, lambda u, v: (at + np.outer(200 * (u - 0.5), np.cross(normal, side))
                            + np.outer(200 * (v - 0.5), side)).T,
    )  # fmt: skip
    screen = screen_of(orthographic=orthographic)
    band = draw(add(RenderScene(), "/plane", mesh(points, triangles)), screen)
    origins, directions = rays(screen)
    z = (normal * FLIP) @ (at * FLIP) - origins @ (normal * FLIP)
    z = z / (directions @ (normal * FLIP))
    seen = (z >= 0.1) & (z < 30)
    assert seen.mean() > 0.2
    np.testing.assert_allclose(band.depth[seen], z[seen], rtol=1e-5)
    assert np.all(band.depth[z < 0.1] == np.inf)
    facing = np.sign(-np.sum(normal * FLIP * directions, axis=-1))[..., None]
    expected = facing * normal / np.linalg.norm(normal)
    np.testing.assert_allclose(band.normal[seen], expected[seen], atol=1e-6)


def test_a_fine_sphere_is_a_sphere():
    """Oracle: the quadratic of ray and sphere; its normal is the direction from the centre."""
    points, triangles = sphere(256, 128)
    spec = mesh(points, triangles, normals=points[triangles].astype(np.float32), double_sided=False)
    screen = screen_of()
    band = draw(add(RenderScene(), "/ball", spec, moved(0.2, 0.1, -4)), screen)
    _, d = rays(screen)
    center = np.array([0.2, -0.1, 4.0])
    b, square = d @ center, np.sum(d * d, axis=-1)
    root = b * b - square * (center @ center - 1)
    inside = root > 0.02
    z = (b - np.sqrt(np.where(inside, root, 0))) / square
    np.testing.assert_allclose(band.depth[inside], z[inside], rtol=5e-4)
    normal = (d * z[..., None] - center) * FLIP
    np.testing.assert_allclose(band.normal[inside], normal[inside], atol=2e-3)
    assert np.all(band.covered[root < -0.02] == 0)


def test_near_and_far_planes_cut():
    """Oracle: planar depth of the plane y = -1."""
    points, triangles, _ = sheet(
        1, 1, lambda u, v: (90 * (u - 0.5), np.full_like(u, -1), 60 * (v - 0.7))
    )
    screen = screen_of(clip=(2.5, 9.0))
    band = draw(add(RenderScene(), "/floor", mesh(points, triangles)), screen)
    with np.errstate(divide="ignore"):
        z = 1 / rays(screen)[1][..., 1]
    np.testing.assert_array_equal(band.covered, (z >= 2.5) & (z <= 9.0))


# --- an independent implementation -------------------------------------------------------


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_soup_is_what_a_ray_caster_sees(orthographic, seed):
    """Oracle: Möller and Trumbore's intersection in float64, through sheared, mirrored transforms
    and the near plane; pixels within 1/1000 of an edge are left out."""
    rng = np.random.default_rng(seed)
    transforms = [np.eye(4), np.eye(4), np.eye(4)]
    transforms[1][:3, :3] = rng.normal(size=(3, 3))
    transforms[1][:3, 3] = 0, 0, -3
    transforms[2][:3, :3] = -transforms[1][:3, :3] + 0.1
    scene, corners, one_sided, where = RenderScene(), [], [], []
    screen = screen_of(clip=(0.3, 6.0), orthographic=orthographic)
    if orthographic:
        screen = screen_of(window=(-2, -1.5, 2, 1.5), clip=(0.3, 6.0), orthographic=True)
    for k, matrix in enumerate(transforms):
        points = soup(10 * seed + k, 12, depth=-2.5 if k == 0 else 0.0)
        double_sided = k != 1
        add(scene, f"/mesh{k}", mesh(points, double_sided=double_sided), matrix)
        placed = to_camera(screen, points.reshape(-1, 3), matrix).reshape(-1, 3, 3)
        if np.linalg.det(matrix[:3, :3]) < 0:
            placed = placed[:, np.array([0, 2, 1])]
        corners.append(placed)
        one_sided += [not double_sided] * 12
        where += [(k, i) for i in range(12)]
    corners = np.concatenate(corners)
    expected = cast(corners, screen, one_sided=one_sided)
    keep = steady(corners, screen, one_sided=one_sided)
    assert keep.mean() > 0.97
    band = draw(scene, screen)
    hit = np.where(
        expected.triangle[..., None] < 0, -1, np.array([*where, (-1, -1)])[expected.triangle]
    )
    np.testing.assert_array_equal(np.moveaxis(band.hit, 0, -1)[keep], hit[keep])
    np.testing.assert_allclose(band.depth[keep], expected.depth[keep], rtol=1e-5)
    mirrored = np.array([np.linalg.det(m[:3, :3]) < 0 for m in transforms])[hit[..., 0]]
    bary = np.where(mirrored[..., None], expected.bary[..., ::-1], expected.bary)
    seen = keep & (expected.triangle >= 0)
    np.testing.assert_allclose(band.bary[seen], bary[seen], atol=1e-5)
    assert seen.mean() > 0.1
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n = (n / np.linalg.norm(n, axis=1, keepdims=True))[expected.triangle]
    n *= -np.sign(np.sum(n * rays(screen)[1], axis=-1, keepdims=True))
    np.testing.assert_allclose(band.normal[seen], (n * FLIP)[seen], atol=1e-5)


# --- what may not matter -----------------------------------------------------------------


@pytest.mark.parametrize("orthographic", [False, True])
def test_crops_bands_and_overscan_are_the_full_frame(orthographic):
    """Oracle: the whole overscanned frame at once, bit for bit."""
    scene, wide = varied_scene(), (-37, -21, 190, 140)
    whole = arrays_of(draw(scene, screen_of(data=wide, orthographic=orthographic)))
    for data in ((0, 0, 150, 110), (33, 21, 98, 77), (-37, 50, -3, 51)):
        part = arrays_of(draw(scene, screen_of(data=data, orthographic=orthographic)))
        for name, array in part.items():
            rows = slice(data[1] - wide[1], data[3] - wide[1])
            columns = slice(data[0] - wide[0], data[2] - wide[0])
            np.testing.assert_array_equal(array, whole[name][rows, columns], err_msg=name)
    screen = screen_of(orthographic=orthographic)
    bands = [(0, 16), (16, 17), (17, 70), (70, 110)]
    assert_same(draw(scene, screen), draw(scene, screen, bands=bands))


def test_threads_do_not_matter():
    """Oracle: one thread."""
    scene = varied_scene()
    most = cores()
    assert_same(draw(scene, screen_of(), threads=1), draw(scene, screen_of(), threads=most))


def test_a_cache_does_not_matter_and_lays_out_once():
    """Oracle: no cache."""
    cache, device = SurfaceCache(), open_device()
    scene = varied_scene()
    for screen in (screen_of(), screen_of((70, 50))):
        assert_same(draw(scene, screen), draw(scene, screen, cache=cache))
    first = Surfaces.of(device, scene, screen_of(), cache=cache)
    again = Surfaces.of(device, scene, screen_of(), cache=cache)
    assert first.looks[-1] is again.looks[-1]
    scene.set_mesh("/soup", mesh(soup(6)))
    assert_same(draw(scene, screen_of()), draw(scene, screen_of(), cache=cache))


def test_of_equal_depths_the_first_wins():
    """Oracle: the order of appearances, then of triangles."""
    points = np.array([[[-9, -9, -2], [9, -9, -2], [0, 9, -2.0]]] * 2)
    scene = add(RenderScene(), "/b", mesh(points))
    add(scene, "/a", mesh(points), moved(), moved())
    band = draw(scene, screen_of())
    assert band.covered.all()
    assert not band.hit.any()
    assert not band.ids.any()


# --- prims -------------------------------------------------------------------------------


def test_ids_name_prim_instance_and_face():
    """Oracle: two squares side by side; splat prims would count among the prims too."""
    points, triangles, _ = sheet(1, 1, lambda u, v: (u, v - 0.5, 0 * u - 2))
    spec = mesh(points, triangles, faces=np.array([7, 7], np.int32))
    scene = add(RenderScene(), "/z", spec)
    scene.set_instances(
        "/z",
        (
            InstanceSpec(path="/z/right", index=4, transform=tuple(moved(0.01).ravel())),
            InstanceSpec(path="/a/left", index=9, transform=tuple(moved(-1).ravel())),
        ),
    )
    band = draw(scene, screen_of())
    assert scene.prims() == ("/a/left", "/z/right")
    row, y = band.ids[:, 60], band.covered[60]
    assert set(map(tuple, row.T[y > 0])) == {(0, 9, 7), (1, 4, 7)}
    assert tuple(row[:, y > 0][:, 0]) == (0, 9, 7)
    assert np.all(row[:, y == 0] == -1)


def test_matte_prims_hide_and_have_no_colour():
    """Oracle: the same scene without rules."""
    scene = varied_scene()
    plain = draw(scene, screen_of())
    band = draw(scene, screen_of(), matte=(("/ball", True),))
    ball = band.ids[0] == scene.prims().index("/ball")
    assert ball.any() and (band.covered == 1).any()
    np.testing.assert_array_equal(band.covered, np.where(ball, 2, plain.covered))
    np.testing.assert_array_equal(band.color, np.where(ball[..., None], 0, plain.color))
    np.testing.assert_array_equal(band.depth, plain.depth)
    np.testing.assert_array_equal(band.albedo, plain.albedo)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_backs_are_culled_of_what_has_one_side_only(mirror):
    """Oracle: a sphere seen from inside; a mirror turns the winding, not the inside."""
    points, triangles = sphere(24, 12)
    matrix = moved(scale=(3 * mirror, 3, 3))
    for double_sided in (False, True):
        spec = mesh(points, triangles, double_sided=double_sided)
        inside = draw(add(RenderScene(), "/a", spec, matrix), screen_of())
        assert np.all(inside.covered == double_sided)
        outside = draw(add(RenderScene(), "/a", spec, moved(z=-9) @ matrix), screen_of())
        assert outside.covered[60, 75] and 5.9 < outside.depth[60, 75] < 6.2


def test_nothing_drawn_is_nothing():
    """Oracle: None, and where meshes lie elsewhere an empty band."""
    device = open_device()
    scene = RenderScene()
    assert Surfaces.of(device, scene, screen_of()) is None
    add(scene, "/a", mesh(np.zeros((0, 3))))
    assert Surfaces.of(device, scene, screen_of()) is None
    add(scene, "/a", mesh(soup(0, depth=500.0)))
    band = draw(scene, screen_of())
    assert not band.covered.any() and np.all(band.depth == np.inf)
    assert not band.color.any() and not band.normal.any() and not band.bary.any()
    assert np.all(band.ids == -1) and np.all(band.hit == -1)
    scene.set_visible("/a", False)
    assert Surfaces.of(device, scene, screen_of()) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38])
@pytest.mark.parametrize("orthographic", [False, True])
def test_corners_that_are_no_place_harm_nothing(value, orthographic):
    """Oracle: the scene without them."""
    screen = screen_of(orthographic=orthographic)
    plain = draw(add(RenderScene(), "/b", mesh(soup(1))), screen)
    bad = soup(2, 30)
    bad.reshape(-1)[::7] = value
    bad[:, 0, 2] = value if value != 3e38 else -3e38
    scene = add(RenderScene(), "/b", mesh(soup(1)))
    add(scene, "/z", mesh(bad, double_sided=True), np.diag([1e5, 1e5, 1e5, 1.0]))
    band = draw(scene, screen)
    near = band.hit[0] <= 0
    np.testing.assert_array_equal(band.depth[near], plain.depth[near])
    assert near.all() or value == 3e38


def test_triangles_without_area_draw_nothing():
    """Oracle: nothing; points, needles and doubled corners."""
    a = soup(3, 40)
    a[:20, 1] = a[:20, 0]
    a[20:30] = a[20:30, :1]
    a[30:, 2] = (a[30:, 0] + a[30:, 1]) / 2
    a[30:, :, 2] = -4
    a[30:] = np.round(a[30:] * 4) / 4
    a[30:, 2] = (a[30:, 0] + a[30:, 1]) / 2
    for orthographic in (False, True):
        band = draw(
            add(RenderScene(), "/a", mesh(a)), screen_of(orthographic=orthographic)
        )  # fmt: skip
        assert not band.covered.any()


def test_a_flat_transform_draws_its_shadow_on_the_plane():
    """Oracle: a matrix of rank 2 leaves a flat sphere, with normals across it."""
    points, triangles = sphere(24, 12)
    spec = mesh(points, triangles, normals=points[triangles].astype(np.float32))
    band = draw(
        add(RenderScene(), "/a", spec, moved(z=-3, scale=(1, 1, 0))), screen_of()
    )  # fmt: skip
    seen = band.covered > 0
    assert seen.any()
    np.testing.assert_allclose(band.depth[seen], 3, rtol=1e-6)
    np.testing.assert_allclose(band.normal[seen], np.tile([0, 0, 1], (seen.sum(), 1)), atol=1e-6)
