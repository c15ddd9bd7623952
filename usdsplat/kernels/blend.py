"""Blend each tile's list front to back: colour and coverage.

Lists are processed in batches, and within a batch by rows of the tile. Transmittance, red, green
and blue of 16 pixels stay in four registers (see `lanes`) for all splats of the batch that touch
the row, which are found by a bit mask. A saturated pixel keeps its transmittance with the sign
inverted: it neither changes again nor decays into denormals.

If there are surfaces, each splat is compared with them pixel by pixel, at its ray hit. Splats
behind them are skipped and the pixel continues, because a list in the order of centres is not in
the order of ray hits.

The blended paint is colour, or any other three numbers of a splat.

Source: Kerbl et al. 2023, "3D Gaussian Splatting", for the compositing rules.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .batch import (
    FIELDS,
    LEAST,
    LOOK,
    behind_surfaces,
    lay_row,
    load_batch,
    load_occluder_depth,
    load_paints,
)
from .batch import SHRINK as SHRINK
from .bins import SLACK, TILE, span
from .jit import exact, parallel, routine, scalar
from .lanes import (
    apart,
    bits,
    choose,
    count_bits,
    fused,
    load,
    lower,
    lowest_bit,
    number,
    place,
    ramp,
    size,
    store,
    store_mixed,
)
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, row_at

CHANNELS = 4
ROW = CHANNELS * TILE
"""Floats of one row of a tile's state."""
END = np.float32(1e-4)
"""A pixel is saturated before the splat that would bring its transmittance under this value."""
MOST = np.float32(math.log(0.999)) * SHRINK
"""Scaled exponent of the largest contribution of one splat at one pixel."""


# --- 1. mathematics: one splat over one row of 16 pixels --------------------------------


@scalar
def exponential(z):
    """Return e**(8 z) for z in [LEAST, 0], relative error 2e-6.

    z is float32 or lanes. Below the range the result is wrong but never NaN. Coefficients: minimax
    of the relative error for a polynomial of degree 5 that is 1 at 0.
    """
    w = np.float32(0.0398810700) + z * np.float32(0.00590597)
    w = np.float32(0.4999036) + z * (np.float32(0.1660462) + z * w)
    w = np.float32(1) + z * (np.float32(0.999995) + z * w)
    w = w * w
    w = w * w
    return w * w


@scalar
def alpha_at(dx, a, slope, rest):
    """Return the contribution of a splat at offset dx along a row, 0 if it is under 1/255.

    a dx² + slope dx + rest is the scaled exponent, with the logarithm of opacity included.
    """
    e = (a * dx + slope) * dx + rest
    e = e if e < MOST else MOST
    alpha = exponential(e)
    return alpha if e >= LEAST else np.float32(0)


@scalar
def alphas_at(dx, a, slope, rest):
    """Return `alpha_at` of 16 pixels."""
    e = lower(fused(fused(dx, a, slope), dx, rest), MOST)
    return choose(e >= LEAST, exponential(e), np.float32(0))


@scalar
def pass_through(through, alpha):
    """Return the transmittance of 16 pixels behind a contribution, and the weight of the
    contribution."""
    remains = fused(-alpha, through, through)
    goes_on = remains >= END
    weight = choose(goes_on, alpha * through, np.float32(0))
    return choose(goes_on, remains, -size(through)), weight


@scalar
def is_alive(through):
    """Return 1 if any of 16 pixels is not saturated, else 0."""
    return 1 if bits(through > np.float32(0)) != np.uint64(0) else 0


@exact
def ray_hits_at(dx, gx, gy, first, second, third, center, reach, is_parallel):
    """Return `ray_hit.ray_hit_at` of 16 pixels."""
    one = np.float32(1)
    a, b = first + gx * dx, second + gy * dx
    along = a * a + b * b + third * third
    apart = one - a if is_parallel else center * (a / along - one)
    held = choose(apart > np.float32(0), reach, -reach)
    return center + choose(size(apart) < reach, apart, held)


@scalar
def rows_touched(a, b, c, log_opacity, half_height, u, v):
    """Return the first row of a tile, and one past the last, that a splat touches; (u, v) is
    relative to the tile."""
    one, most = np.float32(1), np.float32(TILE - 1)
    reach = np.float32(2) * (log_opacity - LEAST)
    lowest, highest = span(c, b, a, reach, half_height, -u - SLACK, most - u + SLACK)
    # int() cuts towards zero: of x >= 0 it is the floor, and of x + 1 − slack the ceiling of x −
    # slack
    first = np.int32(max(v + lowest, np.float32(0)) + (one - SLACK))
    end = np.int32(max(min(v + highest + SLACK, most), -one) + one)
    return first, end


# --- 2. CPU ----------------------------------------------------------------------------


@scalar
def _store(state, image, top, left, y0, y1, x0, x1):
    """Write the pixels of a tile that lie in rows y0 to y1 - 1 and columns x0 to x1 - 1 of it."""
    for y in range(y0, y1):
        at = np.uint64(y * ROW)
        row = image[top + y]
        if x1 - x0 == TILE:
            through = size(load(state, at))
            store_mixed(
                row, np.uint64(left * CHANNELS), load(state, at + np.uint64(TILE)),
                load(state, at + np.uint64(2 * TILE)), load(state, at + np.uint64(3 * TILE)),
                np.float32(1) - through,
            )  # fmt: skip
            continue
        first = np.uint64((left + x0) * CHANNELS)
        for x in range(x1 - x0):
            j = at + np.uint64(x0 + x)
            k = first + np.uint64(x * CHANNELS)
            row[k] = state[j + np.uint64(TILE)]
            row[k + np.uint64(1)] = state[j + np.uint64(2 * TILE)]
            row[k + np.uint64(2)] = state[j + np.uint64(3 * TILE)]
            row[k + np.uint64(3)] = np.float32(1) - abs(state[j])


@routine
def blend_row(state, batch, slopes, touched):
    """Blend the splats of a batch that touch a row of a tile. Return 1 if the row is not saturated.

    The arguments are places: of the row's state, and of the results of `load_batch` and `lay_row`.
    """
    apart()
    xs, one = ramp(), np.uint64(1)
    through, red = load(state, np.uint64(0)), load(state, np.uint64(TILE))
    green, blue = load(state, np.uint64(2 * TILE)), load(state, np.uint64(3 * TILE))
    # `remains` is multiplied on after saturation, too: splats then depend on each other by one
    # multiplication only, and their other operations overlap. It never rises above END again.
    remains = through
    while touched != np.uint64(0):
        i = lowest_bit(touched)
        touched &= touched - one
        alpha = alphas_at(
            xs - number(batch, i), number(batch, i + np.uint64(2 * LOOK)), number(slopes, i),
            number(slopes, i + np.uint64(LOOK)),
        )  # fmt: skip
        weight = alpha * remains
        remains = fused(-alpha, remains, remains)
        goes_on = remains >= END
        weight = choose(goes_on, weight, np.float32(0))
        through = choose(goes_on, remains, through)
        red = red + weight * number(batch, i + np.uint64(7 * LOOK))
        green = green + weight * number(batch, i + np.uint64(8 * LOOK))
        blue = blue + weight * number(batch, i + np.uint64(9 * LOOK))
    through = choose(remains >= END, through, -size(through))
    store(state, np.uint64(0), through)
    store(state, np.uint64(TILE), red)
    store(state, np.uint64(2 * TILE), green)
    store(state, np.uint64(3 * TILE), blue)
    return is_alive(through)


@parallel(writes=("image", "work"), gpu="blend.blend")
def blend(
    records, paints, column, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image, work
):
    """Blend all tiles of a band.

    Args:
        records, starts, lists, grid: Results of `project` and `bins`.
        paints: Three numbers of each splat from column `column` on; shape (n, >= column + 3) f32.
        ray_hits: Of the records, shape (n, RAY_HIT) f32; read only where there are surfaces.
        occluder_depth: Planar depth of surfaces, +inf where there is none, shape (y1 - y0, x1 - x0)
            f32; or of no size when there are none at all.
        is_parallel: Whether all rays are parallel, as for an orthographic camera.
        image: Receives premultiplied paint and coverage of the band, shape
            (y1 - y0, (x1 - x0) * 4) f32.
        work: Receives the rows of 16 pixels blended in each tile, shape (tiles,) i64.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        xs, zero, one = ramp(), np.uint64(0), np.uint64(1)
        state = np.zeros(TILE * ROW, np.float32)
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        y0, y1 = max(0, g.y0 - top), min(TILE, g.y1 - top)
        inside = (xs >= np.float32(x0)) & (xs < np.float32(x1))
        live = np.zeros(TILE, np.uint8)
        for y in range(y0, y1):
            store(state, np.uint64(y * ROW), choose(inside, np.float32(1), np.float32(0)))
            live[y] = 1
        alive = y1 - y0
        least, most = np.float32(np.inf), np.float32(np.inf)
        stop = np.empty(TILE * TILE, np.float32)
        if occluder_depth.shape[0] > 0:
            least, most = load_occluder_depth(occluder_depth, top, left, g, stop)
        batch = np.ones((FIELDS + 3) * LOOK, np.float32)
        rows = np.empty(2 * LOOK, np.float32)
        slopes = np.empty(2 * LOOK, np.float32)
        done = 0
        end = starts[tile + 1]
        for first in range(starts[tile], end, LOOK):
            if alive == 0:
                break
            count = min(LOOK, end - first)
            load_batch(records, lists, first, count, np.float32(left), np.float32(top), batch, rows)
            load_paints(paints, column, lists, first, count, batch)
            there = ~np.uint64(0) >> np.uint64(64 - count)
            mixed = np.uint64(0)
            if least < np.float32(np.inf):
                hidden, mixed = behind_surfaces(ray_hits, lists, first, count, least, most)
                there &= ~hidden
            for y in range(TILE):
                if live[y] == 0:
                    continue
                touched = lay_row(batch, rows, np.float32(y), slopes) & there
                done += count_bits(touched)
                at = np.uint64(y * ROW)
                if touched & mixed == zero:
                    goes_on = blend_row(
                        place(state, at), place(batch, zero), place(slopes, zero), touched
                    )
                    live[y] = goes_on
                    alive -= 1 - goes_on
                    continue
                through = load(state, at)
                red = load(state, at + np.uint64(TILE))
                green = load(state, at + np.uint64(2 * TILE))
                blue = load(state, at + np.uint64(3 * TILE))
                while touched != np.uint64(0):
                    i = lowest_bit(touched)
                    touched &= touched - one
                    dx = xs - batch[i]
                    alpha = alphas_at(
                        dx, batch[i + np.uint64(2 * LOOK)], slopes[i], slopes[i + np.uint64(LOOK)]
                    )
                    if (mixed >> i) & one:
                        k = np.uint64(lists[first + np.int64(i)])
                        dy = np.float32(y) - batch[i + np.uint64(LOOK)]
                        d0, d1, d2 = row_at(ray_hits[k, HX], ray_hits[k, HY], ray_hits[k, HZ], dy)
                        depth = ray_hits_at(
                            dx, ray_hits[k, GX], ray_hits[k, GY], d0, d1, d2, ray_hits[k, CENTER],
                            ray_hits[k, REACH], is_parallel,
                        )  # fmt: skip
                        behind = load(stop, np.uint64(y * TILE))
                        alpha = choose(depth <= behind, alpha, np.float32(0))
                    through, weight = pass_through(through, alpha)
                    red = red + weight * batch[i + np.uint64(7 * LOOK)]
                    green = green + weight * batch[i + np.uint64(8 * LOOK)]
                    blue = blue + weight * batch[i + np.uint64(9 * LOOK)]
                store(state, at, through)
                store(state, at + np.uint64(TILE), red)
                store(state, at + np.uint64(2 * TILE), green)
                store(state, at + np.uint64(3 * TILE), blue)
                goes_on = is_alive(through)
                live[y] = goes_on
                alive -= 1 - goes_on
        work[tile] = done
        _store(state, image, top - g.y0, left - g.x0, y0, y1, x0, x1)
