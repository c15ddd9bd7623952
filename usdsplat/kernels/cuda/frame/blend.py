"""Blend each tile's list front to back: a CUDA block is a tile, a thread one pixel or a few.

A warp owns a part of the tile, 8 pixels wide. Each splat of a batch is tested once against every
part. A warp then walks the splats that may touch its part: a vote of 32 lanes forms a word whose
highest bit is the nearest splat. Exponents have base 2, as the hardware's exponential. The rules
are those of `kernels.blend`. As there, a saturated pixel inverts the sign of its transmittance. All
variants draw the same pixels: rectangles are widened by SLACK, so that rounding removes no
contribution.

The innermost loop is limited by its number of instructions. Indices into shared memory are
unsigned, because signed ones are tested for negative values. The numbers of a splat are aligned to
16 bytes, so that four are loaded at once.

Source: Kerbl et al. 2023, "3D Gaussian Splatting", for the compositing rules.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba import cuda, float32, int32, uint32, uint64

from usdsplat.kernels.bins import SLACK, TILE
from usdsplat.kernels.cuda.falloff import TO_BITS, along_row, behind, contribution, exponent
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.vectors import load4
from usdsplat.kernels.cuda.warp import votes
from usdsplat.kernels.project import LOG_CUTOFF, RECORD

WIDE = 8
"""Width of a warp's part [pixel]. Its height is 4, times the pixels of a thread."""
DEEP = 32 // WIDE
FIELDS = 12
"""Floats of a splat in shared memory, the last three unused."""
END = np.float32(1e-4)

HIGHEST = np.uint32(1 << 31)
N1, N2, N3, N4, N5, N6, N7, N8 = (np.uint64(i) for i in range(1, 9))

SMALL = 6
"""Pairs per splat below which splats are small. Tests beyond a box then cost more than they
save."""
LARGE = 1 << 22
"""Pixels of a picture from which a thread draws four pixels, because there are enough tiles."""


def variant(pairs: int, splats: int, pixels: int) -> tuple[int, bool]:
    """Return the fastest variant: (pixels of a thread, whether parts are tested beyond boxes)."""
    if pairs < SMALL * splats:
        return 1, False
    return (4 if pixels >= LARGE else 2), True


@cuda.jit(device=True, inline="always")
def misses(a, b, c, reach, u, v, left, top, right, bottom):
    """Return whether the ellipse a dx² + b dx dy + c dy² = −reach has no point in a rectangle of
    pixels.

    The largest value in the rectangle lies on an edge that is nearest to the centre.
    """
    x, y = min(max(u, left), right), min(max(v, top), bottom)
    if x == u and y == v:
        return False
    best = float32(-1e30)
    if x != u:
        dx = x - u
        dy = min(max(v - b * dx / (float32(2) * c), top), bottom) - v
        best = max(best, a * dx * dx + b * dx * dy + c * dy * dy)
    if y != v:
        dy = y - v
        dx = min(max(u - b * dy / (float32(2) * a), left), right) - u
        best = max(best, a * dx * dx + b * dx * dy + c * dy * dy)
    return best < -reach


VARIANTS = ((1, False), (2, True), (4, True))
"""All results of `variant`."""


@functools.cache
def make_blend(pixels: int, is_exact: bool) -> tuple[Any, int]:
    """Return the kernel for a number of pixels per thread, and its number of threads.

    Its arguments: the GRID record; the first pair of each tile, (tiles + 1,); the pairs' rows in
    `records`; `image`, (height, width, 4) f32, premultiplied, which is written.
    """
    high = DEEP * pixels
    across = TILE // WIDE
    parts = across * (TILE // high)
    threads = 32 * parts
    floats = threads * FIELDS

    @kernel(name=f"cuda.frame.blend.blend({pixels},{is_exact})", fastmath=True)
    def blend(grid, starts, pair_splats, records, image):
        g = grid[0]
        t, tile = cuda.threadIdx.x, cuda.blockIdx.x
        lane, part = t % 32, t // 32
        left, top = tile % g.columns * TILE + g.left, tile // g.columns * TILE + g.top
        px = left + part % across * WIDE + lane % WIDE
        py = top + part // across * high + lane // WIDE
        x = float32(px - left)
        batch = cuda.shared.array(floats, float32, alignment=16)
        touched = cuda.shared.array(threads, uint32)
        through = cuda.local.array(pixels, float32)
        red = cuda.local.array(pixels, float32)
        green = cuda.local.array(pixels, float32)
        blue = cuda.local.array(pixels, float32)
        y = cuda.local.array(pixels, float32)
        for p in range(pixels):
            y[p] = float32(py - top + p * DEEP)
            there = g.x0 <= px < g.x1 and g.y0 <= py + p * DEEP < g.y1
            through[p] = float32(1) if there else float32(-1)
            red[p] = green[p] = blue[p] = float32(0)
        base, last = starts[tile], starts[tile + 1]
        alive = int32(1)
        while base < last:
            if cuda.syncthreads_count(alive) == 0:
                break
            mask = uint32(0)
            if base + t < last:
                k = uint64(pair_splats[base + t]) * uint64(RECORD)
                u, v, a, b = load4(records, k)
                u, v = u - float32(left), v - float32(top)
                c, log_opacity, half_width, half_height = load4(records, k + N4)
                r, gr, bl, _ = load4(records, k + N8)
                own = uint64(t) * uint64(FIELDS)
                batch[own], batch[own + N1] = u, v
                batch[own + N2], batch[own + N3] = a * TO_BITS, b * TO_BITS
                batch[own + N4], batch[own + N5] = c * TO_BITS, log_opacity * TO_BITS
                batch[own + N6], batch[own + N7], batch[own + N8] = r, gr, bl
                for q in range(parts):
                    x0, y0 = float32(q % across * WIDE) - SLACK, float32(q // across * high) - SLACK
                    x1 = x0 + (float32(WIDE - 1) + SLACK + SLACK)
                    y1 = y0 + (float32(high - 1) + SLACK + SLACK)
                    if (
                        u + half_width >= x0
                        and u - half_width <= x1
                        and v + half_height >= y0
                        and v - half_height <= y1
                    ):
                        if is_exact:
                            reach = log_opacity - LOG_CUTOFF
                            if misses(a, b, c, reach, u, v, x0, y0, x1, y1):
                                continue
                        mask |= uint32(1) << uint32(q)
            touched[t] = mask
            cuda.syncthreads()
            count = min(threads, last - base)
            if alive:
                for first in range(0, count, 32):
                    mine = touched[uint64(first + 31 - lane)] >> uint32(part) & uint32(1)
                    bits = votes(mine)
                    begin = uint64(first) * uint64(FIELDS)
                    while bits != 0:
                        lead = uint32(cuda.clz(bits))
                        bits = uint32(bits ^ (HIGHEST >> lead))
                        at = begin + uint64(lead) * uint64(FIELDS)
                        v, c = batch[at + N1], batch[at + N4]
                        rest, slope = along_row(
                            x - batch[at], batch[at + N2], batch[at + N3], batch[at + N5]
                        )
                        r, gr, bl = batch[at + N6], batch[at + N7], batch[at + N8]
                        for p in range(pixels):
                            alpha = contribution(exponent(y[p] - v, c, slope, rest))
                            weight = alpha * through[p]
                            remains = behind(through[p], alpha)
                            goes_on = remains >= END
                            ended = -abs(through[p])
                            weight = weight if goes_on else float32(0)
                            through[p] = remains if goes_on else ended
                            red[p] += weight * r
                            green[p] += weight * gr
                            blue[p] += weight * bl
                    living = int32(0)
                    for p in range(pixels):
                        if through[p] > float32(0):
                            living = int32(1)
                    alive = int32(votes(living) != 0)
                    if not alive:
                        break
            base += threads
        for p in range(pixels):
            row = py + p * DEEP
            if g.x0 <= px < g.x1 and g.y0 <= row < g.y1:
                to = image[row - g.y0, px - g.x0]
                to[0], to[1], to[2] = red[p], green[p], blue[p]
                to[3] = float32(1) - abs(through[p])

    return blend, threads


for _variant in VARIANTS:
    make_blend(*_variant)
