"""Tests of the AOVs of surfaces of splats: N, Naxis, confidence and occlusion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.kernels.points.splat_shapes import sphere
from tests.render.rendering import lens, picture, view_of
from tests.render.surface_scenes import add, mesh
from usdsplat.core.cloud import SplatCloud
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import FieldSpec, InstanceSpec, SurfaceSpec

AOVS = ("Neye", "Naxis", "confidence", "occlusion", "color", "depthExpected")


def ball(count=1500):
    """A sphere of radius 1 of splats, and its normals."""
    shape = sphere(count)
    positions, rotations, scales, opacities = shape.splats
    sh = np.zeros((count, 1, 3), np.float32)
    cloud = SplatCloud(
        positions=positions, rotations=rotations, scales=scales, opacities=opacities, sh=sh
    )
    return cloud, np.float32(shape.normals)


def scene_of(cloud, matrix=None, surface=None):
    """A scene with one field."""
    scene = RenderScene()
    scene.set_field("/ball", FieldSpec(cloud=cloud, surface=surface))
    transform = tuple(np.eye(4).ravel()) if matrix is None else tuple(np.ravel(matrix))
    scene.set_instances("/ball", (InstanceSpec(path="/ball", transform=transform),))
    return scene


def wall(z, half=9.0):
    """A square that faces the camera."""
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return mesh(np.array(corners), [[0, 1, 2], [0, 2, 3]])


def sphere_normals(found):
    """Angles of N to the normals of a sphere at the same pixels [degree], away from its rim."""
    depth = found["depthExpected"]
    there = (found["color"][..., 3] > 0.99) & (depth < 3.5)
    (fx, fy), (cx, cy) = lens().focal, lens().center
    rows, columns = np.nonzero(there)
    z = depth[there]
    points = np.stack([(columns + 0.5 - cx) / fx * z, (rows + 0.5 - cy) / fy * z, z - 4], axis=1)
    expected = points / np.linalg.norm(points, axis=1, keepdims=True) * (1, -1, -1)
    cosines = np.einsum("ij,ij->i", found["Neye"][there], expected)
    assert len(cosines) > 500
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_n_is_the_normal_of_the_surface(sorting: str) -> None:
    """Oracle: closed form of a sphere, at the depth that each pixel has."""
    cloud, _ = ball()
    found = picture(scene_of(cloud), view_of(lens()), aovs=AOVS, sorting=sorting)
    assert sphere_normals(found).mean() < 5
    there = found["color"][..., 3] > 0.99
    assert found["confidence"][there].min() > 0.3
    assert np.median(found["occlusion"][there]) < 0.05
    assert (found["Neye"][~(found["color"][..., 3] > 0)] == 0).all()


def test_a_mirrored_and_turned_field_has_its_normals_outside() -> None:
    """Oracle: closed form: a sphere is the same when it is mirrored and turned."""
    cloud, _ = ball()
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    for sign in (1, -1):
        matrix = np.eye(4)
        matrix[:3, :3] = sign * turn
        found = picture(scene_of(cloud, matrix), view_of(lens()), aovs=AOVS)
        assert sphere_normals(found).mean() < 5


def test_authored_values_are_drawn() -> None:
    """Oracle: the values: one normal, confidence and occlusion of all splats."""
    cloud, _ = ball(300)
    normal = np.float32([0.6, 0, 0.8])
    surface = SurfaceSpec(
        normals=np.tile(normal, (300, 1)),
        confidence=np.full(300, 0.25, np.float32),
        occlusion=np.full(300, 0.75, np.float32),
    )
    for sorting in ("zDepth", "rayHitDistance"):
        scene = scene_of(cloud, surface=surface)
        found = picture(scene, view_of(lens()), aovs=AOVS, sorting=sorting)
        there = found["color"][..., 3] > 0.5
        np.testing.assert_allclose(
            found["Neye"][there], np.tile((0.6, 0, -0.8), (there.sum(), 1)), atol=1e-5
        )
        np.testing.assert_allclose(found["confidence"][there], 0.25, atol=1e-5)
        np.testing.assert_allclose(found["occlusion"][there], 0.75, atol=1e-5)


def test_splats_without_an_authored_normal_have_their_axis() -> None:
    """Oracle: the AOV of axes."""
    cloud, _ = ball(300)
    surface = SurfaceSpec(normals=np.zeros((300, 3), np.float32))
    found = picture(scene_of(cloud, surface=surface), view_of(lens()), aovs=AOVS)
    np.testing.assert_array_equal(found["Neye"], found["Naxis"])
    there = found["color"][..., 3] > 0.5
    np.testing.assert_allclose(found["confidence"][there], 1, atol=1e-5)


def test_a_surface_behind_splats_counts_by_what_is_seen_of_it() -> None:
    """Oracle: splats of confidence 0.5 and occlusion 1 before a wall of 1 and 0: means by
    coverage."""
    cloud, _ = ball(300)
    cloud = replace(cloud, opacities=np.full(300, 0.02, np.float32))
    surface = SurfaceSpec(
        normals=np.tile(np.float32([0, 0, -1]), (300, 1)),
        confidence=np.full(300, 0.5, np.float32),
        occlusion=np.ones(300, np.float32),
    )
    aovs = ("confidence", "occlusion", "color")
    alone = picture(scene_of(cloud, surface=surface), view_of(lens()), aovs=aovs)
    scene = add(scene_of(cloud, surface=surface), "/wall", wall(3))
    found = picture(scene, view_of(lens()), aovs=aovs)
    part = alone["color"][50:60, 60:80, 3]
    assert part.max() > 0.02
    np.testing.assert_allclose(found["occlusion"][50:60, 60:80], part, atol=1e-5)
    np.testing.assert_allclose(found["confidence"][50:60, 60:80], 1 - 0.5 * part, atol=1e-5)


def test_edits_compute_normals_again() -> None:
    """Oracle: a fresh scene, bit for bit, after moved splats, other authored normals, and none."""
    cloud, normals = ball(600)
    scene = scene_of(cloud)
    picture(scene, view_of(lens()), aovs=AOVS)
    squeezed = replace(cloud, positions=cloud.positions * np.float32([1, 0.4, 1]))
    surface = SurfaceSpec(normals=normals)
    for spec in (
        FieldSpec(cloud=squeezed),
        FieldSpec(cloud=squeezed, surface=surface),
        FieldSpec(cloud=squeezed, surface=SurfaceSpec(normals=-normals)),
        FieldSpec(cloud=cloud),
    ):
        scene.set_field("/ball", spec)
        found = picture(scene, view_of(lens()), aovs=AOVS)
        fresh = picture(scene_of(spec.cloud, surface=spec.surface), view_of(lens()), aovs=AOVS)
        for name in AOVS:
            np.testing.assert_array_equal(found[name], fresh[name])


def test_a_budget_has_the_normals_of_the_splats_that_it_draws() -> None:
    """Oracle: the authored normals of the subset: each splat has its own, by its position."""
    cloud, normals = ball(600)
    surface = SurfaceSpec(normals=normals)
    found = picture(
        scene_of(cloud, surface=surface), view_of(lens()), aovs=AOVS, splat_budget=400
    )  # fmt: skip
    assert sphere_normals(found).mean() < 12
