"""Find the splat of each deep sample, with the kernels that write deep samples.

Those kernels write opacity and colour of each contribution. Here the colour of a splat is replaced
by the digits of its rank. As the colour of a sample is premultiplied, its quotient by the opacity
gives the rank back. Each quotient is off by less than 2**-11, so rounding finds the digit.
"""

from __future__ import annotations

import math

import numpy as np

from .launch import kernel
from .project import RECORD, RED

DIGIT = 11
"""Bits of a digit; three digits hold any rank."""
MASK = (1 << DIGIT) - 1


@kernel(over="records", writes=("out",))
def number(i, records, out):
    """Copy the record of splat `i`, with the digits of its rank in place of its colour.

    Args:
        records: Splats in order of depth, shape (n, RECORD) f32.
        out: Receives the copies, same shape.
    """
    for c in range(RECORD):
        out[i, c] = records[i, c]
    for k in range(3):
        out[i, RED + k] = np.float32((i >> (k * DIGIT)) & MASK)


@kernel(over="color", writes=("ranks",))
def read_ranks(i, color, count, ranks):
    """Find the rank of the splat of sample `i`, drawn with records that `number` has written.

    Args:
        color: Premultiplied digits and opacity of each sample, shape (n, 4) f32.
        count: Number of splats.
        ranks: Receives the ranks, shape (n, 1) i32.
    """
    alpha = color[i, 3]
    rank = np.int64(0)
    if alpha > np.float32(0):
        for k in range(3):
            digit = np.int64(math.floor(color[i, k] / alpha + np.float32(0.5)))
            rank |= min(max(digit, np.int64(0)), np.int64(MASK)) << np.int64(k * DIGIT)
    ranks[i, 0] = np.int32(min(rank, np.int64(count) - 1))
