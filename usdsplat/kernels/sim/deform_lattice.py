"""Free-form deformation by a lattice of control points.

The displacement is a polynomial in Bernstein form, converted to powers beforehand. With 16 control
points along an axis, powers of 15 lose seven of float64's sixteen digits. A point outside the
lattice is displaced like the nearest point of the lattice, so that the displacement is continuous.

Source: Sederberg & Parry 1986, "Free-form deformation of solid geometric models".
"""

from __future__ import annotations

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .deform import fade, inside, moved

# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def polynomial(c, component, x, y, z):
    """Return value and gradient of a polynomial of three variables, by Horner's rule.

    c: coefficients of z^k y^j x^i, shape (nz, ny, nx, 3).
    """
    v, vx, vy, vz = 0.0, 0.0, 0.0, 0.0
    for k in range(c.shape[0] - 1, -1, -1):
        b, bx, by = 0.0, 0.0, 0.0
        for j in range(c.shape[1] - 1, -1, -1):
            a, ax = 0.0, 0.0
            for i in range(c.shape[2] - 1, -1, -1):
                ax = ax * x + a
                a = a * x + c[k, j, i, component]
            by = by * y + b
            b, bx = b * y + a, bx * y + ax
        vz = vz * z + v
        v, vx, vy = v * z + b, vx * z + bx, vy * z + by
    return v, vx, vy, vz


@scalar
def kept(x):
    """Return a coordinate clamped to the cube, and the derivative of the clamping."""
    if x < 0.0:
        return 0.0, 0.0
    if x > 1.0:
        return 1.0, 0.0
    return x, 1.0


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="positions", writes=("positions", "gradient"))
def lattice(i, factors, space, weight, reach, mask, positions, gradient):
    """Apply a lattice over the unit cube to all splats; for the other arguments see
    `deform.deform`.

    Args:
        factors: Coefficients of the displacement's powers, shape (nz, ny, nx, 3) f64.
    """
    x, y, z = inside(positions, i, space)
    own = weight * mask[i] if len(mask) > 0 else weight
    w, gx, gy, gz = fade(x, y, z, own, reach)
    if w == 0.0:
        return
    (x, sx), (y, sy), (z, sz) = kept(x), kept(y), kept(z)
    dx, j0, j1, j2 = polynomial(factors, 0, x, y, z)
    dy, j3, j4, j5 = polynomial(factors, 1, x, y, z)
    dz, j6, j7, j8 = polynomial(factors, 2, x, y, z)
    j = (j0 * sx, j1 * sy, j2 * sz, j3 * sx, j4 * sy, j5 * sz, j6 * sx, j7 * sy, j8 * sz)
    moved(positions, gradient, i, space, (dx, dy, dz), j, w, gx, gy, gz)
