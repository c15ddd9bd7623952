"""Fill a grid with distances, starting from voxels near a surface.

Source: Danielsson 1980, "Euclidean distance mapping": voxels pass on their closest points.
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar, serial


@scalar
def squared_distance(x, y, z, points, k):
    """Return the squared distance from (x, y, z) to a row of `points`."""
    u, v, w = x - points[k, 0], y - points[k, 1], z - points[k, 2]
    return u * u + v * v + w * w


@serial(writes=("points", "squared"))
def spread(low, size, counts, points, squared):
    """Propagate closest points from voxel to voxel, until all voxels have one.

    Makes eight sweeps, one from each corner. Known distances stay. The others are upper bounds, too
    large by a small fraction of a voxel.

    Args:
        low: Centre of the first voxel [unit], shape (3,) f32. size: Edge of a voxel [unit], f32.
        counts: Voxels along x, y and z.
        points: Closest point of each voxel, x fastest, shape (n, 3) f32; changed in place.
        squared: Distance² to it, inf where unknown, shape (n,) f32; changed in place.
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
