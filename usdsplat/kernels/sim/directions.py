"""Directions around a normal, and vectors that rotate with a splat."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar

_ZERO, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)
_FULL = np.float32(2 * math.pi)
_SHORT = np.float32(0.25)


@scalar
def is_normal(x, y, z):
    """Return whether this is a unit vector, not the zero vector that marks a missing normal."""
    return x * x + y * y + z * z > _SHORT


@scalar
def around(nx, ny, nz, cosine, turn):
    """Return a unit vector at an angle from the unit vector n, or from z if n is not a unit vector.

    cosine: cosine of the angle. turn: azimuth around n, in turns, [0, 1).
    Source of the basis: Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    if not is_normal(nx, ny, nz):
        nx, ny, nz = _ZERO, _ZERO, _ONE
    sign = np.float32(math.copysign(_ONE, nz))
    a = -_ONE / (sign + nz)
    b = nx * ny * a
    sine = np.float32(math.sqrt(max(_ZERO, _ONE - cosine * cosine)))
    c, s = sine * np.float32(math.cos(_FULL * turn)), sine * np.float32(math.sin(_FULL * turn))
    return (
        c * (_ONE + sign * nx * nx * a) + s * b + cosine * nx,
        c * (sign * b) + s * (sign + ny * ny * a) + cosine * ny,
        c * (-sign * nx) - s * ny + cosine * nz,
    )


@scalar
def turned(w, x, y, z, vx, vy, vz):
    """Return a vector rotated by the unit quaternion (w, x, y, z)."""
    tx, ty, tz = _TWO * (y * vz - z * vy), _TWO * (z * vx - x * vz), _TWO * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


@scalar
def carried(w, x, y, z, rw, rx, ry, rz, vx, vy, vz):
    """Return a rest vector as rotated now, for a splat that rotated from quaternion r to (w, x, y,
    z)."""
    vx, vy, vz = turned(rw, -rx, -ry, -rz, vx, vy, vz)
    return turned(w, x, y, z, vx, vy, vz)
