"""Free flight: gravity, drag and turbulent air.

Drag is exact for air of constant velocity. Everything else is symplectic Euler, of first order in
the step. `flight` is the closed form without turbulence.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import EACH, BlockArray, block_kernel

from .noise import cell, change, curl_in_cell

SMALL = 1e-2
"""Drag times seconds under which the closed form is replaced by a series."""

_ZERO, _ONE = np.float32(0), np.float32(1)


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def _velocity(v, pull, air, keep):
    """Return v [unit/s] after a step.

    pull: velocity added by gravity; keep: factor by drag on v - air.
    """
    return air + (v + pull - air) * keep


@scalar
def decay(z):
    """Return averages of e^(-z): (1 - e^(-z)) / z, and (z - 1 + e^(-z)) / z², for z >= 0,
    float64."""
    if z < SMALL:
        second = 0.5 - z * (1 / 6 - z * (1 / 24 - z * (1 / 120 - z * (1 / 720 - z / 5040))))
        return 1.0 - z * second, second
    first = -math.expm1(-z) / z
    return first, (1.0 - first) / z


@scalar
def flight(v, push, drag, seconds):
    """Return displacement and velocity along one axis after some seconds of dv/dt = push - drag v,
    float64.

    v: initial velocity; push: gravity + drag times the velocity of the air.
    """
    first, second = decay(drag * seconds)
    way = seconds * (v * first + push * seconds * second)
    return way, v * math.exp(-drag * seconds) + push * seconds * first


# --- 2. CPU ----------------------------------------------------------------------------


@serial
def _whirls(count, cells, within, first, part, second, other, air):
    """Compute the turbulent velocity at `count` points of a block, in a loop that can be
    vectorized."""
    for k in range(count):
        ix, iy, iz = cells[0, k], cells[1, k], cells[2, k]
        fx, fy, fz = within[0, k], within[1, k], within[2, k]
        a, b, c = curl_in_cell(ix, iy, iz, fx, fy, fz, first)
        p, q, r = curl_in_cell(ix, iy, iz, fx, fy, fz, second)
        air[0, k], air[1, k] = part * a + other * p, part * b + other * q
        air[2, k] = part * c + other * r


@block_kernel(
    over="positions",
    writes=("positions", "velocities"),
    scratch=(
        BlockArray(shape=(4, EACH), dtype=np.uint32),
        BlockArray(shape=(6, EACH), dtype=np.float32),
    ),
)
def fly(
    begin, end, whole, parts, positions, velocities, flags, wanted, excluded, pull, wind, extra,
    to_world, from_world, whirl, per_length, time, keep, drag, factors, dt, limit, seed,
):  # fmt: skip
    """Move splats by a step, in place.

    Args:
        whole, parts: Scratch: rows and cells; velocities of the air and positions within cells.
        positions, velocities: (n, 3) f32.
        flags: (n,) u32; splats move that have all bits of `wanted` and none of `excluded`.
        pull: Gravity times dt, (3,) f32. wind: Velocity of the air, (3,) f32.
        extra: Additional wind for each splat, (n, 3) f32, or (0, 3).
        to_world: (4, 4) f64, from the splats' space to that of the turbulence. from_world: (3, 3)
            f64, vectors back.
        whirl: Speed of the turbulence. per_length: 1 / its size, f64. time: In periods of its
            change, f64.
        keep: e^(-drag dt). drag: [1/s]. f32.
        factors: Factors of gravity, wind, turbulence and drag of each splat, (n, 4) f32, or (0, 4).
        dt, limit: Step [s] and largest speed, f32.
        seed: Seed of the turbulence.
    """
    first, part, second, other = change(time, seed)
    rows, cells, air, within = whole[0], whole[1:], parts[:3], parts[3:]
    count = 0
    for i in range(begin, end):
        rows[count] = i - begin
        count += flags[i] & (wanted | excluded) == wanted
    masked = len(factors) > 0
    if whirl > _ZERO:
        for k in range(count):
            i = begin + rows[k]
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            for c in range(3):
                m = to_world[c]
                along = m[0] * x + m[1] * y + m[2] * z + m[3]
                cells[c, k], within[c, k] = cell(along * per_length)
        _whirls(count, cells, within, first, part, second, other, air)
        for k in range(count):
            x, y, z = air[0, k], air[1, k], air[2, k]
            for c in range(3):
                m = from_world[c]
                gust = whirl * np.float32(m[0] * x + m[1] * y + m[2] * z)
                if masked:
                    i = begin + rows[k]
                    air[c, k] = wind[c] * factors[i, 1] + gust * factors[i, 2]
                else:
                    air[c, k] = wind[c] + gust
    elif masked:
        for k in range(count):
            for c in range(3):
                air[c, k] = wind[c] * factors[begin + rows[k], 1]
    else:
        for c in range(3):
            air[c, :] = wind[c]
    for k in range(count):
        i = begin + rows[k]
        ax, ay, az = air[0, k], air[1, k], air[2, k]
        if len(extra):
            ax, ay, az = ax + extra[i, 0], ay + extra[i, 1], az + extra[i, 2]
        part, own = _ONE, keep
        if masked:
            part, own = factors[i, 0], np.float32(math.exp(-drag * factors[i, 3] * dt))
        vx = _velocity(velocities[i, 0], pull[0] * part, ax, own)
        vy = _velocity(velocities[i, 1], pull[1] * part, ay, own)
        vz = _velocity(velocities[i, 2], pull[2] * part, az, own)
        speed = np.float32(math.sqrt(vx * vx + vy * vy + vz * vz))
        if speed > limit:
            less = limit / speed
            vx, vy, vz = vx * less, vy * less, vz * less
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = vx, vy, vz
        positions[i, 0] += dt * vx
        positions[i, 1] += dt * vy
        positions[i, 2] += dt * vz
