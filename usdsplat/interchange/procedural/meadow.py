"""Model the meadow around the pavement: soil, grass, flowers."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.materials import EARTH, LEAF, PETAL
from usdsplat.interchange.procedural.patch import (
    Patch,
    mix,
    noise,
    strands,
    sweep,
    turned,
    unit,
)

INNER, OUTER = 0.695, 0.985
"""Radii of the meadow [m]."""

Kinds = npt.NDArray[np.int64]
_UP = np.array([0.0, 1.0, 0.0])
# Poppy, daisy, cornflower.
_SHARES = (0.42, 0.34, 0.24)
_PETALS = np.array([5, 11, 8])
_COLORS = np.array([(0.75, 0.035, 0.015), (0.86, 0.85, 0.80), (0.10, 0.10, 0.62)])
_HEARTS = np.array([(0.02, 0.015, 0.02), (0.80, 0.45, 0.02), (0.16, 0.03, 0.25)])
_LENGTHS = np.array([0.0068, 0.0062, 0.0055])  # [m]
_WIDTHS = np.array([0.85, 0.30, 0.42])  # relative to the length
_CUPPED = np.array([0.75, 0.15, 0.45])  # slope of the petals
_DOTS = 7


def soil(spacing: float) -> Patch:
    """Model earth and moss under the grass."""
    found = sweep(turned(np.array([(OUTER, -0.002), (INNER, -0.002)])), spacing * 2.4)
    moss = noise(found.positions, scale=0.1, seed=34)
    return found.paint(mix((0.060, 0.048, 0.024), (0.060, 0.110, 0.025), 0.5 + 0.7 * moss), EARTH)


def grass(blades: int, seed: int) -> Patch:
    """Model bent blades of four splats each, in tufts."""
    rng = np.random.default_rng(seed)
    root = _roots(blades, rng)
    tuft = noise(root, scale=0.13, seed=seed)
    height = (0.036 + 0.030 * np.clip(tuft, -0.6, 1)) * rng.uniform(0.6, 1.35, blades)
    heading = rng.uniform(0, 2 * math.pi, blades)
    wind = 0.35 * noise(root, scale=0.5, seed=seed + 1)
    lean = np.stack([np.cos(heading) + wind, np.zeros(blades), np.sin(heading) + wind], axis=1)
    lean *= (height * rng.uniform(0.15, 0.75, blades))[:, None]
    s = np.linspace(0, 1, 5)[:, None]
    curves = root[:, None] + height[:, None, None] * s**0.85 * _UP + lean[:, None] * s**2
    radius = rng.uniform(0.0013, 0.0024, (blades, 1)) * [1.0, 0.95, 0.75, 0.4]
    dry = np.repeat(np.clip(0.5 + 0.5 * tuft + 0.4 * rng.normal(size=blades), 0, 1), 4)
    tip = mix((0.10, 0.30, 0.035), (0.33, 0.38, 0.07), dry)
    albedo = mix((0.012, 0.045, 0.010), tip, np.tile(np.linspace(0.1, 1, 4), blades))
    return strands(curves, radius, albedo, LEAF)


def flowers(count: int, seed: int) -> list[Patch]:
    """Model poppies, daisies and cornflowers: flat petals on stems, with a dotted heart."""
    rng = np.random.default_rng([seed, 1])
    root = _roots(count, rng)
    height = rng.uniform(0.05, 0.085, (count, 1))
    face = unit(_UP + rng.normal(0, 0.35, (count, 3)) * [1, 0, 1])
    head = root + height * _UP + 0.012 * face * [1, 0, 1]
    curves = np.stack([root, root + 0.55 * height * _UP, head], axis=1)
    kind = rng.choice(3, count, p=_SHARES)
    stems = strands(curves, 0.0014, (0.06, 0.16, 0.03), LEAF, lay=0.5)
    return [stems, _petals(head, face, kind, rng), _hearts(head, face, kind, rng)]


def _petals(head: F64, face: F64, kind: Kinds, rng: np.random.Generator) -> Patch:
    """Model a ring of petals around each head."""
    number = _PETALS[kind]
    flower = np.repeat(np.arange(len(head)), number)
    index = np.arange(len(flower)) - np.repeat(np.cumsum(number) - number, number)
    n, of = face[flower], kind[flower]
    angle = 2 * math.pi * index / number[flower] + flower + rng.normal(0, 0.07, len(flower))
    out, cupped = _sideways(n, angle), _CUPPED[of][:, None]
    along, normal = unit(out + cupped * n), unit(n - cupped * out)
    length = (_LENGTHS[of] * rng.uniform(0.8, 1.15, len(of)))[:, None]
    return Patch(
        positions=head[flower] + 1.05 * length * along,
        axes=np.stack([along, np.cross(normal, along), normal], axis=2),
        sigmas=0.52 * length * np.stack([np.ones(len(of)), _WIDTHS[of], 0.06 + 0 * of], axis=1),
        albedo=_COLORS[of] * rng.uniform(0.8, 1.1, (len(of), 1)),
        finish=PETAL,
    )


def _hearts(head: F64, face: F64, kind: Kinds, rng: np.random.Generator) -> Patch:
    """Model dots in the middle of each flower."""
    n = np.repeat(face, _DOTS, axis=0)
    out = _sideways(n, rng.uniform(0, 2 * math.pi, len(n)))
    radius = 0.0022 * np.sqrt(rng.random((len(n), 1)))
    return Patch(
        positions=np.repeat(head, _DOTS, axis=0) + radius * out + 0.0016 * n,
        axes=np.stack([out, np.cross(n, out), n], axis=2),
        sigmas=np.full((len(n), 3), [0.0010, 0.0010, 0.0007]),
        albedo=np.repeat(_HEARTS[kind], _DOTS, axis=0) * rng.uniform(0.6, 1.2, (len(n), 1)),
        finish=EARTH,
    )


def _sideways(normals: F64, angle: F64) -> F64:
    """Return unit vectors perpendicular to normals (not along z), at an angle in their plane."""
    u = unit(np.cross(normals, [0.0, 0.0, 1.0]))
    return np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(normals, u)


def _roots(count: int, rng: np.random.Generator) -> F64:
    """Return random places on the ground, uniform by area, shape (count, 3)."""
    radius = np.sqrt(rng.uniform((INNER + 0.012) ** 2, (OUTER - 0.012) ** 2, count))
    angle = rng.uniform(0, 2 * math.pi, count)
    return np.stack([radius * np.cos(angle), np.zeros(count), radius * np.sin(angle)], axis=1)
