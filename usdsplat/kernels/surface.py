"""Where a finished splat layer and opaque surfaces become one picture."""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel
from .shade import DRAWN, MATTE, NOTHING
from .walk import held_through


@scalar
def straight_depth(depth):
    """A holdout's depth: what is no depth hides nothing."""
    return depth if depth > np.float32(0) else np.float32(np.inf)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="stops", writes=("stops", "covered"), axes=2)
def clear(y, x, stops, covered):
    """Say that there is no surface: +inf and NOTHING, (h, w)."""
    stops[y, x], covered[y, x] = np.float32(np.inf), NOTHING


@kernel(over="stops", writes=("stops", "covered"), axes=2)
def hold_back(y, x, stops, covered, depth):
    """Let a flat holdout hide what is behind it, surfaces too.

    Args:
        stops, covered: Planar depths of surfaces and what they are, (h, w); changed in place.
        depth: Of the holdout, +inf where it has nothing, shape (h, w) f32.
    """
    nearest = straight_depth(depth[y, x])
    if nearest < stops[y, x]:
        stops[y, x], covered[y, x] = nearest, MATTE


@kernel(over="image", writes=("through", "left"), axes=2)
def show_through(y, x, image, through, covered, stops, holdout, left):
    """Find how much of a surface the layer in front of it lets through.

    Args:
        image: The layer, premultiplied with coverage, shape (h, w, 4) f32.
        through: Its transmittance, shape (h, w) f32; of no size where it is 1 − coverage.
        covered, stops: What the surfaces are and their planar depth, (h, w).
        holdout: As `walk` takes it: what else is in front of the surface.
        left: Receives 0..1, 0 where no surface is in the picture, shape (h, w) f32.
    """
    offsets, depths, held = holdout
    left[y, x] = np.float32(0)
    if covered[y, x] == DRAWN:
        part = through[y, x] if through.shape[0] > 0 else np.float32(1) - image[y, x, 3]
        if offsets.shape[0] > 0:
            pixel = y * image.shape[1] + x
            part *= held_through(offsets, depths, held, pixel, stops[y, x])
        left[y, x] = part


@kernel(over="image", writes=("image",), axes=2)
def over(y, x, image, left, surface):
    """Put a premultiplied layer over what it lets through of a surface, in place.

    Args:
        image: Shape (h, w, 4) f32; left: of `show_through`; surface: three numbers, (h, w, 3) f32.
    """
    part = left[y, x]
    if part > np.float32(0):
        for c in range(3):
            image[y, x, c] += part * surface[y, x, c]
        image[y, x, 3] += part


@kernel(over="depth", writes=("depth", "ids"), axes=2)
def nearest(y, x, depth, ids, stops, covered, surface_ids):
    """Fill in surfaces where no splat is: depth and identity, in place.

    Args:
        depth, ids: Of the splats, +inf and -1 where none is, (h, w) f32 and (4, h, w) i32.
        stops, covered, surface_ids: Of the surfaces, whose (prim, instance, face) are (3, h, w).
    """
    if covered[y, x] == DRAWN and ids[0, y, x] < 0:
        depth[y, x] = stops[y, x]
        for k in range(3):
            ids[k, y, x] = surface_ids[k, y, x]


@kernel(over="left", writes=("out",), axes=2)
def shown(y, x, left, surface_ids, out):
    """out[y, x] = the prim of the surface, -1 where nothing is left of it.

    Args:
        left: Of `show_through`; surface_ids: of `nearest`.
        out: Shape (h, w) i32.
    """
    out[y, x] = surface_ids[0, y, x] if left[y, x] > np.float32(0) else np.int32(-1)
