"""Tests of ray hits: the kernel's five float32 numbers compared with float64 geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.render.rendering import (
    lens,
    random_cloud,
    random_transform,
    scene_of,
    settings_of,
    view_of,
)
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import reference, reference_rays
from usdsplat.kernels.device import Device
from usdsplat.kernels.project import U, V
from usdsplat.kernels.ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, ray_hit_at
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.projected_splats import ProjectedSplats
from usdsplat.render.projector import Projector
from usdsplat.render.screen import Screen

MODELS = ["perspective", "tangential", "orthographic"]
KINDS = {
    "any": (0.08, 0.08, 0.08),
    "flat": (0.1, 0.1, 1e-4),
    "needle": (4e-3, 4e-3, 0.4),
    "blade": (1e-3, 0.03, 1.0),
    "huge": (3.0, 0.02, 0.02),
}
"""Standard deviations, times 0.5 to 2."""
ARRAYS = ("records", "order", "sources", "ray_hits")
"""What is looked at of a `ProjectedSplats`."""
PIXELS = 24
"""Rays that are tried for each splat."""


def cloud_of(kind: str, seed: int, n: int = 60) -> SplatCloud:
    rng = np.random.default_rng(seed)
    scales = np.array(KINDS[kind]) * rng.uniform(0.5, 2.0, (n, 3))
    opacities = rng.uniform(0.05, 1.0, n).astype(np.float32)
    cloud = random_cloud(seed, n=n, degree=0)
    return replace(cloud, scales=scales.astype(np.float32), opacities=opacities)


def look(
    device: Device, cloud: SplatCloud, matrix: np.ndarray, eye: reference.Lens
) -> ProjectedSplats:
    """What the kernels know of a cloud."""
    mode = "tangential" if eye.model == "tangential" else "perspective"
    scene = scene_of((cloud, matrix), projection_mode=mode)
    screen, space = Screen.of(view_of(eye)), "srgb_rec709_scene"
    buffers = FrameBuffers(device.resident)
    projector = Projector(device, buffers, scene.draw_list(), screen, settings_of(), space)
    projector.lay_out()
    projector.project()
    projector.shade()
    projector.find_ray_hits()
    found = projector.sort((), labels=False)
    on_host = {name: device.fetch(getattr(found, name)) for name in ARRAYS}
    return replace(found, **on_host)


def found_depth(
    record: np.ndarray, ray_hit: np.ndarray, x: float, y: float, parallel: bool
) -> float:
    """`ray_hit_at`, at the centre of pixel (x, y)."""
    f = np.float32
    dx, dy = f(x) - record[U], f(y) - record[V]
    first = f(1) + ray_hit[HX] * dy
    return float(
        ray_hit_at(
            dx, ray_hit[GX], ray_hit[GY], first, ray_hit[HY] * dy, ray_hit[HZ] * dy,
            ray_hit[CENTER], ray_hit[REACH], parallel,
        )
    )  # fmt: skip


def nearest_passes(seen: reference.Footprints, eye: reference.Lens, depth: np.ndarray):
    """How many standard deviations from each centre rays pass at `depth`, shape (n, h, w)."""
    width, height = eye.size
    u = (np.arange(width) + 0.5 - eye.center[0]) / eye.focal[0]
    v = (np.arange(height) + 0.5 - eye.center[1]) / eye.focal[1]
    grid = np.stack([*np.meshgrid(u, v), np.ones((height, width))], axis=-1)
    if eye.model == "orthographic":
        points = np.concatenate(
            [np.broadcast_to(grid[..., :2], (*depth.shape, 2)), depth[..., None]], axis=-1
        )
    else:
        points = grid * depth[..., None]
    away = points - seen.camera[:, None, None]
    inverse = np.linalg.inv(seen.covariance)
    return np.sqrt(np.einsum("nhwi,nij,nhwj->nhw", away, inverse, away))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("kind", KINDS)
def test_peaks_lie_where_rays_pass_the_centre_nearest(
    device: Device, kind: str, model: str
) -> None:
    """Balls, discs, needles, blades and giants, in sheared and mirrored fields, wherever a ray hits
    the ellipsoid of what counts. Oracle: the float64 reference, by the inverse covariance."""
    eye = replace(lens(model), size=(60, 44), focal=(60.0, 64.0), center=(28.0, 23.0))
    if model == "orthographic":
        eye = replace(eye, focal=(10.0, 11.0))
    tried = 0
    for seed in (1, 2):
        cloud = cloud_of(kind, seed)
        matrix = np.eye(4) if seed == 1 else random_transform(seed)
        visible = look(device, cloud, matrix, eye)
        seen = reference.footprints([(cloud, matrix)], eye)
        depths = reference_rays.ray_hit_depths(seen, eye)
        away = nearest_passes(seen, eye, depths)
        counts = away <= np.sqrt(2.0 * np.log(255.0 * seen.opacity))[:, None, None]
        counts &= reference_rays.alphas(seen, eye) > 0
        rows = {int(row): i for i, row in enumerate(seen.row)}
        rng = np.random.default_rng(seed)
        sources = visible.sources[visible.order]
        for record, ray_hit, source in zip(visible.records, visible.ray_hits, sources, strict=True):
            i = rows[int(source)]
            hits = np.argwhere(counts[i])
            for y, x in rng.permutation(hits)[:PIXELS].tolist():
                expected = depths[i, y, x]
                if expected <= eye.near:  # the ray hit is behind the eye, or nearly
                    continue
                found = found_depth(record, ray_hit, x, y, model == "orthographic")
                assert found == pytest.approx(expected, rel=1e-4)
                tried += 1
    assert tried > 100


@pytest.mark.parametrize("tilt", [0.0, 60.0, 85.0, 89.9])
def test_a_disc_without_thickness_is_met_where_the_ray_meets_its_plane(
    device: Device, tilt: float
) -> None:
    """Up to nearly edge on. Oracle: the point where a ray meets a plane."""
    eye = replace(lens(), size=(60, 44), focal=(60.0, 64.0), center=(30.0, 22.0))
    half = np.radians(tilt) / 2
    cloud = SplatCloud(
        positions=np.float32([[0.1, -0.2, 0.0]]),
        scales=np.float32([[0.8, 0.8, 0.0]]),
        rotations=np.float32([[np.cos(half), np.sin(half), 0, 0]]),
        opacities=np.float32([1.0]),
        sh=np.zeros((1, 1, 3), np.float32),
    )
    visible = look(device, cloud, np.eye(4), eye)
    normal = np.array([0.0, -np.sin(2 * half), np.cos(2 * half)])
    center = np.array([0.1, -0.2, 4.0])
    record, ray_hit = visible.records[0], visible.ray_hits[0]
    tried = 0
    for y in range(44):
        for x in range(0, 60, 7):
            ray = np.array([(x + 0.5 - 30) / 60, (y + 0.5 - 22) / 64, 1.0])
            depth = normal @ center / (normal @ ray)
            if np.linalg.norm(depth * ray - center) < 0.8 * 3.3 and depth > 0:
                found = found_depth(record, ray_hit, x, y, False)
                assert found == pytest.approx(depth, rel=1e-4)
                tried += 1
    assert tried > 5


def test_a_peak_never_leaves_its_ellipsoid(device: Device) -> None:
    """Rays that only the low-pass filter lets through keep a depth near the splat's. Oracle: the
    depths at which the ellipsoid of what counts begins and ends."""
    eye = lens()
    cloud = cloud_of("needle", 5)
    visible = look(device, cloud, np.eye(4), eye)
    seen = reference.footprints([(cloud, np.eye(4))], eye)
    rows = {int(row): i for i, row in enumerate(seen.row)}
    sources = visible.sources[visible.order]
    for record, ray_hit, source in zip(visible.records, visible.ray_hits, sources, strict=True):
        i = rows[int(source)]
        power = 2.0 * np.log(255.0 * seen.opacity[i])
        reach = np.sqrt(power * seen.covariance[i, 2, 2])
        z = seen.camera[i, 2]
        for dx in (-40, -2, 0, 3, 50):
            found = found_depth(record, ray_hit, record[U] + dx, record[V] - dx, False)
            assert abs(found - z) <= reach * 1.0001 + 1e-6 * z
