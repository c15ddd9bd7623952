"""Tests of garbage mattes in pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from tests.render.rendering import (
    lens,
    picture,
    random_cloud,
    random_transform,
    scene_of,
    view_of,
)
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import crop
from usdsplat.render.crop_volumes import volumes
from usdsplat.render.cropping import inside
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CropShape, CropSpec, FieldSpec, InstanceSpec

SHAPES = get_args(CropShape)
SURFACES = {
    "sphere": ([(0, 0, 1), (1, 0, 0), (0, -1, 0)], (0, 0, 2)),
    "cube": ([(1, -1, 1), (0, 0.5, -1)], (0, 0, 2)),
    "cylinder": ([(1, 0, 1), (0, -1, -1), (0, 0, 1)], (0, 0, 2)),
    "cone": ([(0, 1, -1), (0.5, 0, 0), (0, 0, 1), (0, -0.25, 0.5)], (0, 0, 2)),
    "capsule": ([(0, 0, 2.5), (1, 0, -1.5), (0, -1, 1.5)], (0, 0, 4)),
    "plane": ([(9, 9, 0), (0, -3, 0)], (0, 0, 1)),
}
"""Points on each surface whose coordinates float32 has exactly, and one outside."""


def spec_of(shape, seed, keeps) -> CropSpec:
    """A volume somewhere near the origin, stretched and sheared."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = 0.4 * random_transform(seed)[:3, :3]
    matrix[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    return CropSpec(
        shape=shape, world_to_shape=tuple(matrix.ravel()), keeps=keeps, length=rng.uniform(0, 2)
    )


def left_by_kernel(crops, points, transform) -> np.ndarray:
    records, matrices = volumes(crops, transform[None])
    return np.array([crop.is_left(records, matrices[0], point) for point in points])


@pytest.mark.parametrize("shape", SHAPES)
def test_the_kernel_decides_as_the_reference_does(shape) -> None:
    """Of points in a sheared and mirrored field, for volumes that keep and that do not. Oracle:
    `cropping.inside` in NumPy, on the points in the world."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(400, 3)).astype(np.float32)
    points[0] = np.nan
    other = SHAPES[(SHAPES.index(shape) + 1) % len(SHAPES)]
    for seed in range(4):
        transform = random_transform(seed + 10)
        world = points.astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
        one, two = spec_of(shape, seed, True), spec_of(other, seed + 50, seed % 2 == 0)
        for crops in ((one,), (replace(one, keeps=False),), (one, two), (two, one)):
            found = left_by_kernel(crops, points, transform)
            np.testing.assert_array_equal(found, inside(crops, world))
            assert seed or 0 < found.sum() < len(found)


@pytest.mark.parametrize("shape", SHAPES)
def test_surfaces_of_volumes_belong_to_them(shape) -> None:
    """Oracle: points on the surface by hand, and the next float32 further out."""
    on, outside = SURFACES[shape]
    identity = tuple(np.eye(4).ravel())
    volume = CropSpec(shape=shape, world_to_shape=identity, keeps=True, length=1.5)
    points = np.float32([*on, outside])
    found = left_by_kernel((volume,), points, np.eye(4))
    assert found.tolist() == [True] * len(on) + [False]
    away = np.copysign(np.float32(np.inf), points[:-1])
    beyond = np.where(points[:-1] == 0, points[:-1], np.nextafter(points[:-1], away))
    if shape == "plane":
        beyond[:, 2] = np.float32(1e-30)
    if shape == "cone":
        beyond = np.delete(beyond, 0, axis=0)  # its base goes down, and its rim out
    assert not left_by_kernel((volume,), np.float32(beyond), np.eye(4)).any()


def some(cloud: SplatCloud, mask) -> SplatCloud:
    names = ("positions", "scales", "rotations", "opacities", "sh")
    return SplatCloud(**{name: getattr(cloud, name)[mask] for name in names})


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
def test_the_picture_is_that_of_the_splats_that_are_left(sorting) -> None:
    """Each appearance of a field is cropped where it stands in the world. Oracle: the picture of
    clouds without the others, bit for bit."""
    cloud, view = random_cloud(1), view_of(lens())
    transforms = [np.eye(4), random_transform(3)]
    crops = (spec_of("sphere", 1, True), spec_of("cone", 2, True), spec_of("cube", 3, False))
    whole, parts = RenderScene(), RenderScene()
    whole.set_field("/a", FieldSpec(cloud=cloud))
    whole.set_crops("/a", crops)
    placed = [
        InstanceSpec(path="/a", index=i, transform=tuple(matrix.ravel()))
        for i, matrix in enumerate(transforms)
    ]
    whole.set_instances("/a", tuple(placed))
    left = 0
    for instance, matrix in zip(placed, transforms, strict=True):
        world = cloud.positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        mask = inside(crops, world)
        left += int(mask.sum())
        path = f"/part{instance.index}"
        parts.set_field(path, FieldSpec(cloud=some(cloud, mask)))
        parts.set_instances(path, (instance,))
    assert 0 < left < 2 * len(cloud)
    aovs = ("color", "depth", "Naxis", "instanceId", "cryptoObject")
    found = picture(whole, view, sorting=sorting, aovs=aovs)
    expected = picture(parts, view, sorting=sorting, aovs=aovs)
    for name in aovs:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


def test_what_is_cropped_away_is_not_the_subject() -> None:
    """A camera frames what the volumes leave. Oracle: the volume's own box."""
    cloud = random_cloud(5, n=4000)
    scene = scene_of((cloud, np.eye(4)))
    half = np.diag([2.0, 2.0, 2.0, 1.0])
    crop = CropSpec(shape="cube", world_to_shape=tuple(half.ravel()), keeps=True)
    scene.set_crops("/field0", (crop,))
    box = scene.subject()
    assert box is not None
    assert np.allclose(box[0], -0.5, atol=0.05) and np.allclose(box[1], 0.5, atol=0.05)
