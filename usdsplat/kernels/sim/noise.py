"""Smooth random fields: gradient noise with its gradient, and curl noise.

Space is divided into unit cubes. Each corner has one of the twelve edge directions, by a hash of
its integer coordinates and a seed. The noise interpolates the linear functions of the corners with
a quintic weight. It is C², 0 at corners and within [-1, 1], and its gradient is exact. Curl noise
is the curl of three such fields; its divergence is 0 except for rounding.

Source: Perlin 2002, "Improving noise"; Bridson, Hourihan & Nordenstam 2007, "Curl-noise for
procedural fluid flow"; the hash is Wellons' lowbias32.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar

CURL_RMS = 1.725
"""Root mean square length of the curl of three noises, over space and seeds."""

_ZERO, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)
_SIX, _TEN, _FIFTEEN, _THIRTY = np.float32(6), np.float32(10), np.float32(15), np.float32(30)
_CURL = np.float32(1 / CURL_RMS)
_U1, _U2, _U3, _U7 = np.uint32(1), np.uint32(2), np.uint32(3), np.uint32(7)
_U15, _U16, _U127 = np.uint32(15), np.uint32(16), np.uint32(127)
_M0, _M1 = np.uint32(0x7FEB352D), np.uint32(0x846CA68B)
_Y, _Z, _NEXT = np.uint32(10), np.uint32(20), np.uint32(0x9E3779B9)


# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def mix32(word):
    """Return a hash of `word` (uint32) in which every bit depends on all bits; one to one."""
    word = np.uint32((word ^ (word >> _U16)) * _M0)
    word = np.uint32((word ^ (word >> _U15)) * _M1)
    return np.uint32(word ^ (word >> _U16))


@scalar
def quintic(t):
    """Return 0 to 1 as t goes from 0 to 1, with first and second derivative 0 at both ends."""
    return t * t * t * (t * (t * _SIX - _FIFTEEN) + _TEN)


@scalar
def _quintic_slope(t):
    return _THIRTY * t * t * (t * (t - _TWO) + _ONE)


@scalar
def cell(x):
    """Return the largest integer up to x (uint32, wrapped) and the remainder (float32)."""
    below = math.floor(x)
    return np.uint32(np.int32(below)), np.float32(x - below)


@scalar
def _corners(ix, iy, iz, seed):
    """Return the hashes of the eight corners of a cell, x fastest."""
    jx, jy = np.uint32(ix + _U1), np.uint32(iy + _U1)
    root = mix32(np.uint32(seed))
    z0 = mix32(np.uint32(root + iz))
    z1 = mix32(np.uint32(root + iz + _U1))
    y00, y10 = mix32(np.uint32(z0 + iy)), mix32(np.uint32(z0 + jy))
    y01, y11 = mix32(np.uint32(z1 + iy)), mix32(np.uint32(z1 + jy))
    return (
        mix32(np.uint32(y00 + ix)),
        mix32(np.uint32(y00 + jx)),
        mix32(np.uint32(y10 + ix)),
        mix32(np.uint32(y10 + jx)),
        mix32(np.uint32(y01 + ix)),
        mix32(np.uint32(y01 + jx)),
        mix32(np.uint32(y11 + ix)),
        mix32(np.uint32(y11 + jx)),
    )


@scalar
def _edge(word, shift):
    """Return one of the directions (0, ±1, ±1), (±1, 0, ±1), (±1, ±1, 0), chosen by ten bits of a
    hash."""
    bits = np.uint32(word >> shift)
    axis = np.uint32((np.uint32(bits >> _U3) & _U127) * _U3) >> _U7
    x = _ONE if bits & _U1 else -_ONE
    y = _ONE if bits & _U2 else -_ONE
    z = _ONE if bits & np.uint32(4) else -_ONE
    return (
        _ZERO if axis == np.uint32(0) else x,
        _ZERO if axis == _U1 else y,
        _ZERO if axis == _U2 else z,
    )


@scalar
def _term(word, shift, x, y, z, wx, wy, wz, sx, sy, sz):
    """Return the contribution of one corner: (x, y, z) is relative to it; weights and slopes per
    axis."""
    gx, gy, gz = _edge(word, shift)
    along = gx * x + gy * y + gz * z
    weight = wx * wy * wz
    return (
        weight * along,
        weight * gx + sx * wy * wz * along,
        weight * gy + wx * sy * wz * along,
        weight * gz + wx * wy * sz * along,
    )


@scalar
def _field(h0, h1, h2, h3, h4, h5, h6, h7, x, y, z, shift):
    """Return value and gradient of the noise with the given `shift`, from the hashes of the
    corners."""
    bx, by, bz = quintic(x), quintic(y), quintic(z)
    ax, ay, az = _ONE - bx, _ONE - by, _ONE - bz
    sx, sy, sz = _quintic_slope(x), _quintic_slope(y), _quintic_slope(z)
    u, v, w = x - _ONE, y - _ONE, z - _ONE
    n0, x0, y0, z0 = _term(h0, shift, x, y, z, ax, ay, az, -sx, -sy, -sz)
    n1, x1, y1, z1 = _term(h1, shift, u, y, z, bx, ay, az, sx, -sy, -sz)
    n2, x2, y2, z2 = _term(h2, shift, x, v, z, ax, by, az, -sx, sy, -sz)
    n3, x3, y3, z3 = _term(h3, shift, u, v, z, bx, by, az, sx, sy, -sz)
    n4, x4, y4, z4 = _term(h4, shift, x, y, w, ax, ay, bz, -sx, -sy, sz)
    n5, x5, y5, z5 = _term(h5, shift, u, y, w, bx, ay, bz, sx, -sy, sz)
    n6, x6, y6, z6 = _term(h6, shift, x, v, w, ax, by, bz, -sx, sy, sz)
    n7, x7, y7, z7 = _term(h7, shift, u, v, w, bx, by, bz, sx, sy, sz)
    return (
        ((n0 + n1) + (n2 + n3)) + ((n4 + n5) + (n6 + n7)),
        ((x0 + x1) + (x2 + x3)) + ((x4 + x5) + (x6 + x7)),
        ((y0 + y1) + (y2 + y3)) + ((y4 + y5) + (y6 + y7)),
        ((z0 + z1) + (z2 + z3)) + ((z4 + z5) + (z6 + z7)),
    )


@scalar
def gradient_noise(x, y, z, seed):
    """Return noise in [-1, 1] and its gradient (d/dx, d/dy, d/dz), all float32.

    (x, y, z): float32, in wavelengths, |x| up to 1e9; seed: 32-bit integer.
    """
    ix, fx = cell(x)
    iy, fy = cell(y)
    iz, fz = cell(z)
    h0, h1, h2, h3, h4, h5, h6, h7 = _corners(ix, iy, iz, seed)
    return _field(h0, h1, h2, h3, h4, h5, h6, h7, fx, fy, fz, np.uint32(0))


@scalar
def curl_in_cell(ix, iy, iz, fx, fy, fz, seed):
    """Return `curl_noise` for the results of `cell` of each coordinate."""
    h0, h1, h2, h3, h4, h5, h6, h7 = _corners(ix, iy, iz, seed)
    _, _, ay, az = _field(h0, h1, h2, h3, h4, h5, h6, h7, fx, fy, fz, np.uint32(0))
    _, bx, _, bz = _field(h0, h1, h2, h3, h4, h5, h6, h7, fx, fy, fz, _Y)
    _, cx, cy, _ = _field(h0, h1, h2, h3, h4, h5, h6, h7, fx, fy, fz, _Z)
    return (cy - bz) * _CURL, (az - cx) * _CURL, (bx - ay) * _CURL


@scalar
def curl_noise(x, y, z, seed):
    """Return curl noise: a vector field without divergence, of root mean square length 1, float32.

    (x, y, z): float32, in wavelengths, |x| up to 1e9; seed: 32-bit integer.
    """
    ix, fx = cell(x)
    iy, fy = cell(y)
    iz, fz = cell(z)
    return curl_in_cell(ix, iy, iz, fx, fy, fz, seed)


@scalar
def change(time, seed):
    """Return (seed, part, seed, part) of the two fields that are mixed at a time.

    The mixture is replaced by another one after each unit of time, and has root mean square 1 at
    all times.

    time: float64, |time| up to 1e9, in periods of change.
    """
    before = math.floor(time)
    w = quintic(np.float32(time - before))
    stretch = _ONE / np.float32(math.sqrt((_ONE - w) * (_ONE - w) + w * w))
    word = np.uint32(np.uint32(seed) + np.uint32(np.uint32(np.int32(before)) * _NEXT))
    return word, (_ONE - w) * stretch, np.uint32(word + _NEXT), w * stretch
