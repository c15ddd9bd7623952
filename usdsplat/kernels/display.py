"""Change how projected splats are drawn: as dots, or as ellipses with a rim.

Both have hard edges, although blending supports Gaussians only. An exponent of S - (S + ln 2) r²
gives a contribution of one half at r = 1. Inside it exceeds the largest contribution and is clamped
to a constant; outside it soon vanishes. S grows with the size on the screen, so that edges are
about a pixel wide.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel
from .project import (
    BLUE,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_CUTOFF,
    LOG_OPACITY,
    RED,
    A,
    B,
    C,
)
from .ray_hit import CENTER, RAY_HIT

LOG_2 = np.float32(math.log(2.0))
EDGE = np.float32(1.5)
"""Slope of a contribution at an edge across the shorter axis [1 / pixel]."""
SOFT, HARD = np.float32(2.0), np.float32(60.0)
"""Limits of S: the lower is for splats too small to have an edge, the upper for float32
precision."""
FAINTEST = np.float32(0.2)
"""Contribution at the edge of an ellipse. A splat that never reaches it is not drawn."""
RIM, DARK = np.float32(0.84), np.float32(0.3)
"""Inner radius of the rim as a fraction of the ellipse, and factor on the colour of the rim."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def outline(record, a, b, c, half_width, half_height):
    """Make a record cover the interior of the ellipse a x² + b x y + c y² = -1, of these half
    extents [pixel]."""
    one, half = np.float32(1), np.float32(0.5)
    shorter = one / math.sqrt(half * (math.sqrt((a - c) * (a - c) + b * b) - a - c))
    s = min(HARD, max(SOFT, EDGE * shorter - LOG_2))
    steep = s + LOG_2
    beyond = np.float32(math.sqrt((s - LOG_CUTOFF) / steep))
    record[A], record[B], record[C], record[LOG_OPACITY] = a * steep, b * steep, c * steep, s
    record[HALF_WIDTH], record[HALF_HEIGHT] = half_width * beyond, half_height * beyond


@scalar
def ellipse(record, source, part):
    """Make a record cover the ellipse on which `source` contributes FAINTEST, scaled by `part`."""
    opacity = source[LOG_OPACITY]
    level = (opacity - np.float32(math.log(FAINTEST))) * part * part
    grow = np.float32(math.sqrt(level / (opacity - LOG_CUTOFF)))
    outline(
        record, source[A] / level, source[B] / level, source[C] / level,
        source[HALF_WIDTH] * grow, source[HALF_HEIGHT] * grow,
    )  # fmt: skip


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="records", writes=("records", "ray_hits"))
def dots(k, records, ray_hits, radius):
    """Make every splat a round dot at the depth of its centre.

    Args:
        records: Shape (n, RECORD) f32.
        ray_hits: Shape (n, RAY_HIT) f32, or empty.
        radius: Radius of the dots [pixel].
    """
    a = np.float32(-1) / (radius * radius)
    outline(records[k], a, np.float32(0), a, radius, radius)
    if ray_hits.shape[0] > 0:
        for i in range(RAY_HIT):
            if i != CENTER:
                ray_hits[k, i] = np.float32(0)


@kernel(over="records", writes=("out",))
def opaque(k, records, out):
    """Set out[k] to whether splat k is more opaque than FAINTEST, u8."""
    out[k] = records[k, LOG_OPACITY] > np.float32(math.log(FAINTEST))


@kernel(over="records", writes=("records",))
def rings(k, records):
    """Convert every splat, which is stored twice in succession, to an ellipse and its rim behind
    it.

    Args:
        records: Shape (2 n, RECORD) f32, all of them more opaque than FAINTEST.
    """
    if k % 2 == 1:
        return
    inner, outer = records[k], records[k + 1]
    ellipse(outer, inner, np.float32(1))
    ellipse(inner, inner, RIM)
    for i in range(RED, BLUE + 1):
        outer[i] *= DARK


@kernel(over="records", writes=("records",))
def directions(k, records, normals, column):
    """Colour every splat by its normal n: 0.5 n + 0.5.

    Args:
        records: Shape (n, RECORD) f32.
        normals: Normals in three columns from `column` on, f32.
    """
    for i in range(3):
        half = np.float32(0.5)
        records[k, RED + i] = half * normals[k, column + i] + half
