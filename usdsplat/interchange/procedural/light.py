"""The light of one afternoon, baked: sun with shadows, sky with occlusion, reflections as harmonics.

A capture holds display-referred colour, so radiance is tone mapped and encoded first and projected
on the harmonics then, as training does.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from usdsplat.core import quaternion, sh
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.interchange.procedural.patch import Patch, unit

DEGREE = 3
SUN = unit(np.array([0.62, 0.60, 0.50]))
SUN_COLOR = np.array([3.3, 2.75, 2.1])
ZENITH = np.array([0.40, 0.52, 0.76])
HORIZON = np.array([0.96, 0.84, 0.70])
GROUND = np.array([0.13, 0.11, 0.08])
EXPOSURE = 0.62

_SKY_DIRECTIONS = 16
_FIT_DIRECTIONS = 50  # integrates products of two harmonics of degree 3
_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
_CHUNK = 1 << 11


def bake(patches: list[Patch]) -> SplatCloud:
    """Light the patches together and make them one cloud, harmonics of degree 3, frame "rub"."""
    positions = _joined([patch.positions for patch in patches])
    normals = _joined([patch.normals for patch in patches])
    sizes = _joined([np.sort(patch.sigmas, axis=1)[:, 1] for patch in patches])
    hairy = np.concatenate([np.full(len(patch), patch.is_strand) for patch in patches])
    sun = _visibility(positions, normals, sizes, SUN.astype(np.float32), cell=0.0055, taps=12)
    sky, openness = _sky_light(positions, normals, sizes, hairy)
    parts, first = [], 0
    for patch in patches:
        rows = slice(first, first + len(patch))
        parts.append(_harmonics(patch, sun[rows], sky[rows], openness[rows]))
        first = rows.stop
    return SplatCloud(
        positions=positions,
        scales=_joined([patch.sigmas for patch in patches]),
        rotations=_joined([quaternion.from_matrix(patch.axes) for patch in patches]),
        opacities=_joined([np.full(len(patch), patch.finish.opacity) for patch in patches]),
        sh=np.concatenate(parts),
    )


def _joined(parts: list[F64]) -> F32:
    """One float32 array."""
    return np.concatenate(parts).astype(np.float32)


def _visibility(
    positions: F32, normals: F32, sizes: F32, toward: F32, *, cell: float, taps: int
) -> F32:
    """Share of a distant light that reaches each splat [0..1], by a depth map as it sees them."""
    right = unit(np.cross(np.float32([1e-6, 1, 0]), toward))
    depth = -(positions @ toward)
    x = positions @ (right / np.float32(cell))
    y = positions @ (np.cross(toward, right) / np.float32(cell))
    x, y = x - (x.min() - 4), y - (y.min() - 4)
    width, height = int(x.max()) + 5, int(y.max()) + 5
    nearest = np.full((width, height), np.inf, np.float32)
    np.minimum.at(nearest.reshape(-1), x.astype(int) * height + y.astype(int), depth)
    for axis in (0, 1):  # close the gaps between neighbours of one surface
        beside = np.minimum(np.roll(nearest, 1, axis), np.roll(nearest, -1, axis))
        nearest = np.minimum(nearest, beside)
    facing = np.abs(normals @ toward)
    slope = np.sqrt(1 - np.minimum(facing * facing, 1)) / np.maximum(facing, 0.2)
    front = depth - sizes - cell * (2.0 + 2.5 * slope)
    seen = np.zeros(len(positions), np.float32)
    for tap in range(taps):
        radius, angle = 2.6 * math.sqrt((tap + 0.5) / taps), _GOLDEN_ANGLE * tap
        i = (x + np.float32(radius * math.cos(angle))).astype(int)
        j = (y + np.float32(radius * math.sin(angle))).astype(int)
        seen += front <= nearest.reshape(-1)[i * height + j]
    return seen / taps


def _sky_light(positions: F32, normals: F32, sizes: F32, hairy: F64) -> tuple[F32, F32]:
    """Irradiance from the sky over pi, occluders heeded, shape (n, 3), and openness [0..1]."""
    directions = _spread(2 * _SKY_DIRECTIONS)[:_SKY_DIRECTIONS].astype(np.float32)  # upper half
    light, weight, opened = np.zeros_like(positions), 0.0, 0.0
    for toward, radiance in zip(directions, environment(directions), strict=True):
        cosine = np.where(hairy, 0.6, np.maximum(normals @ toward, 0.0))
        seen = cosine * _visibility(positions, normals, sizes, toward, cell=0.014, taps=4)
        light += seen[:, None] * radiance
        opened, weight = opened + seen, weight + cosine
    bounce = np.maximum(0.0, 0.5 - 0.5 * normals[:, 1])[:, None] * GROUND
    return light / (0.5 * _SKY_DIRECTIONS) + bounce, opened / np.maximum(weight, 1e-6)


def environment(directions: F64) -> F64:
    """Linear radiance of the surroundings without the sun's disc, shape (..., 3)."""
    height = directions[..., 1:2]
    above = np.sqrt(np.clip(height, 0, 1))
    below = np.clip(height * -3, 0, 1)
    horizon = np.asarray(HORIZON, directions.dtype)
    sky = above * (np.asarray(ZENITH, directions.dtype) - horizon) + horizon
    ground = below * np.asarray(GROUND - 0.35 * HORIZON, directions.dtype) + 0.35 * horizon
    return np.where(height > 0, sky, ground)


def _harmonics(patch: Patch, sun: F64, sky: F64, openness: F64) -> F32:
    """Coefficients of one patch, shape (n, 16, 3)."""
    out = np.zeros((len(patch), sh.coefficient_count(DEGREE), 3), np.float32)
    diffuse = _diffuse(patch, sun, sky)
    if patch.finish.gloss == 0:
        out[:, 0] = sh.rgb_to_dc(display(diffuse))
        return out
    toward_eye, fit = _fit()
    for first in range(0, len(patch), _CHUNK):
        rows = slice(first, first + _CHUNK)
        added = _view_dependent(patch, rows, toward_eye, sun[rows], openness[rows])
        seen = display(added + diffuse[rows, None].astype(np.float32)) - np.float32(0.5)
        out[rows] = np.matmul(fit, seen)
    return out


def _diffuse(patch: Patch, sun: F64, sky: F64) -> F64:
    """Linear colour that is the same from everywhere, shape (n, 3)."""
    if patch.is_strand:  # a thin cylinder gathers by the sine to its tangent
        facing = 0.62 * np.sqrt(1 - np.minimum((patch.axes[:, :, 0] @ SUN) ** 2, 1))
    else:
        raw, through = patch.normals @ SUN, patch.finish.translucency
        facing = np.maximum(raw, 0) * (1 - through) + through * (0.35 + 0.3 * np.abs(raw))
    return patch.albedo * (sky + 0.4 * (facing * sun)[:, None] * SUN_COLOR)


def _view_dependent(patch: Patch, rows: slice, toward_eye: F32, sun: F64, openness: F64) -> F32:
    """Linear radiance added toward each fitted direction, shape (n, directions, 3)."""
    finish = patch.finish
    sun_seen, sky_seen = sun.astype(np.float32)[:, None], openness.astype(np.float32)[:, None, None]
    toward_sun, sun_color = SUN.astype(np.float32), SUN_COLOR.astype(np.float32)
    cosine, mirrored = _mirror(patch, rows, toward_eye)
    grazing = 1 - np.minimum(cosine * cosine, 1)
    base = np.array(finish.specular, np.float32)
    if finish.film:
        thickness = np.broadcast_to(patch.film, len(patch))[rows].astype(np.float32)
        base = base + np.float32(finish.film) * (_film(grazing, thickness) - base)
    reflectance = base + (1 - base) * (grazing * grazing * np.sqrt(grazing))[..., None]
    lobe = np.exp(np.float32(finish.sharpness) * (mirrored @ toward_sun - 1)) * sun_seen
    shine = environment(mirrored) * sky_seen
    shine += lobe[..., None] * (sun_color * np.float32(0.25 * finish.sharpness))
    added = np.float32(finish.gloss) * reflectance * shine
    if finish.translucency:  # leaves between the eye and the sun light up
        behind = np.maximum(-(toward_eye @ toward_sun), 0) ** 2 * np.float32(finish.translucency)
        lit = patch.albedo[rows].astype(np.float32) * sun_seen * sun_color
        added += behind[:, None] * np.float32(0.55) * lit[:, None]
    return added


def _mirror(patch: Patch, rows: slice, toward_eye: F32) -> tuple[F32, F32]:
    """Cosine to the normal (n, d) and mirrored directions (n, d, 3), smooth over the sphere."""
    if not patch.is_strand:
        normals = patch.normals[rows].astype(np.float32)
        cosine = normals @ toward_eye.T
        return np.abs(cosine), 2 * cosine[..., None] * normals[:, None] - toward_eye
    tangents = patch.axes[rows, :, 0].astype(np.float32)
    along = tangents @ toward_eye.T
    cosine = np.sqrt(np.maximum(1 - along * along, 0))
    return cosine, toward_eye - 2 * along[..., None] * tangents[:, None]


def _film(grazing: F32, thickness: F32) -> F32:
    """Interference colours of a thin film over nacre, shape (n, d, 3).

    Source: Born & Wolf, "Principles of Optics", 7.6: two beams, path 2 d cos(theta) in the film.
    """
    inside = np.sqrt(1 - grazing / np.float32(1.55**2))
    waves = np.array([640.0, 545.0, 455.0], np.float32) / np.float32(4 * math.pi)
    return 0.5 - 0.5 * np.cos((thickness[:, None] * inside)[..., None] / waves)


def display(linear: F64 | F32) -> F32:
    """Filmic tone curve, then sRGB's: each channel in [0, 1]. By table, the square root its index."""
    index = np.sqrt(np.clip(linear, 0, _BRIGHTEST)) * (_TABLE_SIZE / math.sqrt(_BRIGHTEST))
    return _display_table()[index.astype(np.intp)]


_BRIGHTEST, _TABLE_SIZE = 16.0, 1 << 13


@functools.cache
def _display_table() -> F32:
    """Display values over the square root of linear radiance.

    Source: Narkowicz 2015, "ACES Filmic Tone Mapping Curve"; IEC 61966-2-1 for the encoding.
    """
    x = EXPOSURE * _BRIGHTEST * np.linspace(0, 1, _TABLE_SIZE + 1) ** 2
    y = np.clip((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    return np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055).astype(np.float32)


@functools.cache
def _fit() -> tuple[F32, F32]:
    """Directions toward the eye (d, 3) and the smoothed least-squares projection (16, d)."""
    toward_eye = _spread(_FIT_DIRECTIONS)
    values = sh.basis(-toward_eye, DEGREE)  # harmonics take the direction from the eye
    degree = np.sqrt(np.arange(values.shape[1])).astype(int)
    ridge = np.diag(0.015 * _FIT_DIRECTIONS / (4 * math.pi) * degree**2.0)
    fit = np.linalg.solve(values.T @ values + ridge, values.T)
    return toward_eye.astype(np.float32), fit.astype(np.float32)


def _spread(count: int) -> F64:
    """Unit vectors spread evenly over the sphere, from the top down, shape (count, 3)."""
    i = np.arange(count) + 0.5
    y, angle = 1 - 2 * i / count, i * _GOLDEN_ANGLE
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)
