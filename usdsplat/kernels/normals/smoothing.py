"""Averages of normals over neighbours of like colour, which keep edges.

Source: Tomasi & Manduchi 1998, "Bilateral filtering for gray and color images"; Jones et al. 2004,
"Normal improvement for point rendering".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.openness import BEST, VIEW

OPENNESS = 6.0
"""Weight of the open direction of a splat in a volume, relative to the normal of one on a sheet."""
LIKE = 0.15
"""Least difference of colours that counts as one."""
SOFT, HARD = 0.6, 0.95
"""Flatness from which a splat begins to listen only to neighbours that agree with it, and from
which it does so fully. Below, splats are in fuzzy matter and average all around."""
AGREEING = 12.0
"""How fast the weight of a flat splat's neighbour falls with 1 - cosine: to a half at 19
degrees."""
ANCHOR = 1.0
"""Weight of the open direction of a splat in a volume, relative to its neighbours."""
RING = 8
"""Number of the farthest neighbours of a neighbour from which a splat in fuzzy matter takes one
more normal, so that it averages twice as far."""


# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def fall(x):
    """Return approximately exp(-x), which is 0 from 6 on."""
    t = max(1.0 - x * (1 / 6), 0.0)
    t *= t * t
    return t * t


@scalar
def color_difference(colors, i, j):
    """Return the squared difference of two colours."""
    r, g, b = (
        colors[i, 0] - colors[j, 0],
        colors[i, 1] - colors[j, 1],
        colors[i, 2] - colors[j, 2],
    )
    return np.float64(r * r + g * g + b * b)


@scalar
def dot(a, i, b, j):
    """Return the scalar product of rows of two arrays."""
    return (
        np.float64(a[i, 0]) * b[j, 0]
        + np.float64(a[i, 1]) * b[j, 1]
        + np.float64(a[i, 2]) * b[j, 2]
    )


@scalar
def rigor(flatness):
    """Return how strictly a splat chooses its neighbours, 0 to 1."""
    t = min(max((flatness - SOFT) / (HARD - SOFT), 0.0), 1.0)
    return t * t * (3 - 2 * t)


@scalar
def set_unit(out, i, x, y, z, other):
    """Set a row to (x, y, z) with length 1, or to a row of `other` if the length is 0."""
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0:
        scale = 1.0 / length
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, z * scale
    else:
        out[i, 0], out[i, 1], out[i, 2] = other[i, 0], other[i, 1], other[i, 2]
    return length


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="axes", writes=("views", "contrast", "out"))
def begin(i, axes, flatness, neighbors, colors, sampled, stride, views, contrast, out):
    """Compute the first normals, and what the averages depend on.

    Args:
        axes, flatness: Results of `planes.planes`.
        neighbors: See `planes.planes`.
        colors: (n, 3) f32.
        sampled, stride: Result of `openness.look_around`.
        views: Receives the mean of the neighbours' rows of `sampled`, or the nearest one on the
            curve, (n, VIEW) f32.
        contrast: Receives the mean squared difference of the neighbours' colours, (n,) f32.
        out: Receives unit vectors of any sign, (n, 3) f32: the axis on a sheet, the open direction
            in a volume.
    """
    for c in range(VIEW):
        views[i, c] = 0
    total, count, samples = 0.0, 0, 0
    for e in range(neighbors.shape[1]):
        j = neighbors[i, e]
        if j < 0:
            continue
        total += color_difference(colors, i, j)
        count += 1
        if j % stride == 0:
            for c in range(VIEW):
                views[i, c] += sampled[j // stride, c]
            samples += 1
    for c in range(VIEW):
        if samples > 0:
            views[i, c] /= samples
        else:
            views[i, c] = sampled[i // stride, c]
    x, y, z = views[i, BEST], views[i, BEST + 1], views[i, BEST + 2]
    contrast[i] = max(total / max(count, 1), LIKE * LIKE)
    flat = np.float64(flatness[i])
    sheet = flat * flat
    if x * axes[i, 0] + y * axes[i, 1] + z * axes[i, 2] < 0:
        sheet = -sheet
    volume = OPENNESS * (1 - flat) * (1 - flat)
    set_unit(
        out, i, sheet * axes[i, 0] + volume * x, sheet * axes[i, 1] + volume * y,
        sheet * axes[i, 2] + volume * z, axes,
    )  # fmt: skip


@kernel(over="normals", writes=("out",))
def align(i, normals, flatness, neighbors, colors, contrast, out):
    """Average normals of unknown sign: each neighbour counts with the sign that agrees.

    Args:
        normals: Unit vectors, (n, 3) f32.
        flatness, neighbors, colors, contrast: See `begin`.
        out: Receives unit vectors, (n, 3) f32.
    """
    inverse = 0.5 / contrast[i]
    x, y, z = 0.0, 0.0, 0.0
    for e in range(neighbors.shape[1]):
        j = neighbors[i, e]
        if j < 0:
            continue
        cosine = dot(normals, i, normals, j)
        weight = fall(color_difference(colors, i, j) * inverse) * (flatness[j] + 0.02)
        weight *= cosine * abs(cosine) * cosine * cosine
        x, y, z = x + weight * normals[j, 0], y + weight * normals[j, 1], z + weight * normals[j, 2]
    set_unit(out, i, x, y, z, normals)


@kernel(over="normals", writes=("out", "agreement"))
def smooth(
    i, normals, flatness, views, neighbors, colors, contrast, turn, out, agreement
):  # fmt: skip
    """Average oriented normals.

    On a sheet only neighbours that agree count, and flat ones most, so that edges stay. In fuzzy
    matter all count, and neighbours of neighbours too.

    Args:
        normals: Unit vectors, (n, 3) f32.
        flatness, views, neighbors, colors, contrast: See `begin`.
        turn: Number of the pass, which selects the neighbours of neighbours.
        out: Receives unit vectors, (n, 3) f32.
        agreement: Receives the length of the mean normal, 0 to 1, (n,) f32.
    """
    strict = rigor(np.float64(flatness[i]))
    sharp = AGREEING * strict
    inverse = 0.5 / contrast[i]
    last = neighbors.shape[1] - 1
    x, y, z, total = 0.0, 0.0, 0.0, 0.0
    for e in range(neighbors.shape[1]):
        j = neighbors[i, e]
        if j < 0:
            continue
        for hop in range(2):
            share = 1.0
            if hop == 1:
                share = 1.0 - strict
                j = neighbors[j, last - (e + turn) % min(RING, last)] if share > 0 else -1
                if j < 0:
                    continue
            flat = np.float64(flatness[j])
            trust = flat * flat * flat
            weight = share * fall(color_difference(colors, i, j) * inverse)
            weight *= 1.0 - strict + strict * trust * trust
            total += weight
            cosine = dot(normals, i, normals, j)
            weight *= max(0.5 + 0.5 * cosine, 0.0) * fall(sharp * (1.0 - cosine))
            x += weight * normals[j, 0]
            y += weight * normals[j, 1]
            z += weight * normals[j, 2]
    loose = 1.0 - np.float64(flatness[i])
    anchor = ANCHOR * loose * loose * total
    x += anchor * views[i, BEST]
    y += anchor * views[i, BEST + 1]
    z += anchor * views[i, BEST + 2]
    total += anchor
    length = set_unit(out, i, x, y, z, normals)
    agreement[i] = length / total if total > 0 else 0.0
