"""The sculpture: a turban shell with a gilded lip, held by a gold cup on a marble drum.

Source of the shell's form: Raup 1966, "Geometric Analysis of Shell Coiling".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.patch import (
    Finish,
    Patch,
    keep,
    mix,
    move,
    noise,
    string,
    sweep,
    unit,
)

TOP = 0.124  # height of the drum [m]

_WHORLS = 6.5
_WIDEN = 1.56  # growth of everything in one whorl
_RADIUS, _HEIGHT, _TUBE = 0.172, 0.490, 0.163  # of the last whorl: axis to tube, apex to tube, tube
_END = 2 * math.pi * 8  # the aperture faces +z

_SEAT = 0.118  # lowest point of the shell above the drum [m]

NACRE = Finish(specular=(0.10, 0.10, 0.10), gloss=0.75, sharpness=9, film=0.60)
LINING = Finish(specular=(0.12, 0.11, 0.11), gloss=0.75, sharpness=7, film=0.40)
GOLD = Finish(specular=(0.95, 0.62, 0.22), gloss=0.95, sharpness=10)
MARBLE = Finish(specular=(0.05, 0.05, 0.05), gloss=0.6, sharpness=10)
_GOLD_BODY = (0.13, 0.07, 0.02)


def shell(spacing: float) -> list[Patch]:
    """Outside, lining and lip of the shell, as it stands in the cup."""
    patches = [_outside(spacing), _threads(spacing), _lining(spacing), _lip(spacing)]
    tilt = _turn(0, 0.16) @ _turn(2, 0.42) @ _turn(1, 0.35)
    lowest = min((patch.positions @ tilt.T)[:, 1].min() for patch in patches)
    body = patches[0].positions @ tilt.T
    middle = body[body[:, 1] < lowest + 0.16].mean(axis=0)  # the part that sits in the cup
    offset = (-middle[0], TOP + _SEAT - lowest, -middle[2])
    return [move(patch, tilt, offset) for patch in patches]


def cup(spacing: float) -> Patch:
    """A gold foot, stem and knop that open into a calyx of eight petals."""
    profile = np.array([
        (0.118, 0.000), (0.120, 0.007), (0.100, 0.014), (0.060, 0.020), (0.030, 0.030), (0.020, 0.045),
        (0.022, 0.052), (0.040, 0.060), (0.043, 0.067), (0.038, 0.074), (0.022, 0.081), (0.020, 0.090),
        (0.040, 0.102), (0.080, 0.112), (0.115, 0.130), (0.138, 0.156), (0.160, 0.190), (0.180, 0.205),
    ])  # fmt: skip
    reach = _reach(profile)

    def surface(s: F64, t: F64) -> F64:
        angle = 2 * math.pi * t
        petal = np.abs(np.cos(4 * angle))
        at = s * reach[-1]
        at = at - np.maximum(at - 0.62 * reach[-1], 0) * 0.85 * (1 - np.sqrt(petal**2 + 0.02))
        radius, y = np.interp(at, reach, profile[:, 0]), np.interp(at, reach, profile[:, 1])
        opened = np.clip((y - 0.10) / 0.05, 0, 1)
        radius = radius * (1 + 0.10 * opened * (petal - 0.6) + 0.012 * np.cos(40 * angle))
        return np.stack([radius * np.cos(angle), TOP + y, -radius * np.sin(angle)], axis=1)

    found = sweep(surface, spacing * 0.9)
    return found.paint(np.tile(_GOLD_BODY, (len(found.s), 1)), GOLD)


def drum(spacing: float) -> Patch:
    """The pedestal: a turned profile with mouldings, fluted at the waist."""
    profile = np.array([
        (0.345, -0.010), (0.345, 0.012), (0.335, 0.020), (0.324, 0.023), (0.318, 0.030),
        (0.298, 0.036), (0.292, 0.043), (0.291, 0.081), (0.297, 0.088), (0.310, 0.094),
        (0.315, 0.101), (0.326, 0.105), (0.327, 0.118), (0.320, 0.124), (0.200, 0.124), (0.0, 0.124),
    ])  # fmt: skip
    reach = _reach(profile)

    def surface(s: F64, t: F64) -> F64:
        at = s * reach[-1]
        radius, y = np.interp(at, reach, profile[:, 0]), np.interp(at, reach, profile[:, 1])
        waist = np.clip((y - 0.040) / 0.006, 0, 1) * np.clip((0.086 - y) / 0.006, 0, 1)
        angle = 2 * math.pi * t
        radius = radius - 0.010 * waist * np.abs(np.cos(30 * angle)) * (radius > 0.28)
        return np.stack([radius * np.cos(angle), y, -radius * np.sin(angle)], axis=1)

    found = sweep(surface, spacing * 1.35)
    p = found.positions
    warp = p + 0.05 * np.stack([noise(p, scale=0.3, seed=s) for s in (1, 2, 3)], axis=1)
    vein = np.abs(noise(warp, scale=0.35, seed=4, octaves=4))
    fine = np.abs(noise(warp, scale=0.11, seed=5, octaves=3))
    albedo = mix((0.34, 0.36, 0.36), (0.72, 0.70, 0.66), 0.15 + vein / 0.16)
    albedo = albedo * (0.80 + 0.20 * np.clip(fine / 0.10, 0, 1))[:, None]
    return found.paint(albedo, MARBLE)


def _outside(spacing: float) -> Patch:
    """The outer wall, without what neighbouring whorls bury."""
    found = sweep(_tube, lambda s: 0.86 * spacing * np.clip(0.45 + 0.7 * s**2, 0.3, 1))
    angle, phi = _angles(found.s, found.t)
    p = found.positions
    age = _growth(angle)
    cream, rose, sea, deep = (
        (0.46, 0.30, 0.18),
        (0.34, 0.05, 0.07),
        (0.015, 0.13, 0.15),
        (0.03, 0.02, 0.07),
    )
    wander = noise(p, scale=0.16, seed=11)
    albedo = mix(rose, sea, age * 1.7 - 0.45 + 0.25 * wander)
    albedo = mix(albedo, cream, -0.2 + 0.8 * np.cos(2 * phi - 1.0) + 0.4 * wander)
    flame = np.sin(9 * angle + 2.2 * np.sin(3 * phi) + 1.3 * wander) + 0.45 * np.cos(2 * phi)
    albedo = mix(albedo, deep, 0.92 * np.clip((flame - 0.55) / 0.40, 0, 1))
    lines = np.sin(150 * angle + 3 * wander)
    albedo = albedo * (1 + 0.12 * lines)[:, None]
    film = 330 + 130 * wander + 50 * np.sin(2 * phi) + 12 * lines
    return keep(found.paint(albedo, NACRE, film), ~_buried(p, angle))


def _threads(spacing: float) -> Patch:
    """Gold threads laid along the spiral cords, finer toward the apex."""
    links = round(2.6 / spacing)
    s = np.linspace(0.02, 1, links + 1) ** 0.8
    phi = np.array([-0.52, 0.0, 0.30, 1.31, 1.57])
    t = np.broadcast_to(phi[:, None] / (2 * math.pi), (len(phi), links + 1))
    at = np.broadcast_to(s, t.shape)
    curves = _tube(at.ravel(), t.ravel() % 1.0, 1.012).reshape(len(phi), links + 1, 3)
    size = _growth(_angles(s[1:], t[0, 1:])[0])
    middle, axes, sigmas = string(curves, np.tile(0.0004 + 0.0016 * size, (len(phi), 1)), lay=0.6)
    angle = _angles(0.5 * (at[:, 1:] + at[:, :-1]).ravel(), 0)[0]
    albedo = np.tile(_GOLD_BODY, (len(middle), 1))
    threads = Patch(
        positions=middle, axes=axes, sigmas=sigmas, albedo=albedo, finish=GOLD, is_strand=True
    )
    return keep(threads, ~_buried(middle, angle))


def _lining(spacing: float) -> Patch:
    """The inner wall behind the aperture: mother of pearl."""
    span = 0.62 / _WHORLS  # whorls one can look into

    def surface(s: F64, t: F64) -> F64:
        return _tube(1 - span * (1 - s), 1 - t, 0.93)

    found = sweep(surface, spacing * 1.4)
    wander = noise(found.positions, scale=0.2, seed=12)
    albedo = mix((0.85, 0.50, 0.42), (0.60, 0.66, 0.70), 0.5 + 0.5 * wander)
    return found.paint(albedo, LINING, 420 + 150 * wander + 120 * np.sin(6 * found.t))


def _lip(spacing: float) -> Patch:
    """A gold bead around the aperture."""

    def surface(s: F64, t: F64) -> F64:
        end = np.ones_like(t)
        edge, centre = _tube(end, t, 0.97), np.array([_RADIUS, -_HEIGHT, 0.0])
        bend = 1.5 * math.pi * (s - 0.5)
        outward = unit(edge - centre) * np.sin(bend)[:, None]
        return edge + 0.0095 * (outward + np.cos(bend)[:, None] * [0, 0, 1])

    found = sweep(surface, spacing * 0.7)
    return found.paint(np.tile(_GOLD_BODY, (len(found.s), 1)), GOLD)


def _tube(s: F64, t: F64, size: float = 1.0) -> F64:
    """The wall of the coiling tube, apex at the origin, axis down y."""
    angle, phi = _angles(s, t)
    g = _growth(angle)
    cords = 0.018 * np.abs(np.sin(6 * phi)) + 0.006 * np.sin(48 * angle)
    shoulder = np.exp(-(((phi - 0.75) / 0.26) ** 2))
    knobs = 0.17 * shoulder * np.maximum(np.cos(11 * angle), 0) ** 3
    flare = 0.10 * np.clip((s - 0.985) / 0.015, 0, 1) ** 2
    relief = size * (1 + (cords + knobs) * (size >= 1.0) + flare) * _TUBE * g
    out = _RADIUS * g + relief * np.cos(phi)
    y = -_HEIGHT * g + 1.06 * relief * np.sin(phi)
    return np.stack([out * np.cos(angle), y, out * np.sin(angle)], axis=1)


def _angles(s: F64, t: F64) -> tuple[F64, F64]:
    """Angle about the axis and angle about the tube, in -pi..pi with 0 outward and up positive."""
    phi = (2 * math.pi * t + math.pi) % (2 * math.pi) - math.pi
    return _END - 2 * math.pi * _WHORLS * (1 - s), phi


def _growth(angle: F64) -> F64:
    """Size relative to the aperture."""
    return _WIDEN ** ((angle - _END) / (2 * math.pi))


def _buried(p: F64, angle: F64) -> F64:
    """Which points lie within the tube a whorl before or after, where no eye gets."""
    hidden = np.zeros(len(p), bool)
    out = np.hypot(p[:, 0], p[:, 2])
    for turn in (-1, 1):
        other = angle + 2 * math.pi * turn
        g = _growth(other)
        inside = np.hypot(out - _RADIUS * g, (p[:, 1] + _HEIGHT * g) / 1.06) < 0.97 * _TUBE * g
        hidden |= inside & (other < _END - 0.62 * 2 * math.pi if turn > 0 else True)
    return hidden


def _reach(profile: F64) -> F64:
    """Length of a polyline up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])


def _turn(axis: int, angle: float) -> F64:
    """Rotation about a coordinate axis, right-handed [rad]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = math.cos(angle)
    out[i, j], out[j, i] = -math.sin(angle), math.sin(angle)
    return out


def tendrils(density: float, seed: int) -> list[Patch]:
    """Gold filigree: vines that rise around the drum, curl and branch, with leaves of gold."""
    rng = np.random.default_rng([seed, 2])
    curves, radii, leaves = [], [], []
    links = max(24, round(150 * density))
    for index in range(30):
        angle = 2 * math.pi * index / 30
        tall = index % 2 == 0
        swirl = 2.4 if tall else -2.4
        length = (0.44 if tall else 0.27) * rng.uniform(0.95, 1.05)
        main = _curl(length, links, start=1.5, bend=(-1.2, -3.2) if tall else (0.9, 4.0))
        curves.append(_upright(main, angle, 0.372, swirl))
        radii.append(np.linspace(0.0042, 0.0016, links))
        for share, side in ((0.26, 1), (0.42, -1)) if tall else ((0.3, -1),):
            at = round(share * links)
            heading = np.arctan2(*(main[at + 1] - main[at])[::-1])
            twig = main[at] + _curl(
                0.13 * (1 - share), links, start=heading + 0.5 * side, bend=(2.0 * side, 4.5 * side)
            )
            curves.append(_upright(twig, angle, 0.372, swirl))
            radii.append(np.linspace(0.0026, 0.0012, links))
            leaves.append(_upright(twig[links // 5 :: max(1, links // 12)], angle, 0.372, swirl))
        leaves.append(_upright(main[links // 6 :: max(1, links // 16)], angle, 0.372, swirl))
    middle, axes, sigmas = string(np.stack(curves), np.stack(radii), lay=0.6)
    albedo = np.tile(_GOLD_BODY, (len(middle), 1))
    wires = Patch(
        positions=middle, axes=axes, sigmas=sigmas, albedo=albedo, finish=GOLD, is_strand=True
    )
    return [wires, _leaves(np.concatenate(leaves), rng)]


def _curl(length: float, links: int, *, start: float, bend: tuple[float, float]) -> F64:
    """A plane curve whose curvature grows along it, ending in a spiral, shape (links + 1, 2)."""
    s = np.linspace(0, 1, links + 1)
    heading = start + bend[0] * s + bend[1] * s**4 * 1.6
    steps = length / links * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])


def _upright(plane: F64, angle: float, radius: float, swirl: float) -> F64:
    """A curve of the (outward, up) plane, set at an angle around the drum, leaning a little."""
    out, up = radius + plane[:, 0], plane[:, 1] + 0.004
    about = angle + swirl * plane[:, 1]
    return np.stack([out * np.cos(about), up, out * np.sin(about)], axis=1)


def _leaves(points: F64, rng: np.random.Generator) -> Patch:
    """Flat gold leaves at points."""
    n = len(points)
    outward = unit(points * [1, 0.3, 1] + rng.normal(0, 0.25, (n, 3)))
    u = unit(np.cross(outward, rng.normal(size=(n, 3))))
    axes = np.stack([u, np.cross(outward, u), outward], axis=2)
    size = rng.uniform(0.7, 1.1, (n, 1))
    return Patch(
        positions=points + 0.006 * u,
        axes=axes,
        sigmas=size * [0.0062, 0.0026, 0.0003],
        albedo=np.tile(_GOLD_BODY, (n, 1)),
        finish=GOLD,
    )
