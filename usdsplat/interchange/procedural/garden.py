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
_CREAM, _TEAL, _COBALT = (0.74, 0.67, 0.53), (0.01, 0.20, 0.21), (0.015, 0.05, 0.30)
_SAFFRON, _CLAY, _NIGHT = (0.66, 0.32, 0.04), (0.42, 0.08, 0.045), (0.012, 0.025, 0.10)
# By ring, that is by the number of joints beyond which a tile lies; 4 to 9 are seen.
_BORDERS = np.array([_NIGHT] * 5 + [_TEAL, _CREAM, _CLAY, _CREAM, _NIGHT])
_FIELDS = np.array([_SAFFRON] * 5 + [_SAFFRON, _COBALT, _CREAM, _TEAL, _CLAY])
_HEARTS = np.array([_COBALT] * 5 + [_COBALT, _CREAM, _TEAL, _COBALT, _CREAM])
_GILT_ROWS, _HEART_ROW = (4, 10, 11), 10  # rows of splats, counted from the joint
_GILT = (0.50, 0.30, 0.06)
_GROUT = (0.30, 0.26, 0.21)


def tiles(spacing: float, seed: int) -> list[Patch]:
    """Rings of rhombi between tangents of a circle: glazed tiles, each with an inlay."""
    step = 0.6 * spacing
    return [_glazed(_joint_rows(step), seed), _glazed(_tile_fields(step), seed)]


def _joint_rows(step: float) -> tuple[F64, F64, F64]:
    """Long splats in rows along every joint: places (n, 2), directions [rad], sigmas (n, 3).

    A row ends where another joint is nearer, so rows meet in mitres as laid borders do.
    """
    half = math.sqrt(KERB**2 - _TOUCH**2)
    x = np.arange(-half, half, 2.6 * step)
    rows = np.array([-11, -10, -4, -3, -2, -1, 0, 1, 2, 3, 4, 10, 11])
    angle = 2 * math.pi * np.arange(_LINES) / _LINES
    line, row, at = (grid.ravel() for grid in np.meshgrid(angle, rows, x, indexing="ij"))
    at = at + 1.3 * step * (row % 2)
    outward = np.stack([np.cos(line), np.sin(line)], axis=1)
    along = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    places = (_TOUCH + step * row)[:, None] * outward + at[:, None] * along
    gap, _ = _rosette(places)
    radius = np.hypot(*places.T)
    near = (gap > step * np.abs(row) - 1e-9) & (radius < KERB) & (radius > INNER - 0.02)
    sigmas = np.tile(step * np.array([1.35, 0.52, 0.1]), (near.sum(), 1))
    return places[near], line[near] + math.pi / 2, sigmas


def _tile_fields(step: float) -> tuple[F64, F64, F64]:
    """Round splats on a lattice within the borders, as `_joint_rows`."""
    size = 2.0 * step
    u = np.arange(-KERB, KERB, size)
    v = np.arange(-KERB, KERB, size * math.sqrt(0.75))
    places = np.stack(np.meshgrid(u, v), axis=-1)
    places[1::2, :, 0] += size / 2
    places = places.reshape(-1, 2)
    gap, _ = _rosette(places)
    radius = np.hypot(*places.T)
    row = gap / step
    in_field = ((row > 4.6) & (row < 9.4)) | (row > 11.6)
    inside = in_field & (radius < KERB) & (radius > INNER - 0.02)
    places = places[inside]
    return (
        places,
        np.zeros(len(places)),
        np.tile(size * np.array([0.62, 0.62, 0.05]), (len(places), 1)),
    )


def _glazed(found: tuple[F64, F64, F64], seed: int) -> Patch:
    """Glaze on places of the rosette: colours by ring, each tile a shade and a tilt of its own."""
    places, heading, sigmas = found
    gap, ring = _rosette(places)
    ring = np.minimum(ring, 9)
    step = sigmas[:, 1] / np.where(sigmas[:, 0] > sigmas[:, 1], 0.52, 1.24)
    row = np.rint(gap / step)
    inlay = np.where((row > _HEART_ROW)[:, None], _HEARTS[ring], _FIELDS[ring])
    colour = np.where((row > _GILT_ROWS[0])[:, None], inlay, _BORDERS[ring])
    colour = colour * (0.80 + 0.40 * tile[:, :1])
    is_gilt = np.isin(row, _GILT_ROWS) & (sigmas[:, 0] > sigmas[:, 1])
    colour = np.where(is_gilt[:, None], _GILT, colour)
    p = np.stack([places[:, 0], np.zeros(len(places)), places[:, 1]], axis=1)
    colour = colour * (1 + 0.08 * noise(p, scale=0.05, seed=seed))[:, None]
    is_joint = row == 0
    colour = np.where(is_joint[:, None], _GROUT, colour)
    p[:, 1] = np.where(is_joint, -0.001, 0.0)
    tilt = 0.12 * (tile[:, 1:] - 0.5) * ~is_joint[:, None]
    n = unit(np.stack([tilt[:, 0], np.ones(len(p)), tilt[:, 1]], axis=1))
    u = np.stack([np.cos(heading), np.zeros(len(p)), np.sin(heading)], axis=1)
    u = unit(u - n * np.einsum("ni,ni->n", u, n)[:, None])
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
    for surface, step in ((kerb, 0.9), (rim, 1.7)):
        found = sweep(surface, spacing * step)
        p = found.positions
        block = np.floor(np.arctan2(p[:, 2], p[:, 0]) / (2 * math.pi) * 72)
        shade = 0.9 + 0.2 * np.sin(block * 12.9898) * np.cos(block * 4.1)
        joint = np.abs(np.arctan2(p[:, 2], p[:, 0]) / (2 * math.pi) * 72 % 1 - 0.5) > 0.485
        grain = noise(p, scale=0.03, seed=33)
        albedo = mix((0.62, 0.55, 0.45), (0.80, 0.74, 0.64), 0.5 + 0.5 * grain) * shade[:, None]
        albedo = np.where(joint[:, None], albedo * 0.45, albedo)
        patches.append(found.paint(albedo, STONE))
    return patches


def earth(spacing: float) -> Patch:
    """Soil and moss under the grass."""

    def surface(s: F64, t: F64) -> F64:
        radius = KERB + 0.03 + (OUTER - KERB - 0.035) * s
        hills = 0.008 * np.sin(9 * 2 * math.pi * t + 6 * s) * np.sin(math.pi * s)
        return _around(radius, hills - 0.002, 1 - t)

    found = sweep(surface, spacing * 2.4)
    p = found.positions
    albedo = mix(
        (0.060, 0.048, 0.024), (0.060, 0.110, 0.025), 0.5 + 0.7 * noise(p, scale=0.1, seed=34)
    )
    return found.paint(albedo, EARTH)


def grass(blades: int, seed: int) -> Patch:
    """Bent blades of four splats each, in tufts."""
    rng = np.random.default_rng(seed)
    root = _meadow(blades, rng)
    tuft = noise(root, scale=0.13, seed=seed)
    height = (0.036 + 0.030 * np.clip(tuft, -0.6, 1)) * rng.uniform(0.6, 1.35, blades)
    heading = rng.uniform(0, 2 * math.pi, blades)
    wind = 0.35 * noise(root, scale=0.5, seed=seed + 1)
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


def flowers(count: int, seed: int) -> list[Patch]:
    """Poppies, daisies and cornflowers: flat petals on stems, with a dotted heart."""
    rng = np.random.default_rng([seed, 1])
    root = _meadow(count, rng)
    height = rng.uniform(0.05, 0.085, count)
    face = unit(
        np.stack([rng.normal(0, 0.35, count), np.ones(count), rng.normal(0, 0.35, count)], 1)
    )
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


def _rosette(p: F64) -> tuple[F64, F64]:
    """Distance to the nearest joint [m], and how many joints p lies beyond."""
    angle = 2 * math.pi * np.arange(_LINES) / _LINES
    beyond = p @ np.stack([np.cos(angle), np.sin(angle)]) - _TOUCH
    return np.abs(beyond).min(axis=1), (beyond > 0).sum(axis=1)


def _tile_number(p: F64) -> F64:
    """A number 0..4095 that all points of one tile share."""
    angle = 2 * math.pi * np.arange(_LINES) / _LINES
    beyond = p @ np.stack([np.cos(angle), np.sin(angle)]) > _TOUCH
    weights = np.random.default_rng(_LINES).integers(1, 4096, _LINES)
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
