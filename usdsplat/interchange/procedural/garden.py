"""The ground: a rosette of glazed tiles, a kerb, a meadow with flowers, a plinth under it all."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.patch import (
    Finish,
    Patch,
    mix,
    noise,
    string,
    sweep,
    unit,
)

INNER, KERB, OUTER = 0.33, 0.665, 0.985  # radii [m]: where tiles, kerb and meadow end

GLAZE = Finish(specular=(0.05, 0.05, 0.05), gloss=0.6, sharpness=9)
STONE = Finish(specular=(0.04, 0.04, 0.04), gloss=0.35, sharpness=6)
EARTH = Finish()
LEAF = Finish(specular=(0.03, 0.035, 0.02), gloss=0.3, sharpness=5, translucency=0.45, opacity=0.9)
PETAL = Finish(gloss=0.15, sharpness=4, translucency=0.4, opacity=0.9)

_LINES, _TOUCH = 24, 0.30  # lines of the rosette, all tangent to a circle of this radius [m]
_PALETTE = np.array([
    (0.80, 0.72, 0.56), (0.02, 0.16, 0.22), (0.85, 0.79, 0.66), (0.02, 0.07, 0.33), (0.70, 0.33, 0.05),
    (0.84, 0.78, 0.66), (0.02, 0.25, 0.20), (0.46, 0.09, 0.05), (0.84, 0.78, 0.66), (0.03, 0.10, 0.30),
    (0.60, 0.28, 0.05), (0.02, 0.16, 0.22),
])  # fmt: skip
_INLAY = np.roll(_PALETTE, 2, axis=0)
_GROUT = (0.30, 0.26, 0.21)


def tiles(spacing: float) -> Patch:
    """Rings of rhombi between tangents of a circle, small splats along the joints."""
    centre, size = _cells(spacing)
    gap, nearest, ring = _rosette(centre)
    along = math.pi * 2 * nearest / _LINES + math.pi / 2
    tile = np.random.default_rng(31).random((4096, 4))[_tile_number(centre)]
    colour = _PALETTE[ring % len(_PALETTE)] * (0.78 + 0.44 * tile[:, :1])
    colour = np.where((gap > 0.0105)[:, None] & (tile[:, 1:2] < 2), _INLAY[ring % len(_INLAY)], colour)
    colour = np.where((np.abs(gap - 0.0105) < 0.0011)[:, None], (0.55, 0.40, 0.12), colour)
    p = np.stack([centre[:, 0], np.zeros(len(centre)), centre[:, 1]], axis=1)
    colour = colour * (1 + 0.10 * noise(p, scale=0.05, seed=32))[:, None]
    is_joint = gap < 0.0016
    colour = np.where(is_joint[:, None], _GROUT, colour)
    p[:, 1] = np.where(is_joint, -0.0012, 0.0)
    tilt = 0.10 * (tile[:, 2:] - 0.5) * ~is_joint[:, None]
    n = unit(np.stack([tilt[:, 0], np.ones(len(p)), tilt[:, 1]], axis=1))
    u = np.stack([np.cos(along), np.zeros(len(p)), np.sin(along)], axis=1)
    u = unit(u - n * np.einsum("ni,ni->n", u, n)[:, None])
    long = np.where(gap < size, 0.78, 0.6) * size
    sigmas = np.stack([long, np.where(gap < size, 0.5, 0.6) * size, 0.08 * size], axis=1)
    axes = np.stack([u, np.cross(n, u), n], axis=2)
    return Patch(positions=p, axes=axes, sigmas=sigmas, albedo=colour, finish=GLAZE)


def stonework(spacing: float) -> list[Patch]:
    """Kerb around the tiles and rim of the whole disc, one sweep each."""

    def kerb(s: F64, t: F64) -> F64:
        bend = math.pi * s
        radius = KERB + 0.016 - 0.018 * np.cos(bend)
        return _around(radius, 0.020 * np.sin(bend) ** 0.7 - 0.004, 1 - t)

    profile = np.array([
        (0.0, -0.008), (0.004, 0.010), (0.014, 0.016), (0.026, 0.016), (0.036, 0.008), (0.036, -0.006),
        (0.028, -0.012), (0.028, -0.020), (0.040, -0.028), (0.042, -0.038), (0.0, -0.040),
    ]) + [OUTER - 0.005, 0.0]  # fmt: skip
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])

    def rim(s: F64, t: F64) -> F64:
        at = s * reach[-1]
        radius, y = np.interp(at, reach, profile[:, 0]), np.interp(at, reach, profile[:, 1])
        return _around(radius, y, 1 - t)

    patches = []
    for surface, step in ((kerb, 0.9), (rim, 1.25)):
        found = sweep(surface, spacing * step)
        p = found.positions
        block = np.floor(np.arctan2(p[:, 2], p[:, 0]) / (2 * math.pi) * 72)
        shade = 0.9 + 0.2 * np.sin(block * 12.9898) * np.cos(block * 4.1)
        joint = np.abs(np.arctan2(p[:, 2], p[:, 0]) / (2 * math.pi) * 72 % 1 - 0.5) > 0.485
        grain = noise(p, scale=0.03, seed=33)
        albedo = mix((0.62, 0.55, 0.45), (0.80, 0.74, 0.64), 0.5 + 0.5 * grain) * shade[:, None]
        albedo = np.where(joint[:, None], albedo * 0.45, albedo)
        patches.append(
            Patch(
                positions=p, axes=found.axes, sigmas=found.sigmas, albedo=albedo, finish=STONE
            )
        )
    return patches


def earth(spacing: float) -> Patch:
    """Soil and moss under the grass."""

    def surface(s: F64, t: F64) -> F64:
        radius = KERB + 0.03 + (OUTER - KERB - 0.035) * s
        hills = 0.008 * np.sin(9 * 2 * math.pi * t + 6 * s) * np.sin(math.pi * s)
        return _around(radius, hills - 0.002, 1 - t)

    found = sweep(surface, spacing * 1.7)
    p = found.positions
    albedo = mix((0.035, 0.028, 0.014), (0.045, 0.075, 0.018), 0.5 + 0.7 * noise(p, scale=0.1, seed=34))
    return Patch(positions=p, axes=found.axes, sigmas=found.sigmas, albedo=albedo, finish=EARTH)


def grass(blades: int) -> Patch:
    """Bent blades of four splats each, in tufts."""
    rng = np.random.default_rng(35)
    root = _meadow(blades, rng)
    tuft = noise(root, scale=0.13, seed=36)
    height = (0.036 + 0.030 * np.clip(tuft, -0.6, 1)) * rng.uniform(0.6, 1.35, blades)
    heading = rng.uniform(0, 2 * math.pi, blades)
    wind = 0.35 * noise(root, scale=0.5, seed=37)
    lean = np.stack([np.cos(heading) + wind, np.zeros(blades), np.sin(heading) + wind], axis=1)
    lean *= (height * rng.uniform(0.15, 0.75, blades))[:, None]
    s = np.linspace(0, 1, 5)[None, :, None]
    rise = (height[:, None] * np.linspace(0, 1, 5) ** 0.85)[..., None] * [0, 1, 0]
    curves = root[:, None] + rise + lean[:, None] * s**2
    width = rng.uniform(0.0013, 0.0024, blades)[:, None] * np.array([1.0, 0.95, 0.75, 0.4])
    middle, axes, sigmas = string(curves, width)
    up = np.tile(np.linspace(0.1, 1, 4), blades)
    dry = np.repeat(np.clip(0.5 + 0.5 * tuft + 0.4 * rng.normal(size=blades), 0, 1), 4)
    albedo = mix((0.012, 0.045, 0.010), mix((0.10, 0.30, 0.035), (0.33, 0.38, 0.07), dry), up)
    return Patch(
        positions=middle, axes=axes, sigmas=sigmas, albedo=albedo, finish=LEAF, is_strand=True
    )


def flowers(count: int) -> list[Patch]:
    """Poppies, daisies and cornflowers: flat petals on stems, with a dotted heart."""
    rng = np.random.default_rng(38)
    root = _meadow(count, rng)
    height = rng.uniform(0.05, 0.085, count)
    face = unit(np.stack([rng.normal(0, 0.35, count), np.ones(count), rng.normal(0, 0.35, count)], 1))
    head = root + height[:, None] * [0, 1, 0] + 0.012 * face * [1, 0, 1]
    bend = root + 0.55 * height[:, None] * [0, 1, 0]
    stem = string(np.stack([root, bend, head], axis=1), np.full((count, 2), 0.0014), lay=0.5)
    stems = Patch(
        positions=stem[0], axes=stem[1], sigmas=stem[2],
        albedo=np.tile([0.06, 0.16, 0.03], (len(stem[0]), 1)), finish=LEAF, is_strand=True,
    )  # fmt: skip
    kind = rng.choice(3, count, p=[0.42, 0.34, 0.24])
    return [stems, _petals(head, face, kind, rng), _hearts(head, face, kind, rng)]


def _petals(head: F64, face: F64, kind: F64, rng: np.random.Generator) -> Patch:
    """Five wide petals for a poppy, eleven narrow ones for a daisy, eight for a cornflower."""
    number = np.array([5, 11, 8])[kind]
    flower = np.repeat(np.arange(len(head)), number)
    index = np.arange(len(flower)) - np.repeat(np.cumsum(number) - number, number)
    n, of = face[flower], kind[flower]
    u = unit(np.cross(n, [0.0, 0.0, 1.0]))
    angle = 2 * math.pi * index / number[flower] + flower + rng.normal(0, 0.07, len(flower))
    out = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(n, u)
    cup = np.array([0.75, 0.15, 0.45])[of][:, None]
    along = unit(out + cup * n)
    normal = unit(n - cup * out)
    length = (np.array([0.0068, 0.0062, 0.0055])[of] * rng.uniform(0.8, 1.15, len(flower)))[:, None]
    axes = np.stack([along, np.cross(normal, along), normal], axis=2)
    colour = np.array([(0.75, 0.035, 0.015), (0.86, 0.85, 0.80), (0.10, 0.10, 0.62)])[of]
    narrow = np.array([0.85, 0.30, 0.42])[of]
    sigmas = length * 0.52 * np.stack([np.ones(len(of)), narrow, np.full(len(of), 0.06)], axis=1)
    return Patch(
        positions=head[flower] + 1.05 * length * along,
        axes=axes,
        sigmas=sigmas,
        albedo=colour * rng.uniform(0.8, 1.1, (len(of), 1)),
        finish=PETAL,
    )


def _hearts(head: F64, face: F64, kind: F64, rng: np.random.Generator) -> Patch:
    """Seven dots in the middle of each flower."""
    n = np.repeat(face, 7, axis=0)
    u = unit(np.cross(n, [0.0, 0.0, 1.0]))
    angle, radius = rng.uniform(0, 2 * math.pi, len(n)), 0.0022 * np.sqrt(rng.random(len(n)))
    out = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(n, u)
    colour = np.array([(0.02, 0.015, 0.02), (0.80, 0.45, 0.02), (0.16, 0.03, 0.25)])[kind]
    return Patch(
        positions=np.repeat(head, 7, axis=0) + radius[:, None] * out + 0.0016 * n,
        axes=np.stack([u, np.cross(n, u), n], axis=2),
        sigmas=np.full((len(n), 3), [0.0010, 0.0010, 0.0007]),
        albedo=np.repeat(colour, 7, axis=0) * rng.uniform(0.6, 1.2, (len(n), 1)),
        finish=EARTH,
    )


def _cells(spacing: float) -> tuple[F64, F64]:
    """Square cells over the tiled ring, halved twice where a joint passes: centres (n, 2), sizes."""
    size = spacing * 2.4
    steps = np.arange(-KERB, KERB + size, size)
    centre = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    done, sizes = [], []
    for level in range(3):
        radius = np.hypot(*centre.T)
        centre = centre[(radius > INNER - 0.02) & (radius < KERB + 0.5 * size)]
        gap, _, _ = _rosette(centre)
        fine = (gap < 0.85 * size) | (np.abs(gap - 0.0105) < 0.5 * size)
        split = fine if level < 2 else np.zeros(len(centre), bool)
        done.append(centre[~split])
        sizes.append(np.full(len(done[-1]), size))
        size /= 2
        corners = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * size / 2
        centre = (centre[split][:, None] + corners).reshape(-1, 2)
    return np.concatenate(done), np.concatenate(sizes)


def _rosette(p: F64) -> tuple[F64, F64, F64]:
    """Distance to the nearest joint [m], number of its line, and how many lines p lies beyond."""
    angle = 2 * math.pi * np.arange(_LINES) / _LINES
    beyond = p @ np.stack([np.cos(angle), np.sin(angle)]) - _TOUCH
    nearest = np.argmin(np.abs(beyond), axis=1)
    gap = np.abs(beyond[np.arange(len(p)), nearest])
    return gap, nearest, (beyond > 0).sum(axis=1)


def _tile_number(p: F64) -> F64:
    """A number 0..4095 that all points of one tile share."""
    angle = 2 * math.pi * np.arange(_LINES) / _LINES
    beyond = p @ np.stack([np.cos(angle), np.sin(angle)]) > _TOUCH
    weights = np.random.default_rng(39).integers(1, 4096, _LINES)
    return (beyond @ weights) % 4096


def _around(radius: F64, y: F64, t: F64) -> F64:
    """Points on circles about the axis; t runs so that sweeps outward face up."""
    angle = 2 * math.pi * t
    return np.stack([radius * np.cos(angle), y, -radius * np.sin(angle)], axis=1)


def _meadow(count: int, rng: np.random.Generator) -> F64:
    """Random roots, evenly by area over the grass ring, shape (count, 3)."""
    low, high = (KERB + 0.042) ** 2, (OUTER - 0.012) ** 2
    radius = np.sqrt(rng.uniform(low, high, count))
    angle = rng.uniform(0, 2 * math.pi, count)
    return np.stack([radius * np.cos(angle), np.zeros(count), radius * np.sin(angle)], axis=1)
