"""Fill a grid with distances from what is known near a surface.

Source: Danielsson 1980, "Euclidean distance mapping": voxels hand on their closest points.
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar, serial


@scalar
def squared_distance(x, y, z, points, k):
    """From (x, y, z) to a row of `points`."""
    u, v, w = x - points[k, 0], y - points[k, 1], z - points[k, 2]
    return u * u + v * v + w * w


@serial(writes=("points", "squared"))
def spread(low, size, counts, points, squared):
    """Hand closest points on from voxel to voxel, until all have one.

    Eight sweeps, one from each corner. What was known stays; what was not is an upper bound, too
    large by a small part of a voxel.

    Args:
        low: Centre of the first voxel [unit], shape (3,) f32; size: of a voxel [unit], f32.
        counts: Voxels along x, y and z.
        points: Closest point of each voxel, x fastest, shape (n, 3) f32; written.
        squared: Distance² from it, inf where it is not known, shape (n,) f32; written.
    """
    nx, ny, nz = counts
    for corner in range(8):
        sx, sy, sz = 1 - 2 * (corner & 1), 1 - (corner & 2), 1 - (corner & 4) // 2
        for c in range(nz):
            k = c if sz > 0 else nz - 1 - c
            z = low[2] + np.float32(k) * size
            for b in range(ny):
                j = b if sy > 0 else ny - 1 - b
                y = low[1] + np.float32(j) * size
                for a in range(nx):
                    i = a if sx > 0 else nx - 1 - a
                    x = low[0] + np.float32(i) * size
                    at = (k * ny + j) * nx + i
                    best, source = squared[at], -1
                    for step in range(1, 8):
                        da, db, dc = step & 1, (step >> 1) & 1, step >> 2
                        if a < da or b < db or c < dc:
                            continue
                        other = at - sx * da - sy * db * nx - sz * dc * nx * ny
                        if squared[other] == np.inf:
                            continue
                        d = squared_distance(x, y, z, points, other)
                        if d < best:
                            best, source = d, other
                    if source >= 0:
                        squared[at] = best
                        for axis in range(3):
                            points[at, axis] = points[source, axis]
