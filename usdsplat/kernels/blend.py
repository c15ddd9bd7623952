"""Blend each tile's list front to back: colour and coverage.

Lists are processed in batches, and within a batch by blocks of 4x4 pixels. Transmittance, red,
green and blue of a block stay in four registers (see `lanes`) for all splats of the batch that
touch it, which are found by a bit mask. A splat of a capture touches two thirds to three quarters
as many blocks as rows of 16 pixels. Between batches, a saturated pixel has its transmittance with
the sign inverted.

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

from .batch import FIELDS, LEAST, LOOK, behind_surfaces, load_fields, load_paints
from .batch import SHRINK as SHRINK
from .bins import SLACK, TILE, span
from .jit import exact, parallel, routine, scalar
from .lane_blocks import (
    ACROSS,
    BLOCKS,
    MANY,
    SIDE,
    STATE,
    begin_tile,
    columns,
    lay_rows,
    load_stops,
    repeated,
    rows,
    store_tile,
    touched_rows,
    touched_splats,
)
from .lane_blocks import CHANNELS as CHANNELS
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
    size,
    store,
)
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, row_at

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


@routine
def blend_block(state, batch, spans, slopes, left, top, count):
    """Blend the splats of a batch that touch a block.

    Args:
        state, batch, spans, slopes: Addresses: of the block's state, and of the results of
            `load_fields` and `load_paints`; of `touched_rows`, for the block's column; and of
            `lay_rows`, from the block's first row on.
        left, top: Of the block, in the tile [pixel], f32.
        count: Number of splats.

    Returns:
        Twice the number of splats blended, plus 1 if the block is not saturated.
    """
    apart()
    one = np.uint64(1)
    xs = columns(left)
    through, red = load(state, np.uint64(0)), load(state, np.uint64(TILE))
    green, blue = load(state, np.uint64(2 * TILE)), load(state, np.uint64(3 * TILE))
    # `remains` is multiplied on after saturation, too: splats then depend on each other by one
    # multiplication only, and their other operations overlap. It never rises above END again.
    remains, done = through, 0
    for base in range(0, count, LOOK):
        touched = touched_splats(spans, base, top)
        done += count_bits(touched)
        while touched != np.uint64(0):
            i = lowest_bit(touched) + np.uint64(base)
            touched &= touched - one
            at = i * np.uint64(2 * TILE)
            alpha = alphas_at(
                xs - number(batch, i), number(batch, i + np.uint64(2 * MANY)),
                repeated(slopes, at), repeated(slopes, at + np.uint64(TILE)),
            )  # fmt: skip
            weight = alpha * remains
            remains = fused(-alpha, remains, remains)
            goes_on = remains >= END
            weight = choose(goes_on, weight, np.float32(0))
            through = choose(goes_on, remains, through)
            red = red + weight * number(batch, i + np.uint64(7 * MANY))
            green = green + weight * number(batch, i + np.uint64(8 * MANY))
            blue = blue + weight * number(batch, i + np.uint64(9 * MANY))
        if bits(remains >= END) == np.uint64(0):
            break
    through = choose(remains >= END, through, -size(through))
    store(state, np.uint64(0), through)
    store(state, np.uint64(TILE), red)
    store(state, np.uint64(2 * TILE), green)
    store(state, np.uint64(3 * TILE), blue)
    return done * 2 + is_alive(through)


@scalar
def blend_block_behind(
    state, batch, spans, slopes, left, top, count, ranks, mixed, ray_hits, stop, is_parallel
):
    """Return `blend_block`, but compare splats of mask `mixed` with surfaces pixel by pixel.

    Args:
        ranks: Part of the tile's list.
        stop: Place of the depths of surfaces in the block.
    """
    one, done = np.uint64(1), 0
    xs, ys = columns(left), rows(top)
    through, red = load(state, np.uint64(0)), load(state, np.uint64(TILE))
    green, blue = load(state, np.uint64(2 * TILE)), load(state, np.uint64(3 * TILE))
    for base in range(0, count, LOOK):
        touched = touched_splats(spans, base, top)
        done += count_bits(touched)
        while touched != np.uint64(0):
            i = lowest_bit(touched) + np.uint64(base)
            touched &= touched - one
            dx, dy = xs - number(batch, i), ys - number(batch, i + np.uint64(MANY))
            at = i * np.uint64(2 * TILE)
            alpha = alphas_at(
                dx, number(batch, i + np.uint64(2 * MANY)),
                repeated(slopes, at), repeated(slopes, at + np.uint64(TILE)),
            )  # fmt: skip
            if (mixed >> i) & one:
                k = np.uint64(ranks[i])
                d0, d1, d2 = row_at(ray_hits[k, HX], ray_hits[k, HY], ray_hits[k, HZ], dy)
                depth = ray_hits_at(
                    dx, ray_hits[k, GX], ray_hits[k, GY], d0, d1, d2, ray_hits[k, CENTER],
                    ray_hits[k, REACH], is_parallel,
                )  # fmt: skip
                alpha = choose(depth <= load(stop, np.uint64(0)), alpha, np.float32(0))
            through, weight = pass_through(through, alpha)
            red = red + weight * number(batch, i + np.uint64(7 * MANY))
            green = green + weight * number(batch, i + np.uint64(8 * MANY))
            blue = blue + weight * number(batch, i + np.uint64(9 * MANY))
    store(state, np.uint64(0), through)
    store(state, np.uint64(TILE), red)
    store(state, np.uint64(2 * TILE), green)
    store(state, np.uint64(3 * TILE), blue)
    return done * 2 + is_alive(through)


@parallel(writes=("image", "work"), gpu="blend.blend")
def blend(
    records, paints, column, starts, lists, grid, ray_hits, occluder_depth, is_parallel, image, work
):
    """Blend all tiles of a band.

    Args:
        records, starts, lists, grid: Results of `project` and `bins`.
        paints: Three numbers of each splat from column `column` on; shape (n, >= column + 3) f32.
        ray_hits: Ray hits of the records, shape (n, RAY_HIT) f32; read only if there are surfaces.
        occluder_depth: Planar depth of surfaces, +inf where there is none, shape (y1 - y0, x1 - x0)
            f32; empty without surfaces.
        is_parallel: Whether all rays are parallel, as for an orthographic camera.
        image: Receives premultiplied paint and coverage of the band, shape
            (y1 - y0, (x1 - x0) * 4) f32.
        work: Receives the pairs of a splat and a block blended in each tile, shape (tiles,) i64.
    """
    for tile in prange(starts.shape[0] - 1):
        g = grid[0]
        left = g.left + tile % g.columns * TILE
        top = g.top + tile // g.columns * TILE
        zero = np.uint64(0)
        state = np.zeros(BLOCKS * STATE, np.float32)
        live = np.zeros(BLOCKS, np.uint8)
        x0, x1 = max(0, g.x0 - left), min(TILE, g.x1 - left)
        y0, y1 = max(0, g.y0 - top), min(TILE, g.y1 - top)
        alive = begin_tile(state, live, x0, x1, y0, y1)
        least, most = np.float32(np.inf), np.float32(np.inf)
        stop = np.empty(TILE * TILE, np.float32)
        if occluder_depth.shape[0] > 0:
            least, most = load_stops(occluder_depth, top, left, g, stop)
        batch = np.ones((FIELDS + 3) * MANY, np.float32)
        spans = np.empty(ACROSS * 2 * MANY, np.float32)
        slopes = np.empty(2 * TILE * MANY, np.float32)
        done = 0
        end = starts[tile + 1]
        for first in range(starts[tile], end, MANY):
            if alive == 0:
                break
            count = min(MANY, end - first)
            x, y = np.float32(left), np.float32(top)
            load_fields(records, lists, first, count, x, y, batch, MANY)
            load_paints(paints, column, lists, first, count, batch, MANY)
            touched_rows(batch, spans, count)
            lay_rows(batch, slopes, count)
            mixed = zero
            if least < np.float32(np.inf):
                hidden, mixed = behind_surfaces(ray_hits, lists, first, count, least, most)
                while hidden != zero:
                    for k in range(ACROSS):
                        spans[np.uint64((2 * k + 1) * MANY) + lowest_bit(hidden)] = np.float32(0)
                    hidden &= hidden - np.uint64(1)
            for k in range(BLOCKS):
                if live[k] == 0:
                    continue
                here, there = place(state, np.uint64(k * STATE)), place(batch, zero)
                touched = place(spans, np.uint64(k % ACROSS * 2 * MANY))
                laid = place(slopes, np.uint64(k // ACROSS * SIDE))
                x, y = np.float32(k % ACROSS * SIDE), np.float32(k // ACROSS * SIDE)
                if mixed == zero:
                    found = blend_block(here, there, touched, laid, x, y, count)
                else:
                    found = blend_block_behind(
                        here, there, touched, laid, x, y, count, lists[first:end], mixed,
                        ray_hits, place(stop, np.uint64(k * TILE)), is_parallel,
                    )  # fmt: skip
                done += found >> 1
                live[k] = found & 1
                alive -= 1 - (found & 1)
        work[tile] = done
        store_tile(state, image, top - g.y0, left - g.x0, y0, y1, x0, x1)
