"""Light at points of small scenes, and the same in plain float64 NumPy."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import light_lanes, lighting, total
from usdsplat.kernels.devices import open_device
from usdsplat.render.lights.cameras import bounds_of, cameras_of
from usdsplat.render.lights.depth_map import MapBuffers, draw_depth_map
from usdsplat.render.lights.sampling import samples_of
from usdsplat.render.renderer import open_rasterizer
from usdsplat.render.specs import FieldSpec, InstanceSpec
from usdsplat.render.surface_cache import SurfaceCache

UP = np.array([0.0, 0.0, 1.0])


def add_splats(scene, path, cloud, matrix=None, **options):
    """Put a field into a scene."""
    matrix = np.eye(4) if matrix is None else matrix
    scene.set_field(path, FieldSpec(cloud=cloud, **options))
    scene.set_instances(path, (InstanceSpec(path=path, transform=tuple(matrix.ravel())),))
    return scene


def cloud_of(positions, scales, opacities, *, rotations=None, grey=0.5):
    """Splats without harmonics."""
    n = len(positions)
    if rotations is None:
        rotations = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    sh = np.full((n, 1, 3), (grey - 0.5) / 0.28209479177387814)
    arrays = (positions, rotations, np.broadcast_to(scales, (n, 3)), sh)
    positions, rotations, scales, sh = (np.asarray(each, np.float32) for each in arrays)
    opacities = np.broadcast_to(np.float32(opacities), n).copy()
    return SplatCloud(
        positions=positions, rotations=rotations, scales=scales.copy(), opacities=opacities, sh=sh
    )


def light_at(
    scene, light, points, normals, *, shapes=None, samples=16, resolution=1024, threads=None
):
    """Light with and without shadows of one light at points of surfaces, or of splats with these
    covariances, shape (n, 6) both: r g b with, r g b without."""
    rasterizer = open_rasterizer(open_device(threads=threads))
    device, layout = rasterizer.device, scene.draw_list()
    points = np.ascontiguousarray(points, np.float64)
    full = np.ones((len(points), 4), np.float32)
    full[:, :3] = normals
    shapes = lighting.NO_SHAPES if shapes is None else np.float32(shapes)
    casts = np.ones(len(layout.labels), np.uint8)
    sums = device.resident((len(points), lighting.SUMS), np.float32)
    device.run(total.clear, sums.reshape((-1, 1, lighting.SUMS)))
    buffers = MapBuffers(device.resident)
    for record in samples_of(light, samples):
        for camera in cameras_of(record[None].copy(), bounds_of(scene), resolution):
            each = draw_depth_map(
                rasterizer, camera, scene, layout, lambda _: True, SurfaceCache(), buffers
            )
            device.run(
                light_lanes.shine, each.light, points, full, shapes, lighting.NO_PRIMS,
                lighting.ONE_PRIM, -1, each.world_to_screen, each.views, (each.casters, casts),
                each.tiles, each.depths, buffers.receivers.get, sums,
            )  # fmt: skip
    return device.fetch(sums).astype(np.float64)


def covariances(cloud):
    """Covariances of splats, shape (n, 3, 3)."""
    w, x, y, z = cloud.rotations.astype(np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    turned = np.moveaxis(np.array(rows), 2, 0) * cloud.scales[:, None].astype(np.float64)
    return turned @ turned.transpose(0, 2, 1)


def transmittance(cloud, points, towards, distance=np.inf):
    """Transmittance from points along unit vectors `towards` the light, both shape (n, 3): the
    maximum of each Gaussian along the ray, no farther away than the light, and the ramp of
    `kernels.lighting`."""
    inverse, covariance = np.linalg.inv(covariances(cloud)), covariances(cloud)
    away = points[:, None] - cloud.positions[None].astype(np.float64)
    along = np.einsum("ni,kij,nj->nk", towards, inverse, towards)
    gap = np.einsum("nki,kij,nj->nk", away, inverse, towards) / along
    nearest = away - gap[..., None] * towards[:, None]
    power = np.einsum("nki,kij,nkj->nk", nearest, inverse, nearest)
    alpha = cloud.opacities.astype(np.float64) * np.exp(-0.5 * power)
    alpha = np.where(alpha < 1 / 255, 0.0, np.minimum(alpha, 0.999))
    alpha = np.where(-gap < np.reshape(distance, (-1, 1)), alpha, 0.0)
    both = np.sqrt(np.einsum("ni,kij,nj->nk", towards, covariance, towards))
    # gap grows away from the light: towards it, ray hits lie at negative distances
    ramp = np.clip((-gap - both) / (2 * both), 0, 1)
    return np.prod(1 - alpha * ramp, axis=1)
