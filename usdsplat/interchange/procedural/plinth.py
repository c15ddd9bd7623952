"""Model the plinth of the demo scene: its stone and its gold ornaments."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.materials import GILT, GOLD, MARBLE, STONE
from usdsplat.interchange.procedural.patch import (
    Patch,
    mix,
    noise,
    strands,
    sweep,
    turned,
    unit,
)

TOP = 0.124
"""Height of the drum [m]."""

_DRUM = np.array([
    (0.345, -0.010), (0.345, 0.012), (0.335, 0.020), (0.324, 0.023), (0.318, 0.030),
    (0.298, 0.036), (0.292, 0.043), (0.291, 0.081), (0.297, 0.088), (0.310, 0.094),
    (0.315, 0.101), (0.326, 0.105), (0.327, 0.118), (0.320, 0.124), (0.200, 0.124), (0.0, 0.124),
])  # fmt: skip
_CUP = np.array([
    (0.118, 0.000), (0.120, 0.007), (0.100, 0.014), (0.060, 0.020), (0.030, 0.030),
    (0.020, 0.045), (0.022, 0.052), (0.040, 0.060), (0.043, 0.067), (0.038, 0.074),
    (0.022, 0.081), (0.020, 0.090), (0.040, 0.102), (0.080, 0.112), (0.115, 0.130),
])  # fmt: skip
_PETALS = np.array([(0.112, 0.128), (0.136, 0.149), (0.155, 0.173), (0.170, 0.188)])
_KERB = np.array([
    (0.699, -0.004), (0.698, 0.008), (0.692, 0.014), (0.681, 0.016), (0.670, 0.013),
    (0.664, 0.006), (0.663, -0.004),
])  # fmt: skip
_RIM = np.array([
    (0.980, -0.040), (1.022, -0.038), (1.020, -0.028), (1.008, -0.020), (1.008, -0.012),
    (1.016, -0.006), (1.016, 0.008), (1.006, 0.016), (0.994, 0.016), (0.984, 0.010),
    (0.980, -0.008),
])  # fmt: skip
_VINES, _VINE_RADIUS = 30, 0.372  # number, and distance from the axis [m]


def drum(spacing: float) -> Patch:
    """Model the marble pedestal, fluted at the waist."""

    def flutes(radius: F64, y: F64, angle: F64) -> F64:
        waist = np.clip((y - 0.040) / 0.006, 0, 1) * np.clip((0.086 - y) / 0.006, 0, 1)
        return radius - 0.010 * waist * np.abs(np.cos(30 * angle))

    found = sweep(turned(_DRUM, flutes), spacing * 1.35)
    p = found.positions
    warp = p + 0.05 * np.stack([noise(p, scale=0.3, seed=s) for s in (1, 2, 3)], axis=1)
    vein = np.abs(noise(warp, scale=0.35, seed=4, octaves=4))
    fine = np.abs(noise(warp, scale=0.11, seed=5))
    albedo = mix((0.34, 0.36, 0.36), (0.72, 0.70, 0.66), 0.15 + vein / 0.16)
    return found.paint(albedo * (0.80 + 0.20 * np.clip(fine / 0.10, 0, 1))[:, None], MARBLE)


def stonework(spacing: float) -> list[Patch]:
    """Model the kerb around the tiles and the rim of the disc, in 72 blocks each."""
    patches = []
    for profile, step in ((_KERB, 0.9), (_RIM, 1.7)):
        found = sweep(turned(profile), spacing * step)
        share = found.t * 72
        shade = 0.9 + 0.2 * np.sin(np.floor(share) * 12.9898) * np.cos(np.floor(share) * 4.1)
        grain = noise(found.positions, scale=0.03, seed=33)
        albedo = mix((0.62, 0.55, 0.45), (0.80, 0.74, 0.64), 0.5 + 0.5 * grain)
        is_joint = np.abs(share % 1 - 0.5) > 0.485
        patches.append(found.paint(albedo * np.where(is_joint, 0.45, shade)[:, None], STONE))
    return patches


def cup(spacing: float) -> list[Patch]:
    """Model a gold foot, stem and knop that open into a calyx of eight petals."""

    def ribs(radius: F64, y: F64, angle: F64) -> F64:
        return radius * (1 + 0.012 * np.cos(40 * angle))

    whole = turned(_PETALS, base=TOP)

    def petals(s: F64, t: F64) -> F64:
        lobe = np.abs(np.cos(8 * math.pi * t))
        p = whole(s * (0.25 + 0.75 * np.sqrt(lobe**2 + 0.02)), t)
        bulge = 1 + s * (0.10 * (lobe - 0.6) + 0.012 * np.cos(80 * math.pi * t))
        return p * np.stack([bulge, np.ones_like(s), bulge], axis=1)

    surfaces = (turned(_CUP, ribs, base=TOP), petals)
    return [sweep(surface, spacing * 0.85).paint(GILT, GOLD) for surface in surfaces]


def vines(density: float, seed: int) -> list[Patch]:
    """Model gold filigree: wires that rise around the drum, cross, curl and branch, with leaves."""
    rng = np.random.default_rng([seed, 2])
    curves, radii, leaves = [], [], []
    links = max(24, round(150 * density))
    for index in range(_VINES):
        tall = index % 2 == 0
        turn = (2 * math.pi * index / _VINES, 2.4 if tall else -2.4)
        length = (0.44 if tall else 0.27) * rng.uniform(0.95, 1.05)
        stem = _curl(length, links, 1.5, (-1.2, -5.1) if tall else (0.9, 6.4))
        curves.append(_upright(stem, *turn))
        radii.append(np.linspace(0.0042, 0.0016, links))
        for share, side in ((0.26, 1), (0.42, -1)) if tall else ((0.3, -1),):
            at = round(share * links)
            heading = math.atan2(*(stem[at + 1] - stem[at])[::-1]) + 0.5 * side
            twig = stem[at] + _curl(0.13 * (1 - share), links, heading, (2.0 * side, 7.2 * side))
            curves.append(_upright(twig, *turn))
            radii.append(np.linspace(0.0026, 0.0012, links))
            leaves.append(curves[-1][links // 5 :: max(1, links // 12)])
    wires = strands(np.stack(curves), np.stack(radii), GILT, GOLD, lay=0.6)
    return [wires, _leaves(np.concatenate(leaves), rng)]


def _curl(length: float, links: int, heading: float, bend: tuple[float, float]) -> F64:
    """Return a plane curve that bends increasingly into a spiral, shape (links + 1, 2)."""
    s = np.arange(links) / links
    angle = heading + bend[0] * s + bend[1] * s**4
    steps = length / links * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _upright(plane: F64, angle: float, swirl: float) -> F64:
    """Place a curve of the (outward, up) plane around the drum; `swirl` leans it [rad / m]."""
    out, up = _VINE_RADIUS + plane[:, 0], plane[:, 1] + 0.004
    about = angle + swirl * plane[:, 1]
    return np.stack([out * np.cos(about), up, out * np.sin(about)], axis=1)


def _leaves(points: F64, rng: np.random.Generator) -> Patch:
    """Model flat gold leaves at points, facing roughly outward."""
    n = len(points)
    outward = unit(points * [1, 0.3, 1] + rng.normal(0, 0.25, (n, 3)))
    u = unit(np.cross(outward, rng.normal(size=(n, 3))))
    return Patch(
        positions=points + 0.004 * u,
        axes=np.stack([u, np.cross(outward, u), outward], axis=2),
        sigmas=rng.uniform(0.7, 1.1, (n, 1)) * [0.0046, 0.0022, 0.0003],
        albedo=np.broadcast_to(GILT, points.shape),
        finish=GOLD,
    )
