"""Counter-based random numbers, which depend on their purpose and not on the order of calls.

Philox4x32-10 makes four 32-bit words from a counter and a key. The counter is (id of a splat, step
of the solver, lane); the key is (seed, stage). Every thread therefore gets the same number for a
splat, and a resumed simulation continues with the same numbers.

Source: Salmon, Moraes, Dror & Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3".
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar

ROUNDS = 10
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint32(0x9E3779B9), np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_UNIT = np.float32(2.0**-24)


@scalar
def philox(c0, c1, c2, c3, k0, k1):
    """Return the four words (uint32) of a counter of four words and a key of two."""
    for _ in range(ROUNDS):
        p0, p1 = _M0 * np.uint64(c0), _M1 * np.uint64(c2)
        h0, h1 = np.uint32(p0 >> _HALF), np.uint32(p1 >> _HALF)
        c0, c1, c2, c3 = (
            np.uint32(h1 ^ c1 ^ k0),
            np.uint32(p1 & _LOW),
            np.uint32(h0 ^ c3 ^ k1),
            np.uint32(p0 & _LOW),
        )
        k0, k1 = np.uint32(k0 + _W0), np.uint32(k1 + _W1)
    return c0, c1, c2, c3


@scalar
def uniforms(seed, stage, identity, step, lane):
    """Return four float32 in [0, 1), multiples of 2^-24.

    seed, stage: integers; `stage` is the purpose, one of the constants below.
    identity: id of the splat; step: step of the solver; lane: index for splats that need more than
    four numbers.
    """
    a, b, c, d = philox(
        np.uint32(np.uint64(identity) & _LOW),
        np.uint32(np.uint64(identity) >> _HALF),
        np.uint32(step),
        np.uint32(lane),
        np.uint32(seed),
        np.uint32(stage),
    )
    return _unit(a), _unit(b), _unit(c), _unit(d)


@scalar
def _unit(word):
    return np.float32(word >> np.uint32(8)) * _UNIT


GRID, SEEDS, CARRIERS, BIRTH, DISSOLVE, IMPULSE, STAGGER, NOISE, ACCRETION = range(9)
"""Purposes of random numbers. Each stage has its own stream."""
