"""New matter as tubes. Splats lie around the middle line of a branch, and are longer along it than
across."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.matrix import matrix_quat
from usdsplat.kernels.sim.philox import ACCRETION, uniforms

ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
OPEN = np.float32(1.45)
"""Largest angle of a splat from the highest line of a tube, around it to each side [rad]. Beyond
it, the tube lies on the surface and is not seen."""
ALONG, ACROSS = np.float32(0.8), np.float32(0.42)
"""Standard deviations of a splat: along a tube in distances of carriers, and across relative to its
radius."""
SPACING, OPACITY, SHADE, GLOSS, THICKNESS = range(5)
"""Entries of the numbers that `strokes` takes; SPACING and THICKNESS are lengths [unit]."""


@kernel(over="rows", writes=("positions", "rotations", "scales", "opacities", "colors"))
def strokes(
    k, rows, carrier, layer, layers, ids, seed, normals, feet, ways, radii, numbers, ramp,
    light, positions, rotations, scales, opacities, colors,
):  # fmt: skip
    """Compute place, shape and colour of splat `rows[k]`, which belongs to a tube.

    Args:
        rows: Rows of the splats in the arrays of the state, shape (d,) i64.
        carrier, layer: Carrier and layer of each row, -1 for others, shape (n,) i32.
        layers: Number of layers, which share the arc across a tube.
        ids: Identity of each row, shape (n,) i64. seed: Seed of the random numbers.
        normals: Unit normals of the carriers, shape (c, 3) f32.
        feet: Point on the middle line of its tube for each carrier [unit], shape (c, 3) f32.
        ways: Unit vectors along the tube there, shape (c, 3) f32.
        radii: Radius of the tube there now [unit], 0 for none, shape (c,) f32.
        numbers: See SPACING and the following, f32.
        ramp: Colours from the sides to the highest line, shape (m, 3) f32.
        light: Unit vector to the light, shape (3,) f32.
        positions, rotations, scales, opacities, colors: Receive the splats, n rows.
    """
    i = rows[k]
    c = carrier[i]
    radius = radii[c]
    a, b, _, _ = uniforms(seed, ACCRETION, ids[i], 0, 0)
    ux, uy, uz = ways[c, 0], ways[c, 1], ways[c, 2]
    nx, ny, nz = normals[c, 0], normals[c, 1], normals[c, 2]
    along = nx * ux + ny * uy + nz * uz
    nx, ny, nz = nx - along * ux, ny - along * uy, nz - along * uz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < np.float32(1e-6):
        nx, ny, nz, length = normals[c, 0], normals[c, 1], normals[c, 2], ONE
    nx, ny, nz = nx / length, ny / length, nz / length
    vx, vy, vz = uy * nz - uz * ny, uz * nx - ux * nz, ux * ny - uy * nx
    step = (np.float32(layer[i]) + HALF + HALF * (a - HALF)) / np.float32(layers)
    angle = OPEN * (np.float32(2) * step - ONE)
    sine, cosine = np.float32(math.sin(angle)), np.float32(math.cos(angle))
    mx, my, mz = cosine * nx + sine * vx, cosine * ny + sine * vy, cosine * nz + sine * vz
    shift = HALF * numbers[SPACING] * (b - HALF)
    positions[i, 0] = feet[c, 0] + radius * mx + shift * ux
    positions[i, 1] = feet[c, 1] + radius * my + shift * uy
    positions[i, 2] = feet[c, 2] + radius * mz + shift * uz
    wx, wy, wz = uy * mz - uz * my, uz * mx - ux * mz, ux * my - uy * mx
    q, qx, qy, qz = matrix_quat((wx, ux, mx, wy, uy, my, wz, uz, mz))
    rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3] = q, qx, qy, qz
    scales[i, 0] = max(ACROSS * radius, numbers[THICKNESS])
    scales[i, 1] = ALONG * numbers[SPACING] if radius > ZERO else numbers[THICKNESS]
    scales[i, 2] = numbers[THICKNESS]
    opacities[i] = numbers[OPACITY] if radius > ZERO else ZERO
    last = ramp.shape[0] - 1
    place = cosine * np.float32(last)
    first = min(max(np.int64(place), 0), last - 1)
    mix = place - np.float32(first)
    toward = max(mx * light[0] + my * light[1] + mz * light[2], ZERO)
    bright = ONE - numbers[SHADE] + numbers[SHADE] * (np.float32(0.25) + np.float32(1.1) * toward)
    glint = numbers[GLOSS] * toward ** np.float32(14)
    for channel in range(3):
        color = ramp[first, channel] * (ONE - mix) + ramp[first + 1, channel] * mix
        colors[i, channel] = min(max(color * bright + glint, ZERO), np.float32(4))
