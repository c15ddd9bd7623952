"""Divide colours among the lights that cause them.

A colour that is lit by E and by ambient light A is a sum: its part by one light is the colour times
E_l / (E + A), and what is left is its part by A. Shares of all lights and of A add up to 1, so the
parts add up to the colour, also where a gain was clamped.
"""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel


@scalar
def share_of(part, whole, otherwise):
    """Return part / whole, or `otherwise` where there is no light, or no finite one."""
    if np.float32(0) < whole < np.float32(np.inf):
        return part / whole
    return otherwise


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="sums", writes=("out",))
def shares(i, sums, part, ambient, rows, out):
    """Write the share of some lights, or of ambient light, in the light of a receiver.

    Args:
        sums: Light of all lights, see `lighting.illuminate`, shape (n, SUMS) f32.
        part: The same of some of them; empty for the share of ambient light, which has everything
            where nothing is lit.
        ambient: Light that no light of the stage explains, r g b, shape (3,) f32.
        rows, out: See `receivers.ratios`.
    """
    at = np.int64(i)
    if rows.shape[0] > 0:
        at = i - i % rows.shape[0] + rows[i % rows.shape[0]]
    for c in range(3):
        whole = sums[i, c] + ambient[c]
        if part.shape[0] > 0:
            out[at, c] = share_of(part[i, c], whole, np.float32(0))
        else:
            out[at, c] = share_of(ambient[c], whole, np.float32(1))


@kernel(over="sums", writes=("out",))
def arrivals(i, sums, rows, out):
    """Write the light that arrives at a receiver, in the order of rows; see `receivers.ratios`."""
    at = np.int64(i)
    if rows.shape[0] > 0:
        at = i - i % rows.shape[0] + rows[i % rows.shape[0]]
    for c in range(3):
        out[at, c] = sums[i, c]


@kernel(over="found", writes=("paints",), team=True)
def paint(
    item, lane, lanes, shares, count, drawn, turns, block, base, sources, found, records, red,
    paints, column,
):  # fmt: skip
    """Write the part of the linear colours of the visible splats of all instances of one field.

    Args:
        shares: Shares r g b of each instance and splat, shape (instances * count, 3) f32.
        count, drawn, turns, block, base, sources, found: See `receivers.dim`; sources are rows of
            the field.
        records, red: Splats by slot, and the first of three columns with their lit colours.
        paints, column: Receives the part in three columns of each used slot, f32.
    """
    blocks = (drawn + block - 1) // block
    first = np.int64(item // blocks) * count
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        i = first + np.int64(sources[at])
        r, g, b = records[at, red], records[at, red + 1], records[at, red + 2]
        if turns.shape[0] == 0:
            paints[at, column] = r * shares[i, 0]
            paints[at, column + 1] = g * shares[i, 1]
            paints[at, column + 2] = b * shares[i, 2]
            continue
        x = turns[0, 0, 0] * r + turns[0, 0, 1] * g + turns[0, 0, 2] * b
        y = turns[0, 1, 0] * r + turns[0, 1, 1] * g + turns[0, 1, 2] * b
        z = turns[0, 2, 0] * r + turns[0, 2, 1] * g + turns[0, 2, 2] * b
        x, y, z = x * shares[i, 0], y * shares[i, 1], z * shares[i, 2]
        for c in range(3):
            paints[at, column + c] = turns[1, c, 0] * x + turns[1, c, 1] * y + turns[1, c, 2] * z


@kernel(over="found", writes=("paints",), team=True)
def paint_all(item, lane, lanes, factor, block, base, found, records, red, paints, column):
    """Write the colours times a factor of the visible splats of a field; see `paint`."""
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        for c in range(3):
            paints[at, column + c] = factor * records[at, red + c]


@kernel(over="light", writes=("sums", "part"))
def collect(i, light, first, sums, part):
    """Add the light of one light at a pixel to that of all, and to that of its part.

    Args:
        light: See `lighting.illuminate`, shape (h * w, SUMS) f32.
        first: First of the three columns that count for the part: with or without shadows.
        sums: Changed in place, same shape.
        part: Changed in place, shape (h * w, 3) f32; empty if nothing asks for it.
    """
    for c in range(light.shape[1]):
        sums[i, c] += light[i, c]
    if part.shape[0] > 0:
        for c in range(3):
            part[i, c] += light[i, first + c]


@kernel(over="color", writes=("out",), axes=2)
def surface_part(y, x, color, sums, part, first, ambient, out):
    """Write the part of the colours of surfaces.

    Args:
        color: Colours of lit surfaces, shape (h, w, 3) f32.
        sums, first: See `collect`.
        part: Light of the part, shape (h * w, 3) f32; empty for that of ambient light.
        ambient: Ambient light as a part of the light without shadows.
        out: Receives r g b, shape (h, w, 3) f32.
    """
    i = y * color.shape[1] + x
    for c in range(3):
        more = ambient * sums[i, 3 + c]
        whole = sums[i, first + c] + more
        if part.shape[0] > 0:
            share = share_of(part[i, c], whole, np.float32(0))
        else:
            share = share_of(more, whole, np.float32(1))
        out[y, x, c] = color[y, x, c] * share


@kernel(over="out", writes=("out",), axes=2)
def mean_light(y, x, splats, left, sums, out):
    """Write the mean light that arrives at what a pixel shows; 0 in empty pixels.

    Args:
        splats: Sums of the light of splats times their contributions, and of these, (h, w, 4) f32.
        left: Transmittance of the splats to the surfaces, shape (h, w) f32; empty without surfaces.
        sums: See `lighting.illuminate`, row y * width + x; not read without surfaces.
        out: Receives r g b, shape (h, w, 3) f32.
    """
    weight, part = splats[y, x, 3], np.float32(0)
    if left.shape[0] > 0:
        part = left[y, x]
    whole = weight + part
    i = y * out.shape[1] + x
    for c in range(3):
        light = splats[y, x, c]
        if part > np.float32(0):
            light += part * sums[i, c]
        out[y, x, c] = light / whole if whole > np.float32(0) else np.float32(0)
