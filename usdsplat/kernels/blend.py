"""Blend each tile's list front to back: colour and coverage.

A tile's state is one array of 16 rows of 64 floats: transmittance, red, green and blue, 16 pixels
each. Side by side in one array the four provably do not alias, and the loop over 16 pixels becomes
a few vector instructions. A pixel that has ended keeps its transmittance with the sign turned: it
neither changes again nor decays into denormals. (Half rows were tried: 14 % fewer pixels, but loops
of 8 were not vectorised, and it took three times as long.)

Where surfaces are, each splat is compared with them pixel by pixel, at the depth where it peaks
along the pixel's own ray; what lies behind is skipped, and the pixel goes on, because a list in the
order of centres is not in the order of those depths.

What is blended is colour, or any other three numbers of a splat: its paint.

Source: Kerbl et al. 2023, "3D Gaussian Splatting", for the compositing rules.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .bins import SLACK, TILE, span
from .jit import parallel, scalar
from .peak import CENTER, GX, GY, HX, HY, HZ, REACH, peak_at, row_at
from .project import HALF_HEIGHT, LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V

CHANNELS = 4
ROW = CHANNELS * TILE
"""Floats of one row of a tile's state."""
LOOK = 32
"""Splats between two looks at which rows of a tile are saturated."""

END = np.float32(1e-4)
"""A pixel ends before the splat that would take its transmittance under this."""
SQUARINGS = 3
SHRINK = np.float32(1.0 / (1 << SQUARINGS))
"""Exponents are divided by 8, where a short polynomial is exact enough, and powers squared back."""
LEAST = LOG_CUTOFF * SHRINK
"""The shrunk exponent under which a contribution does not count."""
MOST = np.float32(math.log(0.999)) * SHRINK
"""The shrunk exponent of the largest contribution of one splat at one pixel."""


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def exponential(z):
    """e**(8 z) for z in [LEAST, 0], 2e-6 relative.

    Unlike math.exp it is vectorised without a vector mathematics library. Below that range it is
    wrong but never NaN. Coefficients: least relative maximum of a polynomial of degree 5 that is 1
    at 0.
    """
    w = np.float32(0.0398810700) + z * np.float32(0.00590597)
    w = np.float32(0.4999036) + z * (np.float32(0.1660462) + z * w)
    w = np.float32(1) + z * (np.float32(0.999995) + z * w)
    w = w * w
    w = w * w
    return w * w


@scalar
def alpha_at(dx, a, slope, rest):
    """Contribution of a splat at offset dx along a row, 0 where it is under 1/255.

    a dx² + slope dx + rest is the shrunk exponent, the logarithm of opacity included.
    """
    e = (a * dx + slope) * dx + rest
    e = e if e < MOST else MOST
    alpha = exponential(e)
    return alpha if e >= LEAST else np.float32(0)


@scalar
def blend_row(state, row, u, a, slope, rest, r, g, b):
    """Blend one splat into row `row` of a tile's state; u is its centre relative to the tile."""
    at = np.uint64(row * ROW)
    for x in range(TILE):
        j = at + np.uint64(x)
        alpha = alpha_at(np.float32(x) - u, a, slope, rest)
        t = state[j]
        weight = alpha * t
        left = t - weight
        goes_on = left >= END
        weight = weight if goes_on else np.float32(0)
        state[j] = left if goes_on else -abs(t)
        state[j + np.uint64(TILE)] += weight * r
        state[j + np.uint64(2 * TILE)] += weight * g
        state[j + np.uint64(3 * TILE)] += weight * b


@scalar
def blend_row_before(state, stop, row, u, a, slope, rest, r, g, b, peak, dy, is_parallel):
    """`blend_row`, but for the pixels where the splat peaks behind `stop`: those it leaves."""
    at = np.uint64(row * ROW)
    behind = np.uint64(row * TILE)
    first, second, third = row_at(peak[HX], peak[HY], peak[HZ], dy)
    gx, gy, center, reach = peak[GX], peak[GY], peak[CENTER], peak[REACH]
    for x in range(TILE):
        j = at + np.uint64(x)
        dx = np.float32(x) - u
        depth = peak_at(dx, gx, gy, first, second, third, center, reach, is_parallel)
        alpha = alpha_at(dx, a, slope, rest)
        alpha = alpha if depth <= stop[behind + np.uint64(x)] else np.float32(0)
        t = state[j]
        weight = alpha * t
        left = t - weight
        goes_on = left >= END
        weight = weight if goes_on else np.float32(0)
        state[j] = left if goes_on else -abs(t)
        state[j + np.uint64(TILE)] += weight * r
        state[j + np.uint64(2 * TILE)] += weight * g
        state[j + np.uint64(3 * TILE)] += weight * b


@scalar
def rows_touched(a, b, c, log_opacity, half_height, u, v):
    """First and one past the last row of a tile that a splat touches; (u, v) relative to the
    tile."""
    one, most = np.float32(1), np.float32(TILE - 1)
    reach = np.float32(2) * (log_opacity - LEAST)
    lowest, highest = span(c, b, a, reach, half_height, -u - SLACK, most - u + SLACK)
    # int() cuts towards zero: of x >= 0 it is the floor, and of x + 1 − slack the ceiling of x −
    # slack
    first = np.int32(max(v + lowest, np.float32(0)) + (one - SLACK))
    end = np.int32(max(min(v + highest + SLACK, most), -one) + one)
    return first, end


# --- 2. CPU ----------------------------------------------------------------------------

FIELDS = 7
"""Floats of a record that blending reads, packed: u v a b c ln(opacity) half-height, exponents
shrunk."""


@scalar
def load_paints(paints, column, lists, first, count, batch):
    """Fetch the paint of `count` splats of a list, beside what `load_batch` fetches."""
    for i in range(count):
        k = lists[first + i]
        batch[7 * LOOK + i] = paints[k, column]
        batch[8 * LOOK + i] = paints[k, column + 1]
        batch[9 * LOOK + i] = paints[k, column + 2]


@scalar
def load_stops(stops, top, left, g, stop):
    """Copy the depths of surfaces in a tile, +inf outside the band; returns (least, most)."""
    least, most = np.float32(np.inf), np.float32(-np.inf)
    for y in range(TILE):
        for x in range(TILE):
            depth = np.float32(np.inf)
            if g.y0 <= top + y < g.y1 and g.x0 <= left + x < g.x1:
                depth = stops[top + y - g.y0, left + x - g.x0]
                least, most = min(least, depth), max(most, depth)
            stop[y * TILE + x] = depth
    return least, most


@scalar
def load_batch(records, lists, first, count, left, top, batch, rows):
    """Fetch `count` splats of a list and find the rows of this tile that each touches.

    Fetching many before blending any hides the latency of memory, and the square roots of the row
    spans are taken for several splats at once.
    """
    for i in range(count):
        s = records[lists[first + i]]
        batch[i] = s[U] - left
        batch[LOOK + i] = s[V] - top
        batch[2 * LOOK + i] = s[A] * SHRINK
        batch[3 * LOOK + i] = s[B] * SHRINK
        batch[4 * LOOK + i] = s[C] * SHRINK
        batch[5 * LOOK + i] = s[LOG_OPACITY] * SHRINK
        batch[6 * LOOK + i] = s[HALF_HEIGHT]
    for i in range(LOOK):
        k = np.uint64(i)
        rows[k], rows[k + np.uint64(LOOK)] = rows_touched(
            batch[k + np.uint64(2 * LOOK)], batch[k + np.uint64(3 * LOOK)],
            batch[k + np.uint64(4 * LOOK)], batch[k + np.uint64(5 * LOOK)],
            batch[k + np.uint64(6 * LOOK)], batch[k], batch[k + np.uint64(LOOK)],
        )  # fmt: skip


@scalar
def look(state, row_floats, live):
    """Mark rows with a pixel that goes on; returns how many there are."""
    rows = 0
    for y in range(TILE):
        at = np.uint64(y * row_floats)
        alive = np.int32(0)
        for x in range(TILE):
            alive += np.int32(state[at + np.uint64(x)] > np.float32(0))
        live[y] = alive > 0
        rows += live[y]
    return rows


@scalar
def _store(state, image, top, left, y0, y1, x0, x1):
    """Write the pixels of a tile that lie in rows y0 to y1 - 1 and columns x0 to x1 - 1 of it."""
    for y in range(y0, y1):
        at = np.uint64(y * ROW)
        row = image[top + y]
        first = np.uint64((left + x0) * CHANNELS)
        for x in range(x1 - x0):
            j = at + np.uint64(x0 + x)
            k = first + np.uint64(x * CHANNELS)
            row[k] = state[j + np.uint64(TILE)]
            row[k + np.uint64(1)] = state[j + np.uint64(2 * TILE)]
            row[k + np.uint64(2)] = state[j + np.uint64(3 * TILE)]
            row[k + np.uint64(3)] = np.float32(1) - abs(state[j])


@parallel
def blend(records, paints, column, starts, lists, grid, peaks, stops, is_parallel, image, work):
    """Blend all tiles of a band.

    Args:
        records, starts, lists, grid: What `bins` made.
        paints: Three numbers of each splat from column `column` on; shape (n, >= column + 3) f32.
        peaks: Of the records, shape (n, PEAK) f32; read only where there are surfaces.
        stops: Planar depth of surfaces, +inf where there is none, shape (y1 - y0, x1 - x0) f32; or
            of no size when there are none at all.
        is_parallel: Whether rays are: the camera is orthographic.
        image: Receives premultiplied paint and coverage of the band, shape
            (y1 - y0, (x1 - x0) * 4) f32.
        work: Receives the rows of 16 pixels blended in each tile, shape (tiles,) i64.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        state = np.zeros(TILE * ROW, np.float32)
        for y in range(TILE):
            state[y * ROW : y * ROW + TILE] = np.float32(1)
        least, most = np.float32(np.inf), np.float32(np.inf)
        stop = np.empty(TILE * TILE, np.float32)
        if stops.shape[0] > 0:
            least, most = load_stops(stops, top, left, g, stop)
        live = np.ones(TILE, np.uint8)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.int32)
        done = 0
        end = starts[tile + 1]
        for first in range(starts[tile], end, LOOK):
            count = min(LOOK, end - first)
            load_batch(records, lists, first, count, np.float32(left), np.float32(top), batch, rows)
            load_paints(paints, column, lists, first, count, batch)
            for i in range(count):
                u, v = batch[i], batch[LOOK + i]
                a, b, c = batch[2 * LOOK + i], batch[3 * LOOK + i], batch[4 * LOOK + i]
                log_opacity = batch[5 * LOOK + i]
                red, green, blue = batch[7 * LOOK + i], batch[8 * LOOK + i], batch[9 * LOOK + i]
                if least < np.float32(np.inf):
                    peak = peaks[lists[first + i]]
                    if peak[CENTER] - peak[REACH] > most:
                        continue
                    if peak[CENTER] + peak[REACH] > least:
                        for y in range(rows[i], rows[LOOK + i]):
                            if live[y]:
                                dy = np.float32(y) - v
                                rest = c * dy * dy + log_opacity
                                blend_row_before(
                                    state, stop, y, u, a, b * dy, rest, red, green, blue,
                                    peak, dy, is_parallel,
                                )  # fmt: skip
                                done += 1
                        continue
                for y in range(rows[i], rows[LOOK + i]):
                    if live[y]:
                        dy = np.float32(y) - v
                        rest = c * dy * dy + log_opacity
                        blend_row(state, y, u, a, b * dy, rest, red, green, blue)
                        done += 1
            if look(state, ROW, live) == 0:
                break
        work[tile] = done
        _store(
            state, image, top - g.y0, left - g.x0, max(0, g.y0 - top), min(TILE, g.y1 - top),
            max(0, g.x0 - left), min(TILE, g.x1 - left),
        )  # fmt: skip
