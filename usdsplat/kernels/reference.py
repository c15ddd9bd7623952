"""Render the picture in plain float64 NumPy: slow, readable, and the oracle of the fast kernels.

The code follows the formulas of image formation: matrices are matrices, the Gaussian is evaluated
with its inverse covariance, and splats are blended one after another over the whole box that they
may touch. It shares no formula with the kernels.

Source: Kerbl et al. 2023, "3D Gaussian Splatting"; Zwicker et al. 2002, "EWA Splatting".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core import sh as harmonics
from usdsplat.core.cloud import F32, F64, SplatCloud


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Camera in pixels: x right, y down, z forward; pixel centres at +0.5."""

    world_to_camera: F64
    """Shape (4, 4), OpenCV axes."""
    focal: tuple[float, float]
    """Focal lengths [pixel]; for an orthographic lens [pixel / scene unit]."""
    center: tuple[float, float]
    """Principal point [pixel]."""
    size: tuple[int, int]
    """Width and height [pixel]."""
    near: float = 0.01
    far: float = 1e10
    model: str = "perspective"
    """perspective, tangential or orthographic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """Picture of the reference renderer."""

    color: F64
    """Premultiplied RGBA, shape (h, w, 4)."""
    depth: F64
    """Planar depth of the splat at which half of the coverage is reached, +inf where nothing is,
    (h, w)."""
    element: F64
    """Row of that splat in the concatenation of the clouds, -1 where nothing is, (h, w)."""


def _matrices(q: F64) -> F64:
    """Return rotation matrices of unit quaternions (w, x, y, z), from the sandwich product with
    unit vectors."""
    w, v = q[:, :1], q[:, 1:]
    columns = []
    for axis in np.eye(3):
        e = np.broadcast_to(axis, v.shape)
        t = 2.0 * np.cross(v, e)
        columns.append(e + w * t + np.cross(v, t))
    return np.stack(columns, axis=2)


def _jacobians(lens: Lens, p: F64) -> F64:
    """Return affine maps from camera space to pixels at centres `p`, shape (n, 2, 3)."""
    fx, fy = lens.focal
    width, height = lens.size
    jacobian = np.zeros((len(p), 2, 3))
    if lens.model == "orthographic":
        jacobian[:, 0, 0], jacobian[:, 1, 1] = fx, fy
        return jacobian
    if lens.model == "tangential":
        distance = np.linalg.norm(p, axis=1)
        axis = np.array([0.0, 0.0, 1.0])
        for i, ray in enumerate(p / distance[:, None]):
            cross = np.cross(ray, axis)
            k = np.array(
                [[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]]
            )
            turn = np.eye(3) + k + k @ k / (1.0 + ray[2])
            jacobian[i] = np.diag([fx, fy]) @ turn[:2] / distance[i]
        return jacobian
    low_u, high_u = -lens.center[0] / fx, (width - lens.center[0]) / fx
    low_v, high_v = -lens.center[1] / fy, (height - lens.center[1]) / fy
    more_u, more_v = 0.15 * width / fx, 0.15 * height / fy
    z = p[:, 2]
    u = np.clip(p[:, 0] / z, low_u - more_u, high_u + more_u)
    v = np.clip(p[:, 1] / z, low_v - more_v, high_v + more_v)
    jacobian[:, 0, 0], jacobian[:, 0, 2] = fx / z, -fx * u / z
    jacobian[:, 1, 1], jacobian[:, 1, 2] = fy / z, -fy * v / z
    return jacobian


def _trained(lens: Lens, p: F64, size: F64) -> F64:
    """Return the low-pass of pixels of `size` [scene unit] at centres `p` in camera space [pixel²],
    at most the picture's own."""
    depth = {
        "perspective": p[:, 2],
        "tangential": np.linalg.norm(p, axis=1),
        "orthographic": np.ones(len(p)),
    }[lens.model]
    fx, fy = lens.focal
    return np.asarray(np.minimum(0.3, 0.3 * size**2 * fx * fy / depth**2))


def _directions(lens: Lens, centers: F64, linear: F64) -> F64:
    """Return view directions in a cloud's local space; `linear` is the 3x3 of its transform."""
    camera_to_world = np.linalg.inv(lens.world_to_camera)
    if lens.model == "orthographic":
        sight = np.broadcast_to(camera_to_world[:3, 2], centers.shape)
    else:
        sight = centers - camera_to_world[:3, 3]
    u, _, vt = np.linalg.svd(linear)
    local = sight @ (u @ vt)
    return local / np.linalg.norm(local, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprints:
    """Footprints of the splats that a lens sees, in order of the key; row i of every array is one
    splat."""

    pixel: F64
    """Centres [pixel], shape (n, 2)."""
    screen: F64
    """Screen covariances, the low-pass included [pixel²], shape (n, 2, 2)."""
    opacity: F64
    color: F64
    camera: F64
    """Centres in camera space, shape (n, 3)."""
    covariance: F64
    """In camera space, shape (n, 3, 3)."""
    row: Any
    """In the concatenation of the clouds, shape (n,)."""


def footprints(
    clouds: Sequence[tuple[SplatCloud, F64]],
    lens: Lens,
    *,
    footprint: float = np.inf,
    by_distance: bool = False,
    degree: int = 4,
) -> Footprints:
    """Project clouds, each with its 4x4 local-to-world matrix. For arguments see `render`."""
    parts = []
    for cloud, matrix in clouds:
        linear = matrix[:3, :3]
        centers = cloud.positions.astype(np.float64) @ linear.T + matrix[:3, 3]
        axes = linear @ _matrices(cloud.rotations.astype(np.float64)) * cloud.scales[:, None, :]
        k = min(degree + 1, cloud.sh_degree + 1) ** 2
        color = harmonics.evaluate(
            cloud.sh[:, :k].astype(np.float64), _directions(lens, centers, linear)
        )
        across = lens.world_to_camera[:2, :3] @ linear
        size = np.full(len(cloud), np.sqrt(np.sum(across**2) / 2.0))
        parts.append((centers, axes @ axes.transpose(0, 2, 1), cloud.opacities, color, size))
    centers, covariances, opacities, colors, sizes = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    view = lens.world_to_camera
    p = centers @ view[:3, :3].T + view[:3, 3]
    keep = np.flatnonzero((p[:, 2] >= lens.near) & (p[:, 2] <= lens.far))
    p, opacities = p[keep], opacities[keep].astype(np.float64)
    solid = view[:3, :3] @ covariances[keep] @ view[:3, :3].T
    jacobians = _jacobians(lens, p)
    sharp = jacobians @ solid @ jacobians.transpose(0, 2, 1)
    screen = sharp + 0.3 * np.eye(2)
    if footprint < np.inf:
        trained = sharp + _trained(lens, p, sizes[keep] * footprint)[:, None, None] * np.eye(2)
        opacities = opacities * np.sqrt(
            np.maximum(np.linalg.det(trained), 0.0) / np.linalg.det(screen)
        )
    scale = 1.0 if lens.model == "orthographic" else 1.0 / p[:, 2:]
    pixel = p[:, :2] * scale * lens.focal + lens.center
    distance = by_distance and lens.model != "orthographic"
    key = np.linalg.norm(p, axis=1) if distance else p[:, 2]
    order = np.argsort(key.astype(np.float32), kind="stable")
    order = order[opacities[order] >= 1.0 / 255.0]
    return Footprints(
        pixel=pixel[order],
        screen=screen[order],
        opacity=opacities[order],
        color=colors[keep][order],
        camera=p[order],
        covariance=solid[order],
        row=keep[order],
    )


def render(
    clouds: Sequence[tuple[SplatCloud, F64]],
    lens: Lens,
    *,
    footprint: float = np.inf,
    by_distance: bool = False,
    degree: int = 4,
) -> Picture:
    """Render clouds, each with its 4x4 local-to-world matrix, in the space of their harmonics.

    `footprint` is the size of a pixel of the photographs in the clouds' space: infinity for classic
    splats, 0 for antialiased ones. `by_distance` sorts by distance from the eye instead of planar
    depth. `degree` is the highest evaluated degree of harmonics.
    """
    seen = footprints(clouds, lens, footprint=footprint, by_distance=by_distance, degree=degree)
    return _blend(
        lens, seen.pixel, seen.screen, seen.opacity, seen.color, seen.camera[:, 2], seen.row
    )


def _blend(
    lens: Lens, pixel: F64, screen: F64, opacity: F64, color: F64 | F32, depth: F64, row: Any
) -> Picture:
    """Blend sorted splats front to back, then again to find where half of the coverage is
    reached."""
    width, height = lens.size
    inverse = np.linalg.inv(screen)
    reach = np.sqrt(2.0 * np.log(255.0 * opacity))[:, None] * np.sqrt(
        np.stack([screen[:, 0, 0], screen[:, 1, 1]], 1)
    )
    low = np.clip(np.floor(pixel - reach - 1.0), 0, lens.size).astype(int)
    high = np.clip(np.ceil(pixel + reach + 1.0), 0, lens.size).astype(int)
    ys, xs = np.arange(height) + 0.5, np.arange(width) + 0.5
    color_sum = np.zeros((height, width, 3))
    half = np.zeros((height, width))
    found_depth = np.full((height, width), np.inf)
    found = np.full((height, width), -1.0)
    for second in (False, True):
        left = np.ones((height, width))
        ended = np.zeros((height, width), bool)
        for k in np.flatnonzero(np.all(high > low, axis=1)):
            box = np.s_[low[k, 1] : high[k, 1], low[k, 0] : high[k, 0]]
            dx, dy = xs[box[1]][None, :] - pixel[k, 0], ys[box[0]][:, None] - pixel[k, 1]
            m = inverse[k]
            alpha = opacity[k] * np.exp(
                -0.5 * (m[0, 0] * dx * dx + 2.0 * m[0, 1] * dx * dy + m[1, 1] * dy * dy)
            )
            alpha = np.where(alpha < 1.0 / 255.0, 0.0, np.minimum(alpha, 0.999))
            after = left[box] * (1.0 - alpha)
            ended[box] |= after < 1e-4
            alpha = np.where(ended[box], 0.0, alpha)
            if second:
                now = (found[box] < 0) & (alpha > 0) & (after <= half[box])
                found[box] = np.where(now, row[k], found[box])
                found_depth[box] = np.where(now, depth[k], found_depth[box])
            else:
                color_sum[box] += (left[box] * alpha)[..., None] * color[k]
            left[box] *= 1.0 - alpha
        if not second:
            half = 1.0 - 0.5 * (1.0 - left)
    rgba = np.concatenate([color_sum, 1.0 - left[..., None]], axis=2)
    return Picture(color=rgba, depth=found_depth, element=found)
