"""Find pairs of splats that one splat can replace, and merge them.

The mass of a splat is what it contributes to a picture: opacity times visible area, averaged over
all view directions. A pair is replaced by the Gaussian with the mean and covariance of both,
weighted by mass, with an opacity that keeps the sum of their masses. The cost estimates how far
pictures may change: the mass that moves to where none was, in nats (Runnalls 2007), plus the
variances of colour and opacity that are lost.
Source: Runnalls 2007, "Kullback-Leibler approach to Gaussian mixture reduction", eq. 16 and 21.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import exact, serial
from usdsplat.kernels.launch import kernel

OPAQUE = 0.999
"""Largest opacity of a merged splat.

Half of the excess, by its logarithm, makes the splat larger; the other half is assumed to be hidden
behind it.
"""
SEEN = 0.75
"""Exponent of a pair's mass in its cost; below 1, as large splats are seen from further away."""
SOFTNESS = 0.03
"""Fraction of a splat's size, squared, by which it is blurred before shapes are compared.

How thin a splat is does not matter to pictures once it is thin.
"""
NARROW = 1e-6
"""Smallest ratio of width to length of a splat.

Smaller ones are rounding errors of its covariance.
"""
TINY = 1e-30
"""Added to variances [unit^2], so that splats without size have a logarithm."""

# --- 1. mathematics ---------------------------------------------------------------------


@exact
def covariance(w, x, y, z, a, b, c):
    """Return R diag(a, b, c) R^T as (xx, xy, xz, yy, yz, zz), for a unit quaternion and
    variances."""
    r00, r01, r02 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r10, r11, r12 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r20, r21, r22 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return (
        a * r00 * r00 + b * r01 * r01 + c * r02 * r02,
        a * r00 * r10 + b * r01 * r11 + c * r02 * r12,
        a * r00 * r20 + b * r01 * r21 + c * r02 * r22,
        a * r10 * r10 + b * r11 * r11 + c * r12 * r12,
        a * r10 * r20 + b * r11 * r21 + c * r12 * r22,
        a * r20 * r20 + b * r21 * r21 + c * r22 * r22,
    )


@exact
def log_volume(xx, xy, xz, yy, yz, zz):
    """Return the logarithm of the blurred ellipsoid's volume, up to a constant."""
    soft = SOFTNESS * (xx + yy + zz) + TINY
    xx, yy, zz = xx + soft, yy + soft, zz + soft
    volume = (
        xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    )  # fmt: skip
    return 0.5 * math.log(max(volume, TINY * TINY * TINY))


@exact
def area(xx, xy, xz, yy, yz, zz):
    """Return the visible area of an ellipsoid, up to a constant: the root mean square over all view
    directions [unit^2]."""
    faces = xx * yy - xy * xy + yy * zz - yz * yz + zz * xx - xz * xz
    narrow = NARROW * (xx + yy + zz)
    return math.sqrt(max(faces, narrow * narrow) / 3)


@exact
def mixed(a, b, part, d, e):
    """Return one entry of a pair's covariance, from those of the first splat, which has the
    fraction `part` of the mass, and of the second.

    d, e: distances between the two splats along the entry's axes.
    """
    return part * a + (1 - part) * b + part * (1 - part) * d * e


@exact
def joined(i, j, part, positions, covariances):
    """Return the covariance of a pair of rows, of which the first has the fraction `part` of the
    mass."""
    dx = np.float64(positions[i, 0]) - positions[j, 0]
    dy = np.float64(positions[i, 1]) - positions[j, 1]
    dz = np.float64(positions[i, 2]) - positions[j, 2]
    return (
        mixed(covariances[i, 0], covariances[j, 0], part, dx, dx),
        mixed(covariances[i, 1], covariances[j, 1], part, dx, dy),
        mixed(covariances[i, 2], covariances[j, 2], part, dx, dz),
        mixed(covariances[i, 3], covariances[j, 3], part, dy, dy),
        mixed(covariances[i, 4], covariances[j, 4], part, dy, dz),
        mixed(covariances[i, 5], covariances[j, 5], part, dz, dz),
    )


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="scales", writes=("covariances", "masses", "volumes"))
def weigh(i, scales, rotations, opacities, covariances, masses, volumes):
    """Compute the values by which pairs are compared.

    Args:
        scales, rotations, opacities: Arrays of a cloud.
        covariances: Receives (xx, xy, xz, yy, yz, zz), (n, 6) f64.
        masses: Receives opacity times area [unit^2], (n,) f64.
        volumes: Receives logarithms of volumes, (n,) f64.
    """
    s0, s1, s2 = (
        np.float64(scales[i, 0]), np.float64(scales[i, 1]), np.float64(scales[i, 2])
    )  # fmt: skip
    xx, xy, xz, yy, yz, zz = covariance(
        np.float64(rotations[i, 0]), np.float64(rotations[i, 1]),
        np.float64(rotations[i, 2]), np.float64(rotations[i, 3]),
        s0 * s0, s1 * s1, s2 * s2,
    )  # fmt: skip
    covariances[i, 0], covariances[i, 1], covariances[i, 2] = xx, xy, xz
    covariances[i, 3], covariances[i, 4], covariances[i, 5] = yy, yz, zz
    masses[i] = opacities[i] * area(xx, xy, xz, yy, yz, zz)
    volumes[i] = log_volume(xx, xy, xz, yy, yz, zz)


@kernel(over="rows", writes=("partners", "costs"))
def cheapest(
    s, rows, near, positions, covariances, masses, volumes, opacities, sh, by_color, by_opacity,
    partners, costs,
):  # fmt: skip
    """Find the neighbour with which each splat forms the cheapest pair.

    Args:
        rows: Rows of the remaining splats, (m,) i32.
        near: Neighbours of each splat, as entries of `rows`, (m, k) i32; -1 or the splat itself is
            no neighbour.
        positions, covariances, masses, volumes, opacities: Values of all rows.
        sh: Harmonics of all rows, (n, 3 coefficients) f32.
        by_color, by_opacity: Cost of a squared difference of 1 [nat], float64.
        partners: Receives the neighbours, as entries of `rows`, (m,) i32; -1 if there is none.
        costs: Receives the costs of the pairs, (m,) f64; inf if there is none.
    """
    i = rows[s]
    partners[s], costs[s] = -1, np.inf
    for c in range(near.shape[1]):
        t = near[s, c]
        if t < 0 or t == s:
            continue
        j = rows[t]
        mass = masses[i] + masses[j]
        cost = 0.0
        if masses[i] > 0 and masses[j] > 0:
            part = masses[i] / mass
            xx, xy, xz, yy, yz, zz = joined(i, j, part, positions, covariances)
            volume = log_volume(xx, xy, xz, yy, yz, zz)
            nats = volume - part * volumes[i] - (1 - part) * volumes[j]
            seen = mass**SEEN
            if seen * nats < costs[s]:
                color = np.float32(0)
                for f in range(sh.shape[1]):
                    difference = sh[i, f] - sh[j, f]
                    color += difference * difference
                opacity = np.float64(opacities[i]) - opacities[j]
                lost = by_color * color + by_opacity * opacity * opacity
                nats += part * (1 - part) * lost
            cost = seen * nats
        if partners[s] < 0 or cost < costs[s]:
            partners[s], costs[s] = t, cost


@serial(writes=("taken", "pairs"))
def match(order, partners, most, taken, pairs):
    """Select pairs in order, none of which shares a splat with an earlier one.

    Args:
        order: Entries of `partners`, (m,) i64.
        partners: Partner of each entry, (m,) i32; -1 is none.
        most: Largest number of pairs.
        taken: Initially False; receives whether an entry is in a selected pair, (m,) bool.
        pairs: Receives the selected pairs, (most, 2) i32.

    Returns:
        Number of selected pairs.
    """
    found = 0
    for s in order:
        t = partners[s]
        if found == most:
            break
        if t >= 0 and not taken[s] and not taken[t]:
            taken[s] = taken[t] = True
            pairs[found, 0], pairs[found, 1] = s, t
            found += 1
    return found


@kernel(
    over="pairs",
    writes=(
        "positions", "covariances", "masses", "volumes", "opacities", "sh", "velocities", "merged",
        "gone",
    ),
)  # fmt: skip
def merge(
    p, pairs, rows, positions, covariances, masses, volumes, opacities, sh, velocities, merged, gone
):
    """Write each merged pair to the row of its heavier splat, or of the first if they are equally
    heavy.

    Args:
        pairs: Entries of `rows`, (p, 2) i32, each at most once.
        rows: Rows of the remaining splats, (m,) i32.
        positions, covariances, masses, volumes, opacities, sh: Values of all rows; changed in
            place.
        velocities: Values of all rows, (n, 3) f32, or (n, 0); changed in place.
        merged: Receives True for rows that contain a merged splat, (n,) bool.
        gone: Receives True for rows that were removed, (n,) bool.
    """
    i, j = rows[pairs[p, 0]], rows[pairs[p, 1]]
    if masses[j] > masses[i] or (masses[j] == masses[i] and j < i):
        i, j = j, i
    gone[j] = True
    if masses[j] == 0:  # a point, or an invisible splat
        return
    merged[i] = True
    mass = masses[i] + masses[j]
    part = masses[i] / mass
    xx, xy, xz, yy, yz, zz = joined(i, j, part, positions, covariances)
    for a in range(3):
        positions[i, a] = part * positions[i, a] + (1 - part) * positions[j, a]
    for f in range(sh.shape[1]):
        sh[i, f] = part * sh[i, f] + (1 - part) * sh[j, f]
    for a in range(velocities.shape[1]):
        velocities[i, a] = part * velocities[i, a] + (1 - part) * velocities[j, a]
    opacity = mass / area(xx, xy, xz, yy, yz, zz)
    if opacity > OPAQUE:
        grow = math.sqrt(opacity / OPAQUE)
        xx, xy, xz, yy, yz, zz = (
            grow * xx, grow * xy, grow * xz, grow * yy, grow * yz, grow * zz
        )  # fmt: skip
        opacity = OPAQUE
    covariances[i, 0], covariances[i, 1], covariances[i, 2] = xx, xy, xz
    covariances[i, 3], covariances[i, 4], covariances[i, 5] = yy, yz, zz
    opacities[i] = opacity
    masses[i] = opacity * area(xx, xy, xz, yy, yz, zz)
    volumes[i] = log_volume(xx, xy, xz, yy, yz, zz)
