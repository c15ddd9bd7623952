"""Compute new colours of splats under the lights of a scene, to be authored on a stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core import sh
from usdsplat.core.cloud import F32
from usdsplat.images.color import decode_light, encode_light
from usdsplat.kernels.device import Device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.lighting import Lighting
from usdsplat.render.lights.needs import with_catchers
from usdsplat.render.lights.sampling import sphere_points
from usdsplat.render.renderer import open_rasterizer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View

DIRECTIONS = 64
"""Number of view directions in which colours are fitted."""
BLOCK = 1 << 14
"""Number of splats that are fitted at a time."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FittedColors:
    """Harmonics of relit splats."""

    sh: F32
    """Shape (n, k, 3)."""
    error: float
    """Root mean square of the difference to the relit colours over all directions, in the space of
    the field."""
    worst: float
    """Largest difference."""


def field_gains(
    device: Device, scene: RenderScene, settings: RenderSettings, buffers: FrameBuffers
) -> dict[str, F32]:
    """Return the gains of the fields that are drawn once, by path, shape (n, 3) each.

    Fields whose splats keep their light, trees, and fields with several instances, whose splats
    would have several gains, have none.

    Args:
        settings: Resolved settings; those of light count.
        buffers: Keep what the next call for this scene needs again, as the cuts of trees.
    """
    layout = scene.draw_list()
    view = with_catchers(scene, View(camera=CameraSpec(), framing=Framing()))
    light = Lighting(open_rasterizer(device), buffers, settings, scene, view, layout)
    paths = {id(field): path for path, field, _ in scene.drawn()}
    found = {}
    for group in layout.groups:
        if group.slot in light.gains and len(group.field.instances) == 1:
            gains = np.array(device.fetch(light.gains[group.slot].factors))
            found[paths[id(group.field)]] = gains
    return found


def fit_colors(harmonics: F32, gains: F32, space: str) -> FittedColors:
    """Return harmonics whose colours are those of others times gains in linear light.

    Colours in an encoded space are no linear function of linear light, so new harmonics are fitted
    in all directions, by least squares. Harmonics of splats with a gain of 1 are kept.

    Args:
        harmonics: Shape (n, k, 3).
        gains: Factors on linear Rec.709, shape (n, 3).
        space: Colour space of the harmonics.
    """
    degree = round(harmonics.shape[1] ** 0.5) - 1
    rows = sh.basis(sphere_points(DIRECTIONS), degree)
    fit = np.linalg.pinv(rows)
    found, square, worst = harmonics.copy(), 0.0, 0.0
    for first in range(0, len(harmonics), BLOCK):
        part = slice(first, first + BLOCK)
        before = harmonics[part].astype(np.float64)
        colors = np.einsum("mk,nkc->nmc", rows, before) + 0.5
        wanted = encode_light(decode_light(colors, space) * gains[part, None, :], space)
        after = np.einsum("km,nmc->nkc", fit, wanted - 0.5)
        changed = (gains[part] != 1).any(axis=1)
        found[part][changed] = after[changed]
        error = np.einsum("mk,nkc->nmc", rows, after) + 0.5 - wanted
        error = np.abs(error[changed & np.isfinite(error).all(axis=(1, 2))])
        square += float((error**2).sum())
        worst = max(worst, float(error.max(initial=0.0)))
    count = max(1, len(harmonics) * DIRECTIONS * 3)
    return FittedColors(sh=found, error=(square / count) ** 0.5, worst=worst)
