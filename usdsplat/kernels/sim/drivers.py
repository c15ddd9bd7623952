"""Drivers: compute an amount for each splat from a state of the simulation, and apply it to an
output."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .noise import quintic

U, V, V_MINUS_U, CROWDING, AGE, SPEED, DISTANCE = range(7)
"""Sources of a driver's amount."""
LINEAR, SMOOTH, SMOOTHER = range(3)
"""Shapes of the transition from 0 to 1."""
SCALE, THICKNESS, OPACITY, DISPLACEMENT = range(4)
"""Outputs except colour."""

C0 = 0.28209479177387814
"""Real spherical harmonic of degree 0: a colour is 0.5 + C0 times the first coefficient."""

_ZERO, _HALF, _ONE, _TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_THREE = np.float32(3)
_C0 = np.float32(C0)


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def remapped(value, low, high, ease):
    """Return 0 to 1 as a value goes from low to high, either of which may be larger, float32.

    If both are equal, the result is a step there.
    """
    if high == low:
        return _ONE if value >= low else _ZERO
    t = min(_ONE, max(_ZERO, (value - low) / (high - low)))
    if ease == SMOOTH:
        return t * t * (_THREE - _TWO * t)
    return quintic(t) if ease == SMOOTHER else t


@scalar
def _length(x, y, z):
    return np.float32(math.sqrt(x * x + y * y + z * z))


@scalar
def faded(coefficient, target, part):
    """Interpolate linearly from a coefficient to a target."""
    return coefficient + part * (target - coefficient)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="out", writes=("out",))
def amounts(
    i, source, uv, crowding, births, now, velocities, positions, rest, low, high, ease, out
):  # fmt: skip
    """Compute the amount of each splat, [0, 1], into out (n,) f32.

    Args:
        source, ease: One of the constants above each.
        uv: (n, 2) f32. crowding: (n,) f32, or (0,) if it is not the source.
        births: (n,) f32. now: f64 [s]. velocities, positions, rest: (n, 3) f32.
        low, high: See `remapped`, f32.
    """
    if source == U:
        value = uv[i, 0]
    elif source == V:
        value = uv[i, 1]
    elif source == V_MINUS_U:
        value = uv[i, 1] - uv[i, 0]
    elif source == CROWDING:
        value = crowding[i]
    elif source == AGE:
        value = np.float32(now - births[i])
    elif source == SPEED:
        value = _length(velocities[i, 0], velocities[i, 1], velocities[i, 2])
    else:
        value = _length(
            positions[i, 0] - rest[i, 0],
            positions[i, 1] - rest[i, 1],
            positions[i, 2] - rest[i, 2],
        )
    out[i] = remapped(value, low, high, ease)


@kernel(over="part", writes=("positions", "scales", "opacities"))
def drive(i, output, part, amount, positions, scales, opacities, normals):
    """Apply amounts to one output, in place.

    Args:
        output: One of the constants above.
        part: Results of `amounts`, (n,) f32.
        amount: Effect where part is 1: a factor, or the displacement [unit]; f32.
        positions, scales, normals: (n, 3) f32. opacities: (n,) f32. Arrays that the output does not
            use may be empty.
    """
    factor = max(_ZERO, _ONE + part[i] * (amount - _ONE))
    if output == SCALE:
        scales[i, 0] *= factor
        scales[i, 1] *= factor
        scales[i, 2] *= factor
    elif output == THICKNESS:
        x, y, z = scales[i, 0], scales[i, 1], scales[i, 2]
        if z <= x and z <= y:
            scales[i, 2] = z * factor
        elif y <= x:
            scales[i, 1] = y * factor
        else:
            scales[i, 0] = x * factor
    elif output == OPACITY:
        opacities[i] = min(_ONE, opacities[i] * factor)
    else:
        way = part[i] * amount
        positions[i, 0] += way * normals[i, 0]
        positions[i, 1] += way * normals[i, 1]
        positions[i, 2] += way * normals[i, 2]


@kernel(over="part", writes=("sh",))
def tint(i, part, amount, color, sh_fade, sh):
    """Mix with a colour, in place.

    Args:
        part: Results of `amounts`, (n,) f32. amount: Weight of the colour where part is 1, f32.
        color: (3,) f32. sh_fade: Fraction by which higher bands are reduced, f32.
        sh: (n, k, 3) f32.
    """
    much = min(_ONE, max(_ZERO, part[i] * amount))
    if much == _ZERO:
        return
    for c in range(3):
        sh[i, 0, c] = faded(sh[i, 0, c], (color[c] - _HALF) / _C0, much)
    rest = _ONE - much * sh_fade
    for k in range(1, sh.shape[1]):
        for c in range(3):
            sh[i, k, c] *= rest
