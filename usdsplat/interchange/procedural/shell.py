"""Model a turban shell with a gilded lip and gold threads.

Source of the form: Raup 1966, "Geometric Analysis of Shell Coiling": a tube whose radius, distance
from the axis and height all grow by one factor a whorl.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.interchange.procedural.materials import GILT, GOLD, LINING, NACRE
from usdsplat.interchange.procedural.patch import Mask, Patch, mix, noise, strands, sweep, unit

_WHORLS = 6.5
_WIDEN = 1.56  # growth in one whorl
# Tube at the aperture [m]: distance of its centre from the axis, depth below the apex, radius.
_RADIUS, _HEIGHT, _TUBE = 0.172, 0.490, 0.163
_END = 2 * math.pi * 8  # angle of the aperture, which faces +z
_OPEN = 0.62  # length of the part whose inside is visible, in whorls
_THREADS = np.array([-0.52, 0.0, 0.30, 1.31, 1.57])  # angles about the tube [rad]


def shell(spacing: float, *, seat: float) -> list[Patch]:
    """Model outside, threads, lining and lip; the lowest point is on the axis at `seat` [m]."""
    patches = [_outside(spacing), _threads(spacing), _lining(spacing), _lip(spacing)]
    tilt = _turn(0, 0.16) @ _turn(2, 0.42) @ _turn(1, 0.35)
    body = patches[0].positions @ tilt.T
    lowest = body[:, 1].min()
    middle = body[body[:, 1] < lowest + 0.16].mean(axis=0)
    return [patch.moved(tilt, (-middle[0], seat - lowest, -middle[2])) for patch in patches]


def _outside(spacing: float) -> Patch:
    """Model the outer wall, without parts hidden by neighbouring whorls."""
    found = sweep(_tube, lambda s: 0.86 * spacing * np.clip(0.45 + 0.7 * s**2, 0.3, 1))
    angle, phi = _angles(found.s, found.t)
    p = found.positions
    wander = noise(p, scale=0.16, seed=11)
    age = _growth(angle) * 1.7 - 0.45 + 0.25 * wander
    albedo = mix((0.34, 0.05, 0.07), (0.015, 0.13, 0.15), age)
    cream = -0.2 + 0.8 * np.cos(2 * phi - 1.0) + 0.4 * wander
    albedo = mix(albedo, (0.46, 0.30, 0.18), cream)
    flame = np.sin(9 * angle + 2.2 * np.sin(3 * phi) + 1.3 * wander) + 0.45 * np.cos(2 * phi)
    albedo = mix(albedo, (0.03, 0.02, 0.07), 0.92 * np.clip((flame - 0.55) / 0.40, 0, 1))
    lines = np.sin(150 * angle + 3 * wander)
    film = 330 + 130 * wander + 50 * np.sin(2 * phi) + 12 * lines
    whole = found.paint(albedo * (1 + 0.12 * lines)[:, None], NACRE, film)
    return whole.where(~_buried(p, angle))


def _threads(spacing: float) -> Patch:
    """Model gold threads along the spiral cords, finer toward the apex."""
    links = max(40, round(2.6 / spacing))
    s = np.linspace(0.02, 0.985, links + 1) ** 0.8
    at, phi = (grid.ravel() for grid in np.meshgrid(s, _THREADS))
    curves = _tube(at, phi / (2 * math.pi), 1.012).reshape(len(_THREADS), links + 1, 3)
    angle, _ = _angles(0.5 * (s[1:] + s[:-1]), s[1:])
    whole = strands(curves, 0.0004 + 0.0016 * _growth(angle), GILT, GOLD, lay=0.6)
    return whole.where(~_buried(whole.positions, np.tile(angle, len(_THREADS))))


def _lining(spacing: float) -> Patch:
    """Model the inner wall behind the aperture."""
    span = _OPEN / _WHORLS

    def surface(s: F64, t: F64) -> F64:
        return _tube(1 - span * (1 - s), 1 - t, 0.93)

    found = sweep(surface, spacing * 1.4)
    wander = noise(found.positions, scale=0.2, seed=12)
    albedo = mix((0.85, 0.50, 0.42), (0.60, 0.66, 0.70), 0.5 + 0.5 * wander)
    film = 420 + 150 * wander + 120 * np.sin(12 * math.pi * found.t)
    return found.paint(albedo, LINING, film)


def _lip(spacing: float) -> Patch:
    """Model a gold bead around the aperture."""
    centre = np.array([_RADIUS, -_HEIGHT, 0.0])

    def surface(s: F64, t: F64) -> F64:
        edge = _tube(np.ones_like(t), t, 0.97)
        bend = 1.5 * math.pi * (s - 0.5)
        outward = unit(edge - centre) * np.sin(bend)[:, None]
        return edge + 0.0095 * (outward + np.cos(bend)[:, None] * [0, 0, 1])

    return sweep(surface, spacing * 0.7).paint(GILT, GOLD)


def _tube(s: F64, t: F64, size: float = 1.0) -> F64:
    """Return points of the tube, apex at the origin, axis down y; smooth for `size` below 1."""
    angle, phi = _angles(s, t)
    g = _growth(angle)
    cords = 0.018 * np.abs(np.sin(6 * phi)) + 0.006 * np.sin(48 * angle)
    shoulder = np.exp(-(((phi - 0.75) / 0.26) ** 2))
    knobs = 0.17 * shoulder * np.maximum(np.cos(11 * angle), 0) ** 3
    flare = 0.10 * np.clip((s - 0.985) / 0.015, 0, 1) ** 2
    radius = size * (1 + (cords + knobs) * (size >= 1.0) + flare) * _TUBE * g
    out = _RADIUS * g + radius * np.cos(phi)
    y = -_HEIGHT * g + 1.06 * radius * np.sin(phi)
    return np.stack([out * np.cos(angle), y, out * np.sin(angle)], axis=1)


def _angles(s: F64, t: F64) -> tuple[F64, F64]:
    """Return the angle about the axis, and about the tube: in -pi..pi, 0 outward, positive
    upward."""
    phi = (2 * math.pi * t + math.pi) % (2 * math.pi) - math.pi
    return _END - 2 * math.pi * _WHORLS * (1 - s), phi


def _growth(angle: F64) -> F64:
    """Return the size relative to the aperture."""
    return _WIDEN ** ((angle - _END) / (2 * math.pi))


def _buried(p: F64, angle: F64) -> Mask:
    """Return which points are hidden inside the tube of the previous or next whorl."""
    hidden = np.zeros(len(p), bool)
    out = np.hypot(p[:, 0], p[:, 2])
    for turn, last in ((-1, _END), (1, _END - _OPEN * 2 * math.pi)):
        other = angle + 2 * math.pi * turn
        g = _growth(other)
        inside = np.hypot(out - _RADIUS * g, (p[:, 1] + _HEIGHT * g) / 1.06) < 0.97 * _TUBE * g
        hidden |= inside & (other < last)
    return hidden


def _turn(axis: int, angle: float) -> F64:
    """Return a right-handed rotation about a coordinate axis [rad]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = math.cos(angle)
    out[i, j], out[j, i] = -math.sin(angle), math.sin(angle)
    return out
