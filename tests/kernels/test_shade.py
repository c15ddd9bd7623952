"""Tests of shading surfaces: colours, textures, lights, normals."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.ray_caster import rays
from tests.render.surface_scenes import add, draw, mesh, screen_of, sheet, sphere
from usdsplat.kernels import texture
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import MaterialSpec, TextureSpec

pytestmark = pytest.mark.usefixtures("scenes_on_device")

SQUARE = (0.0, 0.0, 1.0, 1.0)
"""An aperture that a unit square at depth 1, or any of an orthographic view, fills."""


def unit_square(z=-1.0):
    """Points, triangles and uvs of the square from (0, 0) to (1, 1)."""
    points, triangles, uv = sheet(1, 1, lambda u, v: (u, v, np.full_like(u, z)))
    return points, triangles, uv[triangles].astype(np.float32)


def textured(pixels, wrap=("repeat", "repeat"), *, size, uvs=None, z=-1.0, orthographic=True):
    """The albedo of a unit square with a picture on it."""
    points, triangles, own = unit_square(z)
    picture = TextureSpec(pixels=np.ascontiguousarray(pixels, np.float32), wrap=wrap)
    spec = mesh(
        points, triangles, uvs=own if uvs is None else uvs(own),
        materials=(MaterialSpec(diffuse=(1, 1, 1), texture=picture),),
    )  # fmt: skip
    scene = add(RenderScene(), "/a", spec)
    return draw(scene, screen_of(size, SQUARE, orthographic=orthographic)).albedo


# --- textures ----------------------------------------------------------------------------


def test_a_picture_in_its_own_size_is_itself():
    """Oracle: the picture; row 0 at the top."""
    pixels = np.random.default_rng(0).random((20, 31, 3), np.float32)
    np.testing.assert_allclose(textured(pixels, size=(31, 20)), pixels, atol=1e-5)


@pytest.mark.parametrize("wrap", ["black", "clamp", "repeat", "mirror"])
def test_what_lies_outside_is_as_asked(wrap):
    """Oracle: NumPy's padding modes; three pictures each way and a texel of soft edge."""
    pixels = 0.1 + np.random.default_rng(1).random((8, 6, 3), np.float32)
    got = textured(pixels, (wrap, wrap), size=(18, 24), uvs=lambda uv: 3 * uv - 1)
    mode = {"black": "constant", "clamp": "edge", "repeat": "wrap", "mirror": "symmetric"}[wrap]
    expected = np.pad(pixels, ((8, 8), (6, 6), (0, 0)), mode=mode)
    np.testing.assert_allclose(got, expected, atol=2e-5)


def test_wraps_of_u_and_v_are_apart():
    """Oracle: NumPy's padding, one way after the other."""
    pixels = np.random.default_rng(1).random((8, 6, 3), np.float32)
    got = textured(pixels, ("mirror", "black"), size=(18, 24), uvs=lambda uv: 3 * uv - 1)
    expected = np.pad(pixels, ((0, 0), (6, 6), (0, 0)), mode="symmetric")
    expected = np.pad(expected, ((8, 8), (0, 0), (0, 0)))
    np.testing.assert_allclose(got, expected, atol=2e-5)


def test_between_texels_a_picture_is_linear():
    """Oracle: a ramp, which bilinear interpolation keeps, away from the border."""
    pixels = np.repeat(np.arange(8.0)[None, :, None], 3, axis=2)
    got = textured(pixels, ("clamp", "clamp"), size=(80, 1))[0, :, 0]
    expected = np.clip((np.arange(80) + 0.5) / 10 - 0.5, 0, 7)
    np.testing.assert_allclose(got, expected, atol=1e-5)


@pytest.mark.parametrize("times", [2, 4, 8])
def test_a_smaller_picture_is_the_mean_of_what_it_covers(times):
    """Oracle: block means by NumPy."""
    pixels = np.random.default_rng(2).random((32, 48, 3), np.float32)
    got = textured(pixels, size=(48 // times, 32 // times))
    blocks = pixels.reshape(32 // times, times, 48 // times, times, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(got, blocks, atol=1e-5)


def test_between_two_levels_both_count():
    """Oracle: a checker of texels is grey from level 1 on; half of level 0's contrast remains
    where a pixel is √2 texels wide."""
    i, j = np.indices((64, 64))
    pixels = np.repeat(((i + j) % 2)[..., None], 3, axis=2)
    root = np.sqrt(2.0)
    got = textured(pixels, size=(45, 45), uvs=lambda uv: uv * np.float32(45 * root / 64))
    x = (np.arange(45) + 0.5) * root - 0.5
    y = 63 - x[::-1]
    u, v = np.abs(x % 2 - 1), np.abs(y % 2 - 1)[:, None]  # weights of even texels
    sharp = u * (1 - v) + (1 - u) * v
    np.testing.assert_allclose(got[..., 0], 0.5 * sharp + 0.25, atol=1e-3)


def test_far_away_a_checker_is_grey():
    """Oracle: the mean of black and white; a floor to the horizon."""
    i, j = np.indices((8, 8))
    pixels = np.repeat(((i // 4 + j // 4) % 2)[..., None], 3, axis=2).astype(np.float32)
    points, triangles, uv = sheet(
        1, 1, lambda u, v: (1e4 * (u - 0.5), np.full_like(u, -1), -1e4 * v)
    )
    spec = mesh(
        points, triangles, uvs=(1e4 * uv)[triangles].astype(np.float32),
        materials=(MaterialSpec(diffuse=(1, 1, 1), texture=TextureSpec(pixels=pixels)),),
    )  # fmt: skip
    screen = screen_of()
    band = draw(add(RenderScene(), "/floor", spec), screen)
    far = (band.depth > 30) & (band.depth < np.inf)
    assert far.any()
    np.testing.assert_allclose(band.albedo[far], 0.5, atol=1e-4)
    near = band.albedo[(band.depth < 3)]
    assert near.min() < 0.05 and near.max() > 0.95


@pytest.mark.parametrize("size", [(5, 7), (1, 9), (6, 1), (1, 1), (13, 2)])
def test_every_level_of_a_pyramid_keeps_the_mean(device, size):
    """Oracle: NumPy's mean; odd sizes too."""
    height, width = size
    pixels = np.random.default_rng(4).random((height, width, 3)).astype(np.float32)
    levels, end = [], 0
    while True:
        levels.append((end, width, height))
        end += 3 * width * height
        if width == height == 1:
            break
        width, height = max(1, width // 2), max(1, height // 2)
    levels, texels = np.array(levels, texture.LEVEL), np.zeros(end, np.float32)
    texels[: pixels.size] = pixels.ravel()
    for k in range(len(levels) - 1):
        small = int(levels["height"][k + 1]), int(levels["width"][k + 1])
        device.run(texture.halve, texels, levels, k, small)
    for level in levels:
        n = int(level["width"] * level["height"])
        mean = texels[level["first"] :][: 3 * n].reshape(-1, 3).mean(axis=0)
        np.testing.assert_allclose(mean, pixels.mean(axis=(0, 1)), rtol=1e-5)


@pytest.mark.parametrize("wrap", ["black", "clamp", "repeat", "mirror"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1e12])
def test_coordinates_that_are_no_place_harm_nothing(wrap, value):
    """Oracle: what is read is of the picture, or black."""

    def spoil(uv):
        uv = uv.copy()
        uv[0] = value
        return uv

    pixels = np.full((4, 4, 3), 0.5)
    got = textured(pixels, (wrap, wrap), size=(32, 32), uvs=spoil)
    assert got.min() >= 0 and got.max() <= 0.50001


# --- materials ---------------------------------------------------------------------------


def test_corner_colours_are_interpolated_in_perspective():
    """Oracle: a colour that is linear in space, at the point where the ray meets the plane."""
    points, triangles, _ = sheet(
        1, 1, lambda u, v: (8 * (u - 0.5), 8 * (v - 0.5), -2 - 5 * u - 3 * v)
    )
    colors = (points[triangles] * 0.05 + 0.5).astype(np.float32)
    spec = mesh(
        points, triangles, colors=colors,
        materials=(MaterialSpec(diffuse=(0.5, 1, 2), uses_colors=True),),
    )  # fmt: skip
    screen = screen_of()
    band = draw(add(RenderScene(), "/a", spec), screen)
    seen = band.covered > 0
    at = rays(screen)[1] * band.depth[..., None].astype(np.float64) * [1, -1, -1]
    assert seen.mean() > 0.3
    np.testing.assert_allclose(
        band.albedo[seen], ((at * 0.05 + 0.5) * [0.5, 1, 2])[seen], atol=1e-5
    )  # fmt: skip


def test_materials_go_by_triangle():
    """Oracle: two materials, one of which ignores the mesh's colours, of the second mesh."""
    points, triangles, _ = unit_square()
    materials = (
        MaterialSpec(diffuse=(1, 0, 0)), MaterialSpec(diffuse=(0, 1, 0), uses_colors=True),
    )  # fmt: skip
    colors = np.full((2, 3, 3), 0.25, np.float32)
    scene = add(RenderScene(), "/a", mesh(points - [0, 0, 9], triangles))
    spec = mesh(
        points, triangles, materials=materials, colors=colors,
        material_of=np.array([1, 0], np.int32),
    )  # fmt: skip
    band = draw(add(scene, "/b", spec), screen_of((9, 9), SQUARE, orthographic=True))
    expected = np.array([[0, 0.25, 0], [1, 0, 0]])[band.hit[1]]
    np.testing.assert_array_equal(band.albedo, expected)
    assert set(band.hit[1].ravel()) == {0, 1}
    assert np.all(band.hit[0] == 1)


# --- light -------------------------------------------------------------------------------


def ball(**options):
    points, triangles = sphere(48, 24)
    normals = points[triangles].astype(np.float32)
    material = MaterialSpec(diffuse=(0.8, 0.4, 0.2))
    matrix = np.eye(4)
    matrix[2, 3] = -3
    spec = mesh(points, triangles, normals=normals, materials=(material,), **options)
    return add(RenderScene(), "/ball", spec, matrix)


@pytest.mark.parametrize("orthographic", [False, True])
def test_without_lights_there_is_a_lamp_at_the_eye(orthographic):
    """Oracle: Lambert's cosine of normal and direction to the eye."""
    screen = screen_of(orthographic=orthographic)
    band = draw(ball(), screen)
    seen = band.covered > 0
    eye = -rays(screen)[1] * [1, -1, -1]
    eye = eye / np.linalg.norm(eye, axis=-1, keepdims=True)
    cosine = np.maximum(0, np.sum(band.normal * eye, axis=-1))
    expected = cosine[..., None] * np.array([0.8, 0.4, 0.2])
    np.testing.assert_allclose(band.color[seen], expected[seen], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(band.normal[seen], axis=1), 1, atol=1e-6)


def test_lights_add_up_and_turn_with_the_world():
    """Oracle: Lambert's cosine in the world, the camera being turned and moved."""
    angle = 0.7
    turn = np.eye(4)
    turn[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]
    ]  # fmt: skip
    about = np.eye(4)
    about[2, 3] = 3
    back = np.linalg.inv(about)
    scene = ball()
    lights = {(0.6, 0.0, -0.8): (1, 2, 3), (0.0, -1.0, 0.0): (0.5, 0, 0)}
    for i, (direction, irradiance) in enumerate(lights.items()):
        scene.set_light(f"/light{i}", LightSpec(direction=direction, irradiance=irradiance))
    band = draw(scene, screen_of(matrix=back @ turn @ about))
    seen = band.covered > 0
    world = band.normal[seen] @ turn[:3, :3]
    expected = sum(
        np.maximum(0, -world @ direction)[:, None] * np.array(irradiance)
        for direction, irradiance in lights.items()
    )
    np.testing.assert_allclose(band.color[seen], expected * [0.8, 0.4, 0.2], atol=1e-5)
    assert band.color.max() > 0.5


# --- normals -----------------------------------------------------------------------------


def test_normals_of_a_stretched_mirrored_ball_are_those_of_an_ellipsoid():
    """Oracle: the gradient of the ellipsoid's equation."""
    stretch = np.diag([-1.5, 0.5, 0.8])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[2, 3] = stretch, -3
    points, triangles = sphere(192, 96)
    spec = mesh(points, triangles, normals=points[triangles].astype(np.float32), double_sided=False)
    screen = screen_of()
    band = draw(add(RenderScene(), "/a", spec, matrix), screen)
    direction = rays(screen)[1] * [1, -1, -1]
    seen = band.covered > 0
    depth = np.where(seen, band.depth, 1.0).astype(np.float64)
    at = direction * depth[..., None] - [0, 0, -3]
    normal = at @ np.linalg.inv(stretch @ stretch)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    cosine = -np.sum(normal * direction, axis=-1) / np.linalg.norm(direction, axis=-1)
    clear = seen & (cosine > 0.15)
    assert clear.sum() > 1000
    np.testing.assert_allclose(band.normal[clear], normal[clear], atol=3e-3)


def test_normals_are_on_the_side_that_is_seen():
    """Oracle: the square seen from the front, then from behind; authored normals of either
    sign."""
    points, triangles, _ = unit_square()
    for order in (triangles, triangles[:, ::-1]):
        for sign in (-1, 1):
            normals = np.tile(np.float32([0, 0.6, 0.8]) * sign, (2, 3, 1)).astype(np.float32)
            scene = add(RenderScene(), "/a", mesh(points, order, normals=normals))
            band = draw(scene, screen_of((5, 5), SQUARE, orthographic=True))
            np.testing.assert_allclose(band.normal, np.broadcast_to([0, 0.6, 0.8], (5, 5, 3)))


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_normal_without_direction_is_the_facet(value):
    """Oracle: the square's own normal."""
    points, triangles, _ = unit_square()
    normals = np.full((2, 3, 3), value, np.float32)
    scene = add(RenderScene(), "/a", mesh(points, triangles, normals=normals))
    band = draw(scene, screen_of((5, 5), SQUARE, orthographic=True))
    np.testing.assert_array_equal(band.normal, np.broadcast_to([0, 0, 1], (5, 5, 3)))
