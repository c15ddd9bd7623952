"""Estimate the light in which a capture was photographed from its own colours.

Colours are albedo times irradiance. Their albedo is taken for grey, GREY on average, so that light
is what depends on normals: nine harmonics, fitted robustly. The scale of albedo and that of light
cannot be told apart, and neither can a coloured light and a coloured capture.

Source: Ramamoorthi & Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps";
Huber 1981, "Robust Statistics", for the weights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core import sh
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.images.color import decode_light
from usdsplat.images.texture import LUMINANCE
from usdsplat.render.splat_normals import SurfaceValues

GREY = 0.4
"""Mean albedo of captures."""
DARKEST = 0.1
"""Least light on any normal, as a part of the mean: no capture is photographed in blackness."""
ROUNDS = 8
STIFFNESS = 1e-4
"""Weight that draws harmonics to 0 where normals do not determine them."""
HUBER = 1.345
"""Multiple of the standard deviation beyond which a colour counts less."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CapturedLight:
    """Estimated light of a capture."""

    harmonics: F64
    """Light on normals as that which a white surface reflects, linear Rec.709, shape (9, 3)."""
    residual: float
    """Part of the variation of colours that light does not explain: 0 for a grey capture, near 1
    if colours do not depend on normals."""

    def on(self, surface: SurfaceValues) -> F32:
        """Return the light on splats by their normals in local space, shape (n, 3)."""
        least = DARKEST * sh.C0 * self.harmonics[0]
        return np.maximum(_rows(surface) @ self.harmonics, least).astype(np.float32)


def estimate(cloud: SplatCloud, color_space: str, surface: SurfaceValues) -> CapturedLight:
    """Estimate the light in which a capture was photographed, in local space.

    Args:
        cloud: The splats; only colours without view dependence, opacities and sizes are used.
        color_space: Space of the colours.
        surface: Normals and confidence of the splats.
    """
    colors = sh.dc_to_rgb(cloud.sh[:, 0].astype(np.float64))
    with np.errstate(invalid="ignore"):  # sums of infinite parts, which count as 0 below
        linear = np.maximum(0.0, decode_light(colors, color_space))
    linear = np.nan_to_num(linear, posinf=0.0)
    sizes = np.sort(cloud.scales.astype(np.float64), axis=1)
    confidence = surface.facts[:, 0].astype(np.float64)
    weights = np.nan_to_num(cloud.opacities * sizes[:, 1] * sizes[:, 2], posinf=0.0) * confidence
    if not weights.sum() > 0:
        weights = np.ones(len(linear))
    weights /= weights.sum()
    found = CapturedLight(harmonics=_fitted(_rows(surface), linear / GREY, weights), residual=0.0)
    light = found.on(surface).astype(np.float64)
    return replace(found, residual=_residual(linear / GREY, light, weights))


def _rows(surface: SurfaceValues) -> F64:
    """Return the harmonics of degree 2 of normals, shape (n, 9); the mean where there is no
    confidence."""
    rows: F64 = sh.basis(surface.normals.astype(np.float64), 2).astype(np.float64)
    rows[:, 1:] *= surface.facts[:, :1]
    return rows


def _fitted(rows: F64, values: F64, weights: F64) -> F64:
    """Return harmonics of degree 2 that fit values at rows of the basis, shape (9, 3)."""
    stiff = STIFFNESS * np.diag([0.0, *[1.0] * 8])
    own = weights
    found = np.zeros((9, 3))
    for _ in range(ROUNDS):
        product = rows.T * own
        normal = product @ rows / max(own.sum(), 1e-300)
        target = product @ values / max(own.sum(), 1e-300)
        found = np.linalg.lstsq(normal + stiff, target, rcond=None)[0]
        distance = np.linalg.norm(rows @ found - values, axis=1)
        middle = _median(distance, weights)
        limit = HUBER * 1.4826 * middle
        own = weights * np.minimum(1.0, limit / np.maximum(distance, 1e-300))
        if not limit > 0:
            break
    return found


def _median(values: F64, weights: F64) -> float:
    """Return the weighted median."""
    order = np.argsort(values, kind="stable")
    at = np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())
    return float(values[order[min(int(at), len(order) - 1)]])


def _residual(values: F64, light: F64, weights: F64) -> float:
    """Return the part of the variation of luminance that light does not explain, [0..1]."""
    seen, lit = values @ np.array(LUMINANCE), light @ np.array(LUMINANCE)
    mean = (weights * seen).sum()
    whole = (weights * (seen - mean) ** 2).sum()
    left = (weights * (seen - lit) ** 2).sum()
    return float(np.sqrt(min(1.0, left / whole))) if whole > 1e-12 * mean**2 else 0.0
