"""Decode packed splats: 16 bytes per splat, and one byte per harmonic.

The layout is `smallestThree47_log16_v1`, which `schema.packing` describes and writes.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .radiance import C0

ROTATION_MIDDLE = np.float32(16383)
ROTATION_STEP = np.float32(1 / (16383 * math.sqrt(2)))
OPACITY_STEP = np.float32(1 / 511)
STEP = np.float32(1 / 1024)


@scalar
def unpack_scale(code):
    """Return the standard deviation of a 16-bit code [scene unit]."""
    number = np.int32(code)  # shifts widen to 64 bits, which are slow to convert on a GPU
    power = np.float32(math.exp2(np.float32(number) * STEP - np.float32(32)))
    return np.float32(0) if number == np.int32(0) else power


@scalar
def unpack_shape(words, rotation, scales):
    """Write a splat's unit quaternion (w, x, y, z) and standard deviations. Return its opacity.

    Args:
        words: The four integers of a splat, i32.
        rotation, scales: Receive 4 and 3 f32.
    """
    x, y, z, w = np.uint32(words[0]), np.uint32(words[1]), np.uint32(words[2]), np.uint32(words[3])
    low16, low15 = np.uint32(0xFFFF), np.uint32(0x7FFF)
    scales[0] = unpack_scale(x & low16)
    scales[1] = unpack_scale(x >> np.uint32(16))
    scales[2] = unpack_scale(y & low16)
    a = (np.float32(np.int32(y >> np.uint32(16) & low15)) - ROTATION_MIDDLE) * ROTATION_STEP
    b = (np.float32(np.int32(z & low15)) - ROTATION_MIDDLE) * ROTATION_STEP
    c = (np.float32(np.int32(z >> np.uint32(15) & low15)) - ROTATION_MIDDLE) * ROTATION_STEP
    left = np.float32(math.sqrt(max(np.float32(0), np.float32(1) - a * a - b * b - c * c)))
    largest = np.int32(z >> np.uint32(30))
    rotation[0] = left if largest == 0 else a
    rotation[1] = left if largest == 1 else (a if largest == 0 else b)
    rotation[2] = left if largest == 2 else (c if largest == 3 else b)
    rotation[3] = left if largest == 3 else c
    opacity = np.int32((w >> np.uint32(24) << np.uint32(1)) | (y >> np.uint32(31)))
    return np.float32(opacity) * OPACITY_STEP


@scalar
def unpack_colors(words, ranges, out):
    """Write a splat's coefficients of degree 0 for red, green and blue.

    Args:
        words: The four integers of a splat, i32.
        ranges: Lowest red, green and blue, then highest, f32.
        out: Receives 3 f32.
    """
    w = np.uint32(words[3])
    for c in range(3):
        code = np.float32(np.int32(w >> np.uint32(8 * c) & np.uint32(0xFF)))
        low, high = ranges[c], ranges[3 + c]
        out[c] = (low + (high - low) * (code * np.float32(1 / 255)) - np.float32(0.5)) / C0


@scalar
def unpack_harmonic(words, index, steps, degree):
    """Return one coefficient above degree 0.

    Args:
        words: A splat's harmonics, four codes in each integer, i32.
        index: Index of the code: 3 (coefficient - 1) + channel.
        steps: Step of the codes of each degree from 1 on, f32.
        degree: Degree of the coefficient.
    """
    word = np.uint32(words[index // 4])
    byte = np.int32(word >> np.uint32(8 * (index % 4)) & np.uint32(0xFF))
    signed = byte - np.int32(256) if byte > np.int32(127) else byte
    return np.float32(signed) * steps[degree - 1]
