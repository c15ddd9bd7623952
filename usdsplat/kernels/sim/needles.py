"""New matter as needles: six-sided prisms with points, whose facets are covered by flat splats."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.directions import around
from usdsplat.kernels.sim.matrix import matrix_quat

ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
SIDES = 6
"""Facets around a needle."""
ABREAST = 2
"""Splats across a facet: one alone would look round."""
SHOULDER = np.float32(0.76)
"""Part of the length where the point begins."""
NARROWER = np.float32(0.1)
"""Part of the radius that is lost up to there."""
SUNK = np.float32(0.06)
"""Part of the length that is below the surface."""
FULL, OPACITY, SHADE, GLOSS, THICKNESS, WIDEN = range(6)
"""Entries of the numbers that `facets` takes; FULL is the length of the longest needle [unit],
THICKNESS a length [unit]."""


@kernel(over="rows", writes=("positions", "rotations", "scales", "opacities", "colors"))
def facets(
    k, rows, carrier, layer, layers, site, rank, count, bases, axes, lengths, radii, grown, numbers,
    ramp, light, positions, rotations, scales, opacities, colors,
):  # fmt: skip
    """Place the splats of needles.

    The splats of a needle are numbered by the rank of their carrier and their layer; they share its
    facets, rows along its length, and the places across a facet. Each facet has one brightness, as
    what is flat has.

    Args:
        rows: Rows of the splats in the arrays of the state, shape (d,) i64.
        carrier, layer: Carrier and layer of each row, -1 for others, shape (n,) i32.
        layers: Number of layers.
        site, rank: Needle of each carrier, and place among its carriers, shape (c,) i32.
        count: Number of carriers of each needle, shape (s,) i32.
        bases, axes: Lower ends [unit] and unit directions of needles, shape (s, 3) f32.
        lengths, radii: Relative to the longest needle, shape (s,) f32.
        grown: Part of the length that each needle has grown, shape (s,) f32.
        numbers: See FULL and the following, f32.
        ramp: Colours from the lower end to the tip, shape (m, 3) f32.
        light: Unit vector to the light, shape (3,) f32.
        positions, rotations, scales, opacities, colors: Receive the splats, n rows.
    """
    i = rows[k]
    c = carrier[i]
    s = site[c]
    number = rank[c] * layers + layer[i]
    steps = max((count[s] * layers) // (SIDES * ABREAST), 1)
    side, step = number % SIDES, min(number // (SIDES * ABREAST), steps - 1)
    abreast = np.float32((number // SIDES) % ABREAST) - HALF * np.float32(ABREAST - 1)
    part = grown[s]
    length = numbers[FULL] * lengths[s] * part
    radius = numbers[FULL] * radii[s] * math.sqrt(part)
    at = (np.float32(step) + HALF) / np.float32(steps)
    ax, ay, az = axes[s, 0], axes[s, 1], axes[s, 2]
    turn = np.float32(side) / np.float32(SIDES) + np.float32(s % 7) * np.float32(0.03)
    rx, ry, rz = around(ax, ay, az, ZERO, turn - np.float32(math.floor(turn)))
    apothem = radius * np.float32(0.866)
    if at < SHOULDER:
        narrow = ONE - NARROWER * at / SHOULDER
        slope = apothem * NARROWER / max(SHOULDER * length, np.float32(1e-9))
    else:
        narrow = (ONE - NARROWER) * (ONE - at) / (ONE - SHOULDER)
        slope = apothem * (ONE - NARROWER) / max((ONE - SHOULDER) * length, np.float32(1e-9))
    scale = ONE / math.sqrt(ONE + slope * slope)
    nx, ny, nz = (rx + slope * ax) * scale, (ry + slope * ay) * scale, (rz + slope * az) * scale
    ux, uy, uz = (ax - slope * rx) * scale, (ay - slope * ry) * scale, (az - slope * rz) * scale
    vx, vy, vz = uy * nz - uz * ny, uz * nx - ux * nz, ux * ny - uy * nx
    high, out = (at - SUNK) * length, apothem * narrow
    across = radius * narrow / np.float32(ABREAST)
    aside = abreast * across
    positions[i, 0] = bases[s, 0] + high * ax + out * rx + aside * vx
    positions[i, 1] = bases[s, 1] + high * ay + out * ry + aside * vy
    positions[i, 2] = bases[s, 2] + high * az + out * rz + aside * vz
    w, qx, qy, qz = matrix_quat((vx, ux, nx, vy, uy, ny, vz, uz, nz))
    rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3] = w, qx, qy, qz
    thin = numbers[THICKNESS]
    scales[i, 0] = max(numbers[WIDEN] * across, thin)
    scales[i, 1] = max(np.float32(0.6) * length / np.float32(steps), thin)
    scales[i, 2] = thin
    opacities[i] = numbers[OPACITY] if part > ZERO else ZERO
    last = ramp.shape[0] - 1
    place = at * np.float32(last)
    first = min(np.int64(place), last - 1)
    mix = place - np.float32(first)
    toward = HALF + HALF * (nx * light[0] + ny * light[1] + nz * light[2])
    toward *= toward
    bright = ONE - numbers[SHADE] + numbers[SHADE] * (np.float32(0.12) + np.float32(1.35) * toward)
    # facets of a crystal are not equally clear, and the surroundings lie in its shadow
    bright *= np.float32(0.82) + np.float32(0.09) * np.float32((3 * s + 5 * side) % 5)
    bright *= np.float32(0.4) + np.float32(0.6) * min(at * np.float32(2.5), ONE)
    glint = numbers[GLOSS] * toward ** np.float32(9)
    for channel in range(3):
        color = ramp[first, channel] * (ONE - mix) + ramp[first + 1, channel] * mix
        colors[i, channel] = min(max(color * bright + glint, ZERO), np.float32(4))
