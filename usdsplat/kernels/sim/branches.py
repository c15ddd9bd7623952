"""New matter as branches: splats on the surface of tapered ones that bend, with rounded tips."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)
LEAST = np.float32(1e-9)
TAPER = np.float32(0.5)
"""Part of the radius that is lost up to the tip."""
FLARE = np.float32(0.6)
"""Part of the radius by which a finger is wider at its root."""
RAISED = np.float32(0.16)
"""How far polyps stand out, relative to the radius."""
PALE = np.float32(0.12)
"""Length of the pale tip, relative to the longest finger."""
DEEP = np.float32(0.28)
"""Distance from its root at which a finger leaves the shadow of its colony, relative to the
longest."""


# --- 1. mathematics: one splat ----------------------------------------------------------


@scalar
def unit(x, y, z):
    """Return a vector of length 1; 0 stays 0."""
    k = ONE / max(math.sqrt(x * x + y * y + z * z), np.float32(1e-12))
    return x * k, y * k, z * k


@scalar
def clipped(x):
    """Return a number, but at least 0 and at most 1."""
    return min(max(x, ZERO), ONE)


# --- 2. loop ----------------------------------------------------------------------------


@kernel(over="slots", writes=("positions", "normals", "tones", "tints", "opened", "spread"))
def place(
    k, slots, branch, part, ways, polyp, apart, grown, roots, offsets, axes, bends, lengths, radii,
    delays, full, positions, normals, tones, tints, opened, spread,
):  # fmt: skip
    """Place a splat on a branch, as long and wide as that is now.

    Lengths of branches are relative to the longest finger.

    Args:
        slots: Number of the place of each splat, shape (d,) i64.
        branch, part, ways, polyp, apart: By place: branch i64; place along it, 0 to 1; unit vector
            from the middle line where the branch begins; 1 for polyps, 0 for others; mean distance
            of splats; f32.
        grown: Part of its length that each branch has grown, shape (b,) f32.
        roots, offsets, axes, bends, lengths, radii, delays: See `sim.branches.Branches`, f32.
        full: Length of the longest finger [unit], f32.
        positions: Receives [unit], shape (d, 3) f32. normals: Receives unit normals, (d, 3) f32.
        tones: Receives the place on the ramp, 0 at the root to 1 at the tip, shape (d,) f32.
        tints: Receives how much of the colony's tint a place has, 0 to 1, shape (d,) f32.
        opened: Receives 0 in the depth of a colony to 1, shape (d,) f32.
        spread: Receives the mean distance of splats [unit], 0 where the branch has not begun, shape
            (d,) f32.
    """
    slot = slots[k]
    b, s, is_polyp = branch[slot], part[slot], polyp[slot]
    length, done = lengths[b], grown[b]
    v = s * done
    ax, ay, az = axes[b, 0], axes[b, 1], axes[b, 2]
    bx, by, bz = v * bends[b, 0], v * bends[b, 1], v * bends[b, 2]
    far = length * v
    x, y, z = offsets[b, 0], offsets[b, 1], offsets[b, 2]
    x, y, z = x + far * (ax + bx), y + far * (ay + by), z + far * (az + bz)
    ax, ay, az = unit(ax + TWO * bx, ay + TWO * by, az + TWO * bz)
    ox, oy, oz = ways[slot, 0], ways[slot, 1], ways[slot, 2]
    along = ox * ax + oy * ay + oz * az
    ox, oy, oz = unit(ox - along * ax, oy - along * ay, oz - along * az)
    wide = radii[b] * (np.float32(0.3) + np.float32(0.7) * done)
    wider = FLARE * math.exp(np.float32(-9) * s) if delays[b] == ZERO else ZERO
    radius, tip = wide * (ONE - TAPER * s + wider), wide * (ONE - TAPER)
    left = (ONE - s) * length * done
    below = clipped(left / max(tip, LEAST))  # the tip is a hemisphere
    level = math.sqrt(max(ONE - (ONE - below) * (ONE - below), ZERO))
    up = ONE - below
    nx, ny, nz = level * ox + up * ax, level * oy + up * ay, level * oz + up * az
    out, more = radius * level, RAISED * is_polyp * wide * level
    x, y, z = x + out * ox + more * nx, y + out * oy + more * ny, z + out * oz + more * nz
    high = math.sqrt(x * x + y * y + z * z)
    pale = clipped(ONE - left / max(min(PALE, np.float32(0.4) * length), LEAST))
    white = pale * min(max(length / np.float32(0.3), np.float32(0.3)), ONE)
    tone = np.float32(0.12) + np.float32(0.5) * clipped(high / np.float32(0.8))
    tone += np.float32(0.12) * is_polyp
    positions[k, 0] = roots[b, 0] + full * x
    positions[k, 1] = roots[b, 1] + full * y
    positions[k, 2] = roots[b, 2] + full * z
    normals[k, 0], normals[k, 1], normals[k, 2] = nx, ny, nz
    tones[k] = tone + (ONE - tone) * white
    tints[k] = ONE - np.float32(0.85) * white
    opened[k] = clipped(high / DEEP + pale)
    near = apart[slot] * (ONE - np.float32(0.45) * is_polyp)
    spread[k] = full * min(near, np.float32(1.1) * tip) if done > ZERO else ZERO
