"""Lay out splats that cast shadows: what a receiver reads of a caster is one line of memory.

Casters are sorted by the depth from which on they cast shadows. A receiver therefore reads the
casters of its tile up to the first one that is behind it, in the worst of cases, and no more.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel
from .project import HALF_HEIGHT, HALF_WIDTH, LOG_CUTOFF, LOG_OPACITY, A, B, C
from .ray_hit import CENTER, RAY_HIT, REACH, SPREAD

CASTER = 16
"""Floats of a caster, one line of a processor's cache: u v a b c ln(opacity), as in a record; its
ray hit; a depth in front of which it casts no shadow; its appearance, a whole number."""
HIT, NEAREST, LABEL = 6, 14, 15
"""Columns of a caster; those of its ray hit begin at HIT."""
HALF_BOX = 0.5
"""Squared half diagonal of a pixel, by which splats are enlarged for their tile lists [pixel²]."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def nearest_of(hit):
    """Return the depth in front of which a splat casts no shadow on any receiver."""
    found = hit[CENTER] - hit[REACH] + hit[SPREAD]
    return found if found < np.float32(np.inf) else np.float32(np.inf)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="hits", writes=("keys",))
def order_casters(at, hits, keys):
    """Write the key by which splat `at` is sorted. The walk of a list ends with the first caster
    that has a larger key than the receiver."""
    keys[at] = nearest_of(hits[at])


@kernel(over="records", writes=("casters", "out"))
def enlarge(k, records, hits, appearances, casters, out):
    """Write splat `k` as a caster, and its record for the tile lists: enlarged by half a pixel, as
    receivers lie between pixels.

    Args:
        records: Splats in the order of their keys, shape (n, RECORD) f32.
        hits: Their ray hits, shape (n, RAY_HIT) f32.
        appearances: Their appearances, shape (n,) i32.
        casters: Shape (n, CASTER) f32.
        out: Receives the enlarged records, of which only the footprint is used, shape of `records`.
    """
    row = np.uint64(k)  # unsigned indices need no test for negative ones
    for c in range(HIT):
        casters[row, np.uint64(c)] = out[row, np.uint64(c)] = records[row, np.uint64(c)]
    for c in range(RAY_HIT):
        casters[row, np.uint64(HIT + c)] = hits[row, np.uint64(c)]
    casters[k, NEAREST], casters[k, LABEL] = nearest_of(hits[k]), np.float32(appearances[k])
    out[k, HALF_WIDTH], out[k, HALF_HEIGHT] = records[k, HALF_WIDTH], records[k, HALF_HEIGHT]
    reach = np.float64(2) * (records[k, LOG_OPACITY] - LOG_CUTOFF)
    width, height = np.float64(records[k, HALF_WIDTH]), np.float64(records[k, HALF_HEIGHT])
    uu, vv = width * width, height * height
    uv = -np.float64(records[k, B]) / (2.0 * np.float64(records[k, A])) * vv
    # the ellipse of (1 + 1/t) P + (1 + t) Q holds the sum of the ellipses of P and Q for any t
    total = uu + vv
    if not (0.0 < total < np.inf):
        return
    t = math.sqrt(total / (2.0 * HALF_BOX))
    grown = 1.0 + 1.0 / t
    more = (1.0 + t) * HALF_BOX
    uu, vv, uv = grown * uu + more, grown * vv + more, grown * uv
    scale = -0.5 * reach / (uu * vv - uv * uv)
    out[k, A], out[k, B], out[k, C] = vv * scale, -2.0 * uv * scale, uu * scale
    out[k, HALF_WIDTH], out[k, HALF_HEIGHT] = math.sqrt(uu), math.sqrt(vv)
