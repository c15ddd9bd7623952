"""Evaluate every pixel's ray in plain float64 NumPy: the oracle of `ray_hit`, `walk`, surfaces
and holdouts.

All splats are evaluated at all pixels, so this is for small scenes. A Gaussian's maximum along a
ray is computed with the inverse of its covariance, as in the published formula.

Source: Radl et al. 2024, "StopThePop", equation for the point of maximum contribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.kernels.reference import Footprints, Lens


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """Contributions to every pixel in the pixel's order, along the first axis."""

    weight: F64
    """Opacity times the transmittance in front, 0 from the end of a pixel on, shape (n, h, w)."""
    alpha: F64
    """Shape (n, h, w)."""
    depth: F64
    """Key of the order, or depths of ray hits, shape (n, h, w)."""
    splat: npt.NDArray[Any]
    """Row in the footprints, shape (n, h, w)."""
    color: F64
    """Premultiplied RGBA, shape (h, w, 4)."""
    through: F64
    """Transmittance of all splats, mattes included, shape (h, w)."""


def ray_hit_depths(seen: Footprints, lens: Lens) -> F64:
    """Return where each pixel's ray hits each splat: planar depth, shape (n, h, w).

    Depths are clamped to those of the ellipsoid of the cutoff, and to the near plane.
    """
    width, height = lens.size
    u = (np.arange(width) + 0.5 - lens.center[0]) / lens.focal[0]
    v = (np.arange(height) + 0.5 - lens.center[1]) / lens.focal[1]
    rays = np.stack([*np.meshgrid(u, v), np.ones((height, width))], axis=-1)
    inverse = np.linalg.inv(seen.covariance)
    if lens.model == "orthographic":
        origin, along = rays * (1.0, 1.0, 0.0), np.array([0.0, 0.0, 1.0])
        toward = seen.camera[:, None, None] - origin
        m = inverse @ along
        depth = np.einsum("nhwi,ni->nhw", toward, m) / (m @ along)[:, None, None]
    else:
        top = np.einsum("hwi,nij,nj->nhw", rays, inverse, seen.camera)
        depth = top / np.einsum("hwi,nij,hwj->nhw", rays, inverse, rays)
    reach = np.sqrt(2.0 * np.log(255.0 * seen.opacity) * seen.covariance[:, 2, 2])
    z = seen.camera[:, 2]
    held = np.clip(depth, (z - reach)[:, None, None], (z + reach)[:, None, None])
    return np.maximum(held, lens.near)


def alphas(seen: Footprints, lens: Lens) -> F64:
    """Return the contribution of each splat alone at each pixel, shape (n, h, w)."""
    width, height = lens.size
    inverse = np.linalg.inv(seen.screen)
    dx = np.arange(width) + 0.5 - seen.pixel[:, :1]
    dy = np.arange(height) + 0.5 - seen.pixel[:, 1:]
    offset = np.stack(np.broadcast_arrays(dx[:, None, :], dy[:, :, None]), axis=-1)
    power = np.einsum("nhwi,nij,nhwj->nhw", offset, inverse, offset)
    alpha = seen.opacity[:, None, None] * np.exp(-0.5 * power)
    return np.where(alpha < 1.0 / 255.0, 0.0, np.minimum(alpha, 0.999))


def trace(
    seen: Footprints,
    lens: Lens,
    *,
    sort_by_ray_hit: bool,
    occluder_depth: F64 | None = None,
    keeps: F64 | None = None,
) -> Rays:
    """Blend every pixel in the order of its contributions.

    Args:
        seen: Footprints of the visible splats.
        sort_by_ray_hit: Whether the order is by ray hits, or that of `seen`.
        occluder_depth: Depth of surfaces, shape (h, w). Ray hits behind them are skipped.
        keeps: 0 for splats of mattes, shape (n,).
    """
    alpha, ray_hits = alphas(seen, lens), ray_hit_depths(seen, lens)
    if occluder_depth is not None:
        alpha = np.where(ray_hits <= occluder_depth, alpha, 0.0)
    depth = (
        ray_hits if sort_by_ray_hit else np.broadcast_to(seen.camera[:, 2, None, None], alpha.shape)
    )
    key = np.where(alpha > 0, depth, np.inf)
    order = np.argsort(key, axis=0, kind="stable") if sort_by_ray_hit else None
    splat = np.broadcast_to(np.arange(len(alpha))[:, None, None], alpha.shape)
    if order is not None:
        alpha = np.take_along_axis(alpha, order, axis=0)
        depth = np.take_along_axis(depth, order, axis=0)
        splat = np.take_along_axis(splat, order, axis=0)
    through = np.ones(alpha.shape[1:])
    weight = np.zeros(alpha.shape)
    ended = np.zeros(alpha.shape[1:], bool)
    for k in range(len(alpha)):
        after = through * (1.0 - alpha[k])
        ended |= (alpha[k] > 0) & (after < 1e-4)
        weight[k] = np.where(ended, 0.0, through * alpha[k])
        through = np.where(ended, through, after)
    if keeps is not None:
        weight = weight * keeps[splat]
    rgb = np.einsum("nhw,nhwc->hwc", weight, seen.color[splat])
    color = np.concatenate([rgb, weight.sum(axis=0)[..., None]], axis=-1)
    return Rays(weight=weight, alpha=alpha, depth=depth, splat=splat, color=color, through=through)


def median(rays: Rays, part: float, whole: F64) -> F64:
    """Return the depth at which `part` of the coverage `whole` is reached, +inf where it never is,
    (h, w)."""
    passed = (np.cumsum(rays.weight, axis=0) >= part * whole - 1e-9) & (rays.weight > 0)
    first = passed.argmax(axis=0)
    depth = np.take_along_axis(rays.depth, first[None], axis=0)[0]
    return np.where(passed.any(axis=0), depth, np.inf)


def held_through(front: F64, back: F64, alpha: F64, depth: F64) -> F64:
    """Return the transmittance of a deep pixel in front of each depth: the product over its
    samples.

    Args:
        front, back, alpha: Ends and opacities of the samples, shape (n,).
        depth: Any shape.
    """
    passed = np.ones(np.shape(depth))
    for near, far, a in zip(front, back, alpha, strict=True):
        if far > near:
            part = np.clip((depth - near) / (far - near), 0.0, 1.0)
        else:
            part = np.where(near < depth, 1.0, 0.0)
        passed *= np.where(part > 0, (1.0 - a) ** part, 1.0)
    return passed
