"""The light of one afternoon, baked: sun with shadows, sky with occlusion, reflections as harmonics.

A capture holds display-referred colour, so radiance is tone mapped and encoded first and projected
on the harmonics then, as training does.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core import quaternion, sh
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.interchange.procedural.patch import Patch, unit

DEGREE = 3
SUN = unit(np.array([0.55, 0.62, 0.56]))
SUN_COLOR = np.array([3.3, 2.75, 2.1])
ZENITH = np.array([0.34, 0.52, 0.92])
HORIZON = np.array([1.02, 0.92, 0.80])
GROUND = np.array([0.16, 0.13, 0.10])

_SKY_DIRECTIONS = 28
_FIT_DIRECTIONS = 72
_CHUNK = 1 << 12


def bake(patches: list[Patch]) -> SplatCloud:
    """Light the patches together and make them one cloud, harmonics of degree 3, frame "rub"."""
    positions = np.concatenate([patch.positions for patch in patches])
    sizes = np.concatenate([np.sort(patch.sigmas, axis=1)[:, 1] for patch in patches])
    normals = np.concatenate([patch.normals for patch in patches])
    soft = np.concatenate([np.full(len(p), p.is_strand or p.finish.translucency > 0) for p in patches])
    sun = _visibility(positions, normals, sizes, SUN, cell=0.0055, taps=12)
    sky, openness = _sky_light(positions, normals, sizes, soft)
    parts, first = [], 0
    for patch in patches:
        rows = slice(first, first + len(patch))
        parts.append(_harmonics(patch, sun[rows], sky[rows], openness[rows]))
        first = rows.stop
    opacity = [np.full(len(patch), patch.finish.opacity, np.float32) for patch in patches]
    return SplatCloud(
        positions=positions.astype(np.float32),
        scales=np.concatenate([patch.sigmas for patch in patches]).astype(np.float32),
        rotations=np.concatenate(
            [quaternion.from_matrix(patch.axes) for patch in patches]
        ).astype(np.float32),
        opacities=np.concatenate(opacity),
        sh=np.concatenate(parts),
    )


def _visibility(
    positions: F64, normals: F64, sizes: F64, toward: F64, *, cell: float, taps: int
) -> F64:
    """Share of a distant light that reaches each splat [0..1], by a depth map as the light sees it."""
    right = unit(np.cross([0.0, 1.0, 0.0], toward) + [1e-9, 0, 0])
    up = np.cross(toward, right)
    depth = -(positions @ toward)
    plane = np.stack([positions @ right, positions @ up], axis=1)
    low = plane.min(axis=0) - 4 * cell
    width, height = (np.ceil((plane.max(axis=0) - low) / cell).astype(int) + 5).tolist()
    nearest = np.full((width, height), np.inf)
    at = ((plane - low) / cell).astype(int)
    order = np.argsort(-depth)  # the last to write a cell is the nearest to the light
    nearest[at[order, 0], at[order, 1]] = depth[order]
    for axis in (0, 1):  # close the gaps between neighbours of one surface
        nearest = np.minimum(nearest, np.minimum(np.roll(nearest, 1, axis), np.roll(nearest, -1, axis)))
    facing = np.abs(normals @ toward)
    bias = cell * (2.0 + 2.5 * np.sqrt(1 - facing**2) / np.maximum(facing, 0.2)) + sizes
    seen = np.zeros(len(positions))
    for tap in range(taps):
        radius, angle = 2.6 * math.sqrt((tap + 0.5) / taps), 2.399963 * tap
        offset = radius * np.array([math.cos(angle), math.sin(angle)])
        i, j = ((plane - low) / cell + offset).astype(int).T
        seen += depth - bias <= nearest[np.clip(i, 0, width - 1), np.clip(j, 0, height - 1)]
    return seen / taps


def _sky_light(positions: F64, normals: F64, sizes: F64, soft: F64) -> tuple[F64, F64]:
    """Irradiance from the sky over pi, occluders heeded, shape (n, 3), and openness [0..1]."""
    i = np.arange(_SKY_DIRECTIONS) + 0.5
    y, angle = 1 - i / _SKY_DIRECTIONS, i * 2.399963
    radius = np.sqrt(1 - y * y)
    light, weight, opened = np.zeros_like(positions), np.zeros(len(positions)), 0.0
    for toward in np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1):
        facing = normals @ toward
        cosine = np.where(soft, 0.6, np.maximum(facing, 0.0))
        seen = cosine * _visibility(positions, normals, sizes, toward, cell=0.014, taps=4)
        light += seen[:, None] * environment(toward[None])
        opened = opened + seen
        weight += cosine
    bounce = np.maximum(0.0, 0.5 - 0.5 * normals[:, 1])[:, None] * GROUND
    light = light / (0.5 * _SKY_DIRECTIONS) + bounce
    return light, opened / np.maximum(weight, 1e-6)


def environment(directions: F64) -> F64:
    """Linear radiance of the surroundings without the sun's disc, shape (..., 3)."""
    height = directions[..., 1:2]
    above = HORIZON + (ZENITH - HORIZON) * np.clip(height, 0, 1) ** 0.55
    below = HORIZON * 0.35 + (GROUND - HORIZON * 0.35) * np.clip(-height * 3, 0, 1)
    return np.where(height > 0, above, below)


def _harmonics(patch: Patch, sun: F64, sky: F64, openness: F64) -> F32:
    """Coefficients of one patch, shape (n, 16, 3)."""
    toward_eye, fit = _fit()
    out = np.empty((len(patch), sh.coefficient_count(DEGREE), 3), np.float32)
    for first in range(0, len(patch), _CHUNK):
        rows = slice(first, first + _CHUNK)
        diffuse = _diffuse(patch, rows, sun[rows], sky[rows])
        if patch.finish.gloss == 0 and patch.finish.translucency == 0:
            out[rows, 1:] = 0
            out[rows, 0] = sh.rgb_to_dc(display(diffuse))
            continue
        seen = diffuse[:, None] + _view_dependent(patch, rows, toward_eye, sun[rows], openness[rows])
        out[rows] = np.einsum("kd,ndc->nkc", fit, display(seen) - 0.5, optimize=True)
    return out


def _diffuse(patch: Patch, rows: slice, sun: F64, sky: F64) -> F64:
    """Linear colour that is the same from everywhere, shape (n, 3)."""
    if patch.is_strand:  # a thin cylinder gathers by the sine to its tangent
        facing = np.sqrt(1 - (patch.axes[rows, :, 0] @ SUN) ** 2) * 0.62
    else:
        raw, through = patch.normals[rows] @ SUN, patch.finish.translucency
        facing = np.maximum(raw, 0) * (1 - through) + through * (0.35 + 0.3 * np.abs(raw))
    return patch.albedo[rows] * (sky + (facing * sun)[:, None] * SUN_COLOR / math.pi * 1.25)


def _view_dependent(patch: Patch, rows: slice, toward_eye: F64, sun: F64, openness: F64) -> F64:
    """Linear radiance added toward each fitted direction, shape (n, directions, 3)."""
    finish = patch.finish
    cosine, mirrored = _mirror(patch, rows, toward_eye)
    fresnel = (1 - np.minimum(cosine * cosine, 1)) ** 2.5
    base = np.array(finish.specular)
    if finish.film:
        thickness = np.broadcast_to(patch.film, len(patch))[rows]
        base = base + finish.film * (_film(cosine, thickness) - base)
    reflectance = base + (1 - base) * fresnel[..., None]
    lobe = np.exp(finish.sharpness * (mirrored @ SUN - 1)) * sun[:, None]
    around = environment(mirrored) * openness[:, None, None]
    shine = around + lobe[..., None] * SUN_COLOR * (0.25 * finish.sharpness)
    glow = 0.0
    if finish.translucency:  # leaves against the sun light up
        behind = np.maximum(-(toward_eye @ SUN), 0) ** 2
        glow = finish.translucency * behind[:, None] * SUN_COLOR * 0.55
        glow = glow * (patch.albedo[rows] * sun[:, None])[:, None]
    return finish.gloss * reflectance * shine + glow


def _mirror(patch: Patch, rows: slice, toward_eye: F64) -> tuple[F64, F64]:
    """Cosine to the normal (n, d) and mirrored directions (n, d, 3), smooth over the whole sphere."""
    if not patch.is_strand:
        normals = patch.normals[rows]
        cosine = normals @ toward_eye.T
        return np.abs(cosine), 2 * cosine[..., None] * normals[:, None] - toward_eye
    tangents = patch.axes[rows, :, 0]
    along = tangents @ toward_eye.T
    across = toward_eye - along[..., None] * tangents[:, None]  # length is the cosine
    cosine = np.sqrt(np.maximum(1 - along * along, 1e-6))
    return cosine, 2 * across - toward_eye


def _film(cosine: F64, thickness: F64) -> F64:
    """Interference colours of a thin film over nacre, shape (n, d, 3).

    Source: Born & Wolf, "Principles of Optics", 7.6: two beams, path 2 d cos(theta) in the film.
    """
    inside = np.sqrt(1 - (1 - np.minimum(cosine * cosine, 1)) / 1.55**2)
    path = 4 * math.pi * (thickness[:, None] * inside)[..., None] / np.array([640.0, 545.0, 455.0])
    return 0.5 - 0.5 * np.cos(path)


def display(linear: F64) -> F64:
    """Tone mapped and sRGB-encoded, each channel in [0, 1)."""
    x = linear * 0.95
    mapped = np.clip((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    return np.where(mapped <= 0.0031308, 12.92 * mapped, 1.055 * mapped ** (1 / 2.4) - 0.055)


def _fit() -> tuple[F64, F64]:
    """Directions toward the eye (d, 3) and the smoothed least-squares projection (16, d)."""
    i = np.arange(_FIT_DIRECTIONS) + 0.5
    y, angle = 1 - 2 * i / _FIT_DIRECTIONS, i * 2.399963
    radius = np.sqrt(1 - y * y)
    toward_eye = np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)
    values = sh.basis(-toward_eye, DEGREE)  # harmonics take the direction from the eye
    degree = np.sqrt(np.arange(values.shape[1])).astype(int)
    ridge = np.diag(0.02 * _FIT_DIRECTIONS / (4 * math.pi) * degree.astype(float) ** 2)
    return toward_eye, np.linalg.solve(values.T @ values + ridge, values.T)
