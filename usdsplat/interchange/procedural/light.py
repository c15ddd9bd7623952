"""Light patches and convert them to a cloud with view-dependent colour.

A capture holds display-referred colour. Radiance is therefore tone mapped and encoded before it is
projected on the harmonics, as in training.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from usdsplat.core import quaternion, sh
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.interchange.procedural.patch import Patch
from usdsplat.interchange.procedural.sky import (
    SUN,
    SUN_COLOR,
    Floats,
    environment,
    sky_light,
    spread,
    sun_share,
)

DEGREE = 3
EXPOSURE = 0.62

_FIT_DIRECTIONS = 50  # integrates products of two harmonics of degree 3
_CHUNK = 1 << 11
_BRIGHTEST, _TABLE_SIZE = 16.0, 1 << 13


def bake(patches: Sequence[Patch]) -> SplatCloud:
    """Light the patches together and return them as one cloud with harmonics of degree 3."""
    positions = _joined([patch.positions for patch in patches])
    normals = _joined([patch.normals for patch in patches])
    sizes = _joined([np.sort(patch.sigmas, axis=1)[:, 1] for patch in patches])
    is_strand = np.concatenate([np.full(len(patch), patch.is_strand) for patch in patches])
    sun = sun_share(positions, normals, sizes)
    sky, openness = sky_light(positions, normals, sizes, is_strand)
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


def display(linear: Floats) -> F32:
    """Apply a filmic tone curve and sRGB's curve, by table: each channel in [0, 1]."""
    index = np.sqrt(np.clip(linear, 0, _BRIGHTEST)) * (_TABLE_SIZE / math.sqrt(_BRIGHTEST))
    return _display_table()[index.astype(np.intp)]


def _joined(parts: Sequence[Floats]) -> F32:
    """Concatenate to one float32 array."""
    return np.concatenate(parts).astype(np.float32)


def _harmonics(patch: Patch, sun: F32, sky: F32, openness: F32) -> F32:
    """Return the coefficients of a patch, shape (n, 16, 3)."""
    out = np.zeros((len(patch), sh.coefficient_count(DEGREE), 3), np.float32)
    diffuse = _diffuse(patch, sun, sky)
    if patch.finish.gloss == 0:
        out[:, 0] = sh.rgb_to_dc(display(diffuse))
        return out
    toward_eye, fit = _fit()
    for first in range(0, len(patch), _CHUNK):
        rows = slice(first, first + _CHUNK)
        added = _view_dependent(patch, rows, toward_eye, sun[rows], openness[rows])
        out[rows] = np.matmul(fit, display(added + diffuse[rows, None]) - np.float32(0.5))
    return out


def _diffuse(patch: Patch, sun: F32, sky: F32) -> F32:
    """Return linear colour without view dependence, shape (n, 3)."""
    if patch.is_strand:
        # the irradiance of a thin cylinder is proportional to the sine of the angle to its tangent
        facing = 0.62 * np.sqrt(1 - np.minimum((patch.axes[:, :, 0] @ SUN) ** 2, 1))
    else:
        raw, through = patch.normals @ SUN, patch.finish.translucency
        facing = np.maximum(raw, 0) * (1 - through) + through * (0.35 + 0.3 * np.abs(raw))
    light = sky + 0.4 * (facing * sun)[:, None] * SUN_COLOR
    return (patch.albedo * light).astype(np.float32)


def _view_dependent(patch: Patch, rows: slice, toward_eye: F32, sun: F32, openness: F32) -> F32:
    """Return the view-dependent linear radiance in each direction, shape (n, directions, 3)."""
    finish = patch.finish
    toward_sun, sun_color = SUN.astype(np.float32), SUN_COLOR.astype(np.float32)
    cosine, mirrored, sparkle = (_cylinder if patch.is_strand else _mirror)(patch, rows, toward_eye)
    grazing = 1 - np.minimum(cosine * cosine, 1)
    base = np.array(finish.specular, np.float32)
    if finish.film:
        thickness = np.broadcast_to(patch.film, len(patch))[rows].astype(np.float32)
        base = base + np.float32(finish.film) * (_film(grazing, thickness) - base)
    reflectance = base + (1 - base) * (grazing * grazing * np.sqrt(grazing))[..., None]
    shine = environment(mirrored) * openness[:, None, None]
    sparkle *= sun[:, None] * np.float32(0.25 * finish.sharpness)
    shine += sparkle[..., None] * sun_color
    added = np.float32(finish.gloss) * reflectance * shine
    if finish.translucency:  # leaves between the eye and the sun light up
        behind = np.maximum(-(toward_eye @ toward_sun), 0) ** 2 * np.float32(finish.translucency)
        lit = patch.albedo[rows].astype(np.float32) * sun[:, None] * sun_color
        added += behind[:, None] * np.float32(0.55) * lit[:, None]
    return added


def _mirror(patch: Patch, rows: slice, toward_eye: F32) -> tuple[F32, F32, F32]:
    """Return cosine to the normal (n, d), mirrored directions (n, d, 3), sun highlight (n, d).

    All are smooth over the whole sphere, including the back, to avoid ringing of the fit.
    """
    normals = patch.normals[rows].astype(np.float32)
    cosine = normals @ toward_eye.T
    mirrored = 2 * cosine[..., None] * normals[:, None] - toward_eye
    agreement = mirrored @ SUN.astype(np.float32) - 1
    return np.abs(cosine), mirrored, np.exp(np.float32(patch.finish.sharpness) * agreement)


def _cylinder(patch: Patch, rows: slice, toward_eye: F32) -> tuple[F32, F32, F32]:
    """Return the values of `_mirror` for strands: normals point all around, highlights are cones.

    Source: Marschner et al. 2003, "Light Scattering from Human Hair Fibers", the R lobe.
    """
    tangents, sun = patch.axes[rows, :, 0].astype(np.float32), SUN.astype(np.float32)
    along, sun_along = tangents @ toward_eye.T, (tangents @ sun)[:, None]
    across = np.sqrt(np.maximum(1 - along * along, 1e-6))
    sun_across = np.sqrt(np.maximum(1 - sun_along * sun_along, 1e-6))
    turned = (toward_eye @ sun - along * sun_along) / (across * sun_across)  # cosine about the axis
    agreement = across * sun_across - along * sun_along - 1
    sparkle = np.exp(np.float32(patch.finish.sharpness) * agreement)
    sparkle *= np.sqrt(np.clip(0.5 + 0.5 * turned, 0, 1))
    return across, toward_eye - 2 * along[..., None] * tangents[:, None], sparkle


def _film(grazing: F32, thickness: F32) -> F32:
    """Return interference colours of a thin film over nacre, shape (n, d, 3).

    Source: Born & Wolf, "Principles of Optics", 7.6: two beams, path 2 d cos(theta) in the film.
    """
    inside = np.sqrt(1 - grazing / np.float32(1.55**2))
    waves = np.array([640.0, 545.0, 455.0], np.float32) / np.float32(4 * math.pi)
    return 0.5 - 0.5 * np.cos((thickness[:, None] * inside)[..., None] / waves)


@functools.cache
def _display_table() -> F32:
    """Return display values by the square root of linear radiance.

    Source: Narkowicz 2015, "ACES Filmic Tone Mapping Curve"; IEC 61966-2-1 for the encoding.
    """
    x = EXPOSURE * _BRIGHTEST * np.linspace(0, 1, _TABLE_SIZE + 1) ** 2
    y = np.clip((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    return np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055).astype(np.float32)


@functools.cache
def _fit() -> tuple[F32, F32]:
    """Return directions toward the eye (d, 3) and the smoothed least-squares projection (16, d)."""
    toward_eye = spread(_FIT_DIRECTIONS)
    values = sh.basis(-toward_eye, DEGREE)  # harmonics take the direction from the eye
    degree = np.sqrt(np.arange(values.shape[1])).astype(int)
    ridge = np.diag(0.015 * _FIT_DIRECTIONS / (4 * math.pi) * degree**2.0)
    fit = np.linalg.solve(values.T @ values + ridge, values.T)
    return toward_eye.astype(np.float32), fit.astype(np.float32)
