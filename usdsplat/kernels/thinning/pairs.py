"""Find pairs of splats that one splat can replace, and merge them.

The mass of a splat is what it contributes to a picture: opacity times visible area, averaged over
all view directions. A pair is replaced by the Gaussian with the mean and covariance of both,
weighted by mass, with an opacity that keeps the sum of their masses without what the one hides of
the other. The cost estimates how far pictures may change: the mass that moves to where none was, in
nats (Runnalls 2007), plus the variances of colour and opacity that are lost.
Source: Runnalls 2007, "Kullback-Leibler approach to Gaussian mixture reduction", eq. 16 and 21.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import exact, serial
from usdsplat.kernels.launch import kernel

OPAQUE = 0.999
"""Largest opacity that most formats can store, and pictures draw."""
SOFTNESS = 0.003
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
def solid(opacity):
    """Return the mass per area of a splat with a peak opacity, which may be above 1.

    Pictures then show it with a flat top: the integral of min(1, o exp(-r^2 / 2)) over the plane is
    2 pi (1 + ln o).
    """
    return opacity if opacity <= 1 else 1 + math.log(opacity)


@exact
def peak_of(mass):
    """Return the peak opacity of a splat with a mass per area: the inverse of `solid`."""
    return mass if mass <= 1 else math.exp(mass - 1)


@exact
def overlap(i, j, positions, covariances, masses):
    """Return the mass that two rows hide of each other: the integral of the product of their
    opacities over a picture, averaged over all view directions.

    It is exact for round splats at one place. The squared distance, in units of both sizes, is that
    in the pictures along three axes at right angles, weighted by squared area, which depends on no
    choice of the axes.
    """
    xx, xy = covariances[i, 0] + covariances[j, 0], covariances[i, 1] + covariances[j, 1]
    xz, yy = covariances[i, 2] + covariances[j, 2], covariances[i, 3] + covariances[j, 3]
    yz, zz = covariances[i, 4] + covariances[j, 4], covariances[i, 5] + covariances[j, 5]
    dx = np.float64(positions[i, 0]) - positions[j, 0]
    dy = np.float64(positions[i, 1]) - positions[j, 1]
    dz = np.float64(positions[i, 2]) - positions[j, 2]
    along = xx * dx * dx + yy * dy * dy + zz * dz * dz
    along += 2 * (xy * dx * dy + xz * dx * dz + yz * dy * dz)
    apart = (dx * dx + dy * dy + dz * dz) * (xx + yy + zz) - along
    both = area(xx, xy, xz, yy, yz, zz)
    if not both > 0:
        return 0.0
    return masses[i] * masses[j] / both * math.exp(-apart / (6 * both * both))


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


@exact
def cost(i, j, positions, covariances, masses, volumes, opacities, sh, weights):
    """Return how far pictures may change if two rows become one.

    The exponent of the mass is 3/4: below 1, as large splats are seen from further away.

    Args:
        weights: Cost of a squared difference of harmonics and of opacity of 1 [nat], and a factor
            for the cost, float64.
    """
    mass = masses[i] + masses[j]
    if not (masses[i] > 0 and masses[j] > 0):
        return np.float32(0)
    part = masses[i] / mass
    xx, xy, xz, yy, yz, zz = joined(i, j, part, positions, covariances)
    volume = log_volume(xx, xy, xz, yy, yz, zz)
    nats = volume - part * volumes[i] - (1 - part) * volumes[j]
    red, green, blue = np.float32(0), np.float32(0), np.float32(0)
    for f in range(0, sh.shape[1], 3):
        r, g, b = sh[i, f] - sh[j, f], sh[i, f + 1] - sh[j, f + 1], sh[i, f + 2] - sh[j, f + 2]
        red, green, blue = red + r * r, green + g * g, blue + b * b
    opacity = np.float64(opacities[i]) - opacities[j]
    lost = weights[0] * (np.float64(red) + green + blue) + weights[1] * opacity * opacity
    root = math.sqrt(mass)
    seen = weights[2] * root * math.sqrt(root)
    return np.float32(max(seen * (nats + part * (1 - part) * lost), 0.0))


@exact
def listed(near, i, count, t):
    """Return whether a row is among the first `count` candidates of another."""
    there = False
    for c in range(count):
        there |= near[i, c] == t
    return there


@exact
def cheapest_first(near, costs, i):
    """Exchange the first candidate of a row with the cheapest; of several, that with the lowest
    row."""
    best = 0
    for c in range(1, near.shape[1]):
        if near[i, c] >= 0 and (
            costs[i, c] < costs[i, best]
            or (costs[i, c] == costs[i, best] and near[i, c] < near[i, best])
        ):
            best = c
    near[i, 0], near[i, best] = near[i, best], near[i, 0]
    costs[i, 0], costs[i, best] = costs[i, best], costs[i, 0]


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="scales", writes=("covariances", "masses", "volumes"))
def weigh(i, scales, rotations, opacities, blur, covariances, masses, volumes):
    """Compute the values by which pairs are compared.

    Args:
        scales, rotations, opacities: Arrays of a cloud.
        blur: Added to the variances of all splats [unit^2], float64.
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
        s0 * s0 + blur, s1 * s1 + blur, s2 * s2 + blur,
    )  # fmt: skip
    covariances[i, 0], covariances[i, 1], covariances[i, 2] = xx, xy, xz
    covariances[i, 3], covariances[i, 4], covariances[i, 5] = yy, yz, zz
    masses[i] = solid(np.float64(opacities[i])) * area(xx, xy, xz, yy, yz, zz)
    volumes[i] = log_volume(xx, xy, xz, yy, yz, zz)


@kernel(over="rows", writes=("near", "costs"))
def compare(
    s, rows, found, positions, covariances, masses, volumes, opacities, sh, weights, near, costs
):
    """Set the candidates of each remaining row, the cheapest first.

    Args:
        rows: Remaining rows, (m,) i32.
        found: Candidates of each, as entries of `rows`, (m, c) i32, c <= k + 1; -1 is none, and the
            row itself is left out.
        positions, covariances, masses, volumes, opacities: Values of all rows.
        sh: Harmonics of all rows, (n, 3 coefficients) f32.
        weights: See `cost`, (3,) f64.
        near: Receives the candidates of the remaining rows, which are rows, (n, k) i32; -1 is none.
        costs: Receives the costs of these pairs, (n, k) f32; inf where there is none.
    """
    i = rows[s]
    count = 0
    for c in range(found.shape[1]):
        t = found[s, c]
        if t < 0 or t == s or count == near.shape[1]:
            continue
        j = rows[t]
        near[i, count] = j
        costs[i, count] = cost(
            i, j, positions, covariances, masses, volumes, opacities, sh, weights
        )
        count += 1
    for c in range(count, near.shape[1]):
        near[i, c], costs[i, c] = -1, np.inf
    cheapest_first(near, costs, i)


@kernel(over="rows", writes=("near", "costs"))
def follow(
    s, rows, heirs, mates, positions, covariances, masses, volumes, opacities, sh, weights, near,
    costs,
):  # fmt: skip
    """Update the candidates of each remaining row after merges: a merged splat has those of both,
    the cheapest k of them.

    Args:
        rows: Remaining rows, (m,) i32.
        heirs, mates: From `merge`.
        positions, covariances, masses, volumes, opacities, sh, weights: See `compare`.
        near, costs: Candidates of all rows and their costs, see `compare`; changed in place for the
            remaining rows. Those of rows that are gone are only read.
    """
    i = rows[s]
    mate = mates[i]
    count, k = 0, near.shape[1]
    for c in range(k):
        t = near[i, c]
        if t < 0:
            continue
        if heirs[t] >= 0:
            t = heirs[t]
        if t == i or listed(near, i, count, t):
            continue
        if mate >= 0 or mates[t] >= 0:
            costs[i, count] = cost(
                i, t, positions, covariances, masses, volumes, opacities, sh, weights
            )
        else:
            costs[i, count] = costs[i, c]
        near[i, count] = t
        count += 1
    for c in range(count, k):
        near[i, c], costs[i, c] = -1, np.inf
    if mate >= 0:
        for c in range(k):
            t = near[mate, c]
            if t < 0:
                continue
            if heirs[t] >= 0:
                t = heirs[t]
            if t == i or listed(near, i, count, t):
                continue
            price = cost(i, t, positions, covariances, masses, volumes, opacities, sh, weights)
            slot = count
            if count < k:
                count += 1
            else:
                slot = 0
                for other in range(1, k):
                    if costs[i, other] > costs[i, slot]:
                        slot = other
                if not price < costs[i, slot]:
                    continue
            near[i, slot], costs[i, slot] = t, price
    cheapest_first(near, costs, i)


@serial(writes=("taken", "pairs"))
def match(order, near, most, taken, pairs):
    """Select pairs in order, none of which shares a splat with an earlier one.

    Args:
        order: Rows, (m,) i32.
        near: Candidates of all rows, of which the first is the partner, (n, k) i32; -1 is none.
        most: Largest number of pairs.
        taken: Initially False; receives whether a row is in a selected pair, (n,) bool.
        pairs: Receives the rows of the selected pairs, (most, 2) i32.

    Returns:
        Number of selected pairs.
    """
    found = 0
    for i in order:
        t = near[i, 0]
        if found == most:
            break
        if t >= 0 and not taken[i] and not taken[t]:
            taken[i] = taken[t] = True
            pairs[found, 0], pairs[found, 1] = i, t
            found += 1
    return found


@kernel(
    over="pairs",
    writes=(
        "positions", "covariances", "masses", "volumes", "opacities", "sh", "velocities", "merged",
        "heirs", "mates",
    ),
)  # fmt: skip
def merge(
    p, pairs, peak, growth, positions, covariances, masses, volumes, opacities, sh, velocities,
    merged, heirs, mates,
):  # fmt: skip
    """Write each merged pair to the row of its heavier splat, or to the lower row if they are
    equally heavy.

    Args:
        pairs: Rows, (p, 2) i32, each at most once.
        peak: Largest opacity of a merged splat, float64.
        growth: Part, by its logarithm, of the mass in excess of this opacity that makes the splat
            larger, float64. The other part is assumed to be hidden behind it.
        positions, covariances, masses, volumes, opacities, sh: Values of all rows; changed in
            place.
        velocities: Values of all rows, (n, 3) f32, or (n, 0); changed in place.
        merged: Receives True for rows that contain a merged splat, (n,) bool.
        heirs: Receives the other row of the pair for rows that are gone, (n,) i32.
        mates: Receives the row that is gone for rows that stay, (n,) i32.
    """
    i, j = pairs[p, 0], pairs[p, 1]
    if masses[j] > masses[i] or (masses[j] == masses[i] and j < i):
        i, j = j, i
    heirs[j], mates[i] = i, j
    if masses[j] == 0:  # a point, or an invisible splat
        return
    merged[i] = True
    mass = masses[i] + masses[j]
    part = masses[i] / mass
    shown = mass - overlap(i, j, positions, covariances, masses)
    xx, xy, xz, yy, yz, zz = joined(i, j, part, positions, covariances)
    for a in range(3):
        positions[i, a] = part * positions[i, a] + (1 - part) * positions[j, a]
    for f in range(sh.shape[1]):
        sh[i, f] = part * sh[i, f] + (1 - part) * sh[j, f]
    for a in range(velocities.shape[1]):
        velocities[i, a] = part * velocities[i, a] + (1 - part) * velocities[j, a]
    dense, most = shown / area(xx, xy, xz, yy, yz, zz), solid(peak)
    if dense > most:
        grow = (dense / most) ** growth
        xx, xy, xz, yy, yz, zz = (
            grow * xx, grow * xy, grow * xz, grow * yy, grow * yz, grow * zz
        )  # fmt: skip
        dense = most
    covariances[i, 0], covariances[i, 1], covariances[i, 2] = xx, xy, xz
    covariances[i, 3], covariances[i, 4], covariances[i, 5] = yy, yz, zz
    opacities[i] = min(peak_of(dense), peak)
    masses[i] = dense * area(xx, xy, xz, yy, yz, zz)
    volumes[i] = log_volume(xx, xy, xz, yy, yz, zz)
