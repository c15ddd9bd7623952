"""New matter over carriers: heights from the pattern, and discs in layers on the raised surface.

A carrier at X with the normal n is raised to X + h n, where the height h follows the pattern. The
normals of the raised surface are those of the linear fit of the heights around each carrier. Discs
lie on it, at falling fractions of the height, so that the rise is closed from all sides.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.directions import around
from usdsplat.kernels.sim.laplacian import falloff
from usdsplat.kernels.sim.matrix import matrix_quat
from usdsplat.kernels.sim.philox import ACCRETION, uniforms

ZERO, ONE, TWO, HALF = np.float32(0), np.float32(1), np.float32(2), np.float32(0.5)
DOME, RIDGE, PLATE, THORN = range(4)
"""Profiles."""
BY_V, BY_HEIGHT, BY_AGE, BY_CURVATURE = range(4)
"""What the ramp follows."""
COLORS = 64
"""Entries of a ramp."""
VALLEY = np.float32(0.9)
"""Depth below the surroundings, in distances of carriers, at which matter is darkest."""
(
    RELIEF, SIZE, THICKNESS, OPACITY, JITTER, TILT, VARIATION, SHADE, OCCLUSION, RAMP_TIME, RISE,
    SPACING, GLOSS,
) = range(13)  # fmt: skip
"""Entries of the numbers that `discs` takes; lengths are in distances of carriers."""


# --- 1. mathematics: one carrier, or one disc -------------------------------------------


@scalar
def step_of(x, low, high):
    """Return 0 below `low`, 1 above `high`, and a smooth step between."""
    t = min(max((x - low) / max(high - low, np.float32(1e-6)), ZERO), ONE)
    return t * t * (np.float32(3) - TWO * t)


@scalar
def raised(t, profile):
    """Return the height of a profile, 0 to 1, for a strength of the pattern, 0 to 1."""
    if profile == DOME:
        return math.sqrt(max(ONE - (ONE - t) * (ONE - t), ZERO))
    if profile == PLATE:
        return min(np.float32(4) * t, ONE)
    if profile == THORN:
        return t * t * t
    return t


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="values", writes=("out",))
def smooth(i, positions, support, rows, neighbours, values, out):
    """Average values over neighbourhoods.

    Args:
        positions, support, rows, neighbours: See `Graph`.
        values: Shape (c,) f32, by slot. out: Receives means, shape (c,) f32.
    """
    scale = ONE / (support[i] * support[i])
    total, weight = values[i], ONE
    for e in range(rows[i], rows[i + 1]):
        j = neighbours[e]
        x = positions[j, 0] - positions[i, 0]
        y = positions[j, 1] - positions[i, 1]
        z = positions[j, 2] - positions[i, 2]
        w = falloff((x * x + y * y + z * z) * scale)
        total += w * values[j]
        weight += w
    out[i] = total / weight


@kernel(over="values", writes=("heights",))
def raise_carriers(i, values, allowed, low, high, relief, profile, heights):
    """Compute the heights of carriers.

    Args:
        values: v, shape (c,) f32. allowed: Factor of the height, 0 to 1, shape (c,) f32.
        low, high: v between which matter rises, f32. relief: Full height [unit], f32.
        profile: One of DOME, RIDGE, PLATE, THORN.
        heights: Receives heights [unit], shape (c,) f32.
    """
    heights[i] = relief * allowed[i] * raised(step_of(values[i], low, high), profile)


@kernel(over="heights", writes=("facing", "over"))
def face(i, positions, normals, support, rows, neighbours, heights, facing, over):
    """Compute the normals of the raised surface, and how far it stands out.

    Args:
        positions, support, rows, neighbours: See `Graph`, c carriers by slot.
        normals: Unit normals of the carriers, shape (c, 3) f32.
        heights: Heights [unit], shape (c,) f32.
        facing: Receives unit normals of the raised surface, shape (c, 3) f32.
        over: Receives the height over the mean of the neighbours [unit], shape (c,) f32.
    """
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    scale = ONE / (support[i] * support[i])
    gx, gy, gz, moment, mean, weight = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for e in range(rows[i], rows[i + 1]):
        j = neighbours[e]
        x = positions[j, 0] - positions[i, 0]
        y = positions[j, 1] - positions[i, 1]
        z = positions[j, 2] - positions[i, 2]
        square = x * x + y * y + z * z
        w = falloff(square * scale)
        rise = heights[j] - heights[i]
        gx, gy, gz = gx + w * rise * x, gy + w * rise * y, gz + w * rise * z
        moment += w * square
        mean += w * heights[j]
        weight += w
    if moment > ZERO:
        k = TWO / moment  # of a surface: the moment is shared by two directions
        along = (gx * nx + gy * ny + gz * nz) * k
        gx, gy, gz = gx * k - along * nx, gy * k - along * ny, gz * k - along * nz
        nx, ny, nz = nx - gx, ny - gy, nz - gz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    k = ONE / length if length > ZERO else ZERO
    facing[i, 0], facing[i, 1], facing[i, 2] = nx * k, ny * k, nz * k
    over[i] = heights[i] - mean / weight if weight > ZERO else ZERO


@kernel(over="rows", writes=("positions", "rotations", "scales", "opacities", "colors"))
def discs(
    k, rows, carrier, layer, layers, ids, births, now, seed, numbers, ramp_by, ramp, light, places,
    normals, values, heights, facing, over, positions, rotations, scales, opacities, colors,
):  # fmt: skip
    """Place the discs of new matter.

    Args:
        rows: Rows of the discs in the arrays of the state, shape (d,) i64.
        carrier, layer: Carrier and layer of each row, -1 for others, shape (n,) i32.
        layers: Number of layers.
        ids, births: Identity and time of birth [s] of each row, (n,) i64 and f32.
        now: Time since the simulation's start [s], f32. seed: Seed of the random numbers.
        numbers: See RELIEF and the following, f32.
        ramp_by: One of BY_V, BY_HEIGHT, BY_AGE, BY_CURVATURE. ramp: Colours, shape (COLORS, 3) f32.
        light: Unit vector to the light, shape (3,) f32.
        places, normals: Positions and unit normals of the carriers at rest, shape (c, 3) f32.
        values, heights, facing, over: Place on the ramp, height [unit], and results of `face`, by
            carrier.
        positions, rotations, scales, opacities, colors: Receive the discs, n rows.
    """
    i = rows[k]
    c = carrier[i]
    spacing = numbers[SPACING]
    a, b, e, f = uniforms(seed, ACCRETION, ids[i], 0, 0)
    g, h, p, q = uniforms(seed, ACCRETION, ids[i], 0, 1)
    age = now - births[i]
    t = min(max(age / max(numbers[RISE], np.float32(1e-6)), ZERO), ONE)
    eased = t * t * (np.float32(3) - TWO * t)
    # the topmost layer is on the surface; the second is too, but shifted
    depth = np.float32(max(layer[i] - 1, 0)) / np.float32(max(layers - 1, 1))
    if layer[i] > 1:
        depth += (g - HALF) / np.float32(layers)
    part = max(ONE - depth, ZERO) * eased
    nx, ny, nz = facing[c, 0], facing[c, 1], facing[c, 2]
    x, y, z = around(nx, ny, nz, ZERO, a)
    away = ZERO if layer[i] == 0 else numbers[JITTER] * spacing * math.sqrt(b)
    up = part * heights[c]
    positions[i, 0] = places[c, 0] + up * normals[c, 0] + away * x
    positions[i, 1] = places[c, 1] + up * normals[c, 1] + away * y
    positions[i, 2] = places[c, 2] + up * normals[c, 2] + away * z
    cosine = math.cos(numbers[TILT] * e)
    mx, my, mz = around(nx, ny, nz, np.float32(cosine), f)
    tx, ty, tz = around(mx, my, mz, ZERO, p)
    ux, uy, uz = my * tz - mz * ty, mz * tx - mx * tz, mx * ty - my * tx
    w, qx, qy, qz = matrix_quat((tx, ux, mx, ty, uy, my, tz, uz, mz))
    rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3] = w, qx, qy, qz
    vary = ONE + numbers[VARIATION] * (TWO * q - ONE)
    wide = numbers[SIZE] * spacing * vary * (np.float32(0.35) + np.float32(0.65) * eased)
    scales[i, 0], scales[i, 1] = wide, wide
    high = numbers[THICKNESS] * spacing * vary
    full = max(numbers[RELIEF] * spacing, np.float32(1e-9))
    if numbers[THICKNESS] > numbers[SIZE]:  # needles grow with the height
        high *= max(part * heights[c] / full, HALF * HALF)
    scales[i, 2] = high
    opacities[i] = numbers[OPACITY] * eased
    stands = over[c] / (VALLEY * spacing)
    if ramp_by == BY_V:
        at = values[c]
    elif ramp_by == BY_HEIGHT:
        at = heights[c] / full
    elif ramp_by == BY_AGE:
        at = age / numbers[RAMP_TIME]
    else:
        at = HALF + HALF * stands
    at = min(max(at, ZERO), ONE) * np.float32(COLORS - 1)
    first = min(np.int64(at), COLORS - 2)
    mix = at - np.float32(first)
    toward = max(mx * light[0] + my * light[1] + mz * light[2], ZERO)
    bright = ONE - numbers[SHADE] + numbers[SHADE] * (np.float32(0.3) + np.float32(0.95) * toward)
    dark = min(max(HALF - HALF * stands, ZERO), ONE) + np.float32(0.5) * depth
    bright *= max(ONE - numbers[OCCLUSION] * min(dark, ONE), ZERO)
    bright *= ONE + HALF * numbers[VARIATION] * (TWO * h - ONE)
    glint = numbers[GLOSS] * toward ** np.float32(12) * (ONE - min(dark, ONE))
    for channel in range(3):
        color = ramp[first, channel] * (ONE - mix) + ramp[first + 1, channel] * mix
        colors[i, channel] = min(max(color * bright + glint, ZERO), np.float32(4))
