"""Masks: values of points in space, their remapping, and their combination.

Each kernel computes one number for each point. Positions are transformed to the mask's space in
float64, values are float32.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .dissolve import NOISE_DEVIATION
from .drivers import LINEAR, remapped
from .noise import change, gradient_noise

PLANAR, SPHERICAL, CAMERA = range(3)
"""Projections of a texture."""
BLACK, CLAMP, REPEAT = range(3)
"""Values outside of a texture: 0, its nearest edge, its repetition."""
MULTIPLY, MAX, MIN, ADD, SUBTRACT = range(5)
"""Combinations of two masks."""

_ZERO, _ONE, _TWO, _THREE = (np.float32(each) for each in range(4))
_LEAST = np.float32(1e-6)
_SQUASH = 1 / (NOISE_DEVIATION * math.sqrt(2))


# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def along(matrix, row, x, y, z):
    """Return one coordinate of a transformed point, float64; matrix has four columns."""
    return matrix[row, 0] * x + matrix[row, 1] * y + matrix[row, 2] * z + matrix[row, 3]


@scalar
def faded(distance, radius, falloff):
    """Return 1 up to a radius and 0 beyond the falloff around it, with a smooth step between."""
    beyond = distance - radius
    if falloff <= _ZERO:
        return _ONE if beyond <= _ZERO else _ZERO
    t = min(_ONE, max(_ZERO, beyond / falloff))
    return _ONE - t * t * (_THREE - _TWO * t)


@scalar
def wrapped(k, count, wrap):
    """Return the row of a pixel whose row may lie outside of 0..count-1; -1 for none."""
    if wrap == REPEAT:
        return k % count
    if wrap == CLAMP:
        return min(max(k, 0), count - 1)
    return k if 0 <= k < count else -1


@scalar
def pixel(pixels, row, column, wrap):
    """Return a pixel of a picture, 0 where there is none."""
    j, i = wrapped(row, pixels.shape[0], wrap), wrapped(column, pixels.shape[1], wrap)
    return pixels[j, i] if j >= 0 and i >= 0 else _ZERO


# --- 2. loops --------------------------------------------------------------------------


@kernel(over="points", writes=("out",))
def measure(i, points, matrix, row, out):
    """Compute one coordinate of each point: points (n, 3) f32, matrix (3, 4) f64, out (n,) f32."""
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    out[i] = np.float32(along(matrix, row, x, y, z))


@kernel(over="points", writes=("out",))
def noise(i, points, matrix, time, seed, out):
    """Compute noise, evenly distributed over 0 to 1 through the normal distribution, which it
    nearly has.

    Args:
        points: (n, 3) f32. matrix: To patches of size 1, (3, 4) f64.
        time: In periods of its change, f64. seed: u32.
        out: (n,) f32, receives values.
    """
    first, part, second, other = change(time, seed)
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    px, py, pz = along(matrix, 0, x, y, z), along(matrix, 1, x, y, z), along(matrix, 2, x, y, z)
    value = part * gradient_noise(px, py, pz, first)[0]
    if other != _ZERO:
        value += other * gradient_noise(px, py, pz, second)[0]
    out[i] = np.float32(0.5 + 0.5 * math.erf(value * _SQUASH))


@kernel(over="points", writes=("out",))
def project(i, points, matrix, projection, pixels, wrap, out):
    """Read a picture at the projections of points, interpolating between its pixels.

    Args:
        points: (n, 3) f32.
        matrix: To the frame, or to the clip space of a camera, (4, 4) f64.
        projection: PLANAR: x and y from -0.5 to 0.5 are the picture; SPHERICAL: longitude about y,
            0 along -z in the middle of the picture, and latitude; CAMERA: x / w and y / w from -1
            to 1, and nothing behind it.
        pixels: The top row first, (h, w) f32.
        wrap: BLACK, CLAMP or REPEAT.
        out: (n,) f32, receives values.
    """
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    px, py, pz = along(matrix, 0, x, y, z), along(matrix, 1, x, y, z), along(matrix, 2, x, y, z)
    if projection == CAMERA:
        depth = along(matrix, 3, x, y, z)
        if not depth > 0.0:
            out[i] = _ZERO
            return
        u, v = 0.5 + 0.5 * px / depth, 0.5 + 0.5 * py / depth
    elif projection == SPHERICAL:
        length = math.sqrt(px * px + py * py + pz * pz)
        u = 0.5 + math.atan2(px, -pz) / (2.0 * math.pi)
        v = 0.5 + (math.asin(min(max(py / length, -1.0), 1.0)) / math.pi if length > 0.0 else 0.0)
    else:
        u, v = px + 0.5, py + 0.5
    column = u * pixels.shape[1] - 0.5
    row = (1.0 - v) * pixels.shape[0] - 0.5
    if not (abs(column) < 1e9 and abs(row) < 1e9):
        out[i] = _ZERO
        return
    if wrap == BLACK and not (0.0 <= u <= 1.0 and 0.0 <= v <= 1.0):
        out[i] = _ZERO
        return
    inside = CLAMP if wrap == BLACK else wrap  # a picture does not fade to black within its edge
    j, k = np.int64(math.floor(row)), np.int64(math.floor(column))
    s, t = np.float32(row - j), np.float32(column - k)
    upper = pixel(pixels, j, k, inside) * (_ONE - t) + pixel(pixels, j, k + 1, inside) * t
    lower = pixel(pixels, j + 1, k, inside) * (_ONE - t) + pixel(pixels, j + 1, k + 1, inside) * t
    out[i] = upper * (_ONE - s) + lower * s


@kernel(over="points", writes=("out",))
def distance(i, points, matrix, voxels, size, out):
    """Read a level set at points, interpolating between its voxels. Beyond the grid it is the
    distance to the surface point that the nearest point of the grid sees along its gradient.

    Args:
        points: (n, 3) f32.
        matrix: To the grid's voxels, (3, 4) f64.
        voxels: Signed distances [voxel], (nz, ny, nx) f32, at least 2 along each axis.
        size: Edge of a voxel [unit], f32.
        out: (n,) f32, receives distances [unit].
    """
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    px, py, pz = along(matrix, 0, x, y, z), along(matrix, 1, x, y, z), along(matrix, 2, x, y, z)
    x = min(max(px, 0.0), voxels.shape[2] - 1.0)
    y = min(max(py, 0.0), voxels.shape[1] - 1.0)
    z = min(max(pz, 0.0), voxels.shape[0] - 1.0)
    a = min(np.int64(x), voxels.shape[2] - 2)
    b = min(np.int64(y), voxels.shape[1] - 2)
    c = min(np.int64(z), voxels.shape[0] - 2)
    r, s, t = np.float32(x - a), np.float32(y - b), np.float32(z - c)
    value = gx = gy = gz = _ZERO
    for k in range(2):
        p, q = voxels[c + k, b, a], voxels[c + k, b, a + 1]
        u, v = voxels[c + k, b + 1, a], voxels[c + k, b + 1, a + 1]
        low, high = p + (q - p) * r, u + (v - u) * r
        part = t if k else _ONE - t
        value += (low + (high - low) * s) * part
        gx += ((q - p) * (_ONE - s) + (v - u) * s) * part
        gy += (high - low) * part
        gz += (low + (high - low) * s) * (_ONE if k else -_ONE)
    if x != px or y != py or z != pz:
        square = max(gx * gx + gy * gy + gz * gz, _LEAST)
        dx = px - x + value * gx / square
        dy = py - y + value * gy / square
        dz = pz - z + value * gz / square
        value = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
    out[i] = value * size


@kernel(over="values", writes=("values",))
def fade(i, radius, falloff, values):
    """Replace distances by weights: see `faded`. radius, falloff: f32. values: (n,) f32."""
    values[i] = faded(values[i], radius, falloff)


@kernel(over="values", writes=("values",))
def remap(i, low, high, ease, clamp, first, last, values):
    """Replace values by first + (last - first) times their place between `low` and `high`.

    low, high, ease: See `remapped`. clamp: Whether places end at 0 and 1; else a linear ramp goes
    on. first, last: Results at both ends. All f32. values: (n,) f32.
    """
    if clamp or ease != LINEAR or high == low:
        part = remapped(values[i], low, high, ease)
    else:
        part = (values[i] - low) / (high - low)
    values[i] = first * (_ONE - part) + last * part


@kernel(over="values", writes=("values",))
def combine(i, operation, other, values):
    """Combine values with others, in place. other, values: (n,) f32."""
    a, b = values[i], other[i]
    if operation == MULTIPLY:
        a *= b
    elif operation == MAX:
        a = max(a, b)
    elif operation == MIN:
        a = min(a, b)
    elif operation == ADD:
        a += b
    else:
        a -= b
    values[i] = a
