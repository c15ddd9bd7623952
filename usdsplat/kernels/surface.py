"""Composite a finished splat layer over opaque surfaces."""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel
from .shade import DRAWN, MATTE, NOTHING
from .walk import held_through


@scalar
def straight_depth(depth):
    """Return a holdout's depth; an invalid one is +inf, which hides nothing."""
    return depth if depth > np.float32(0) else np.float32(np.inf)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="occluder_depth", writes=("occluder_depth", "covered"), axes=2)
def clear(y, x, occluder_depth, covered):
    """Clear the surfaces: +inf and NOTHING, (h, w)."""
    occluder_depth[y, x], covered[y, x] = np.float32(np.inf), NOTHING


@kernel(over="occluder_depth", writes=("occluder_depth", "covered"), axes=2)
def hold_back(y, x, occluder_depth, covered, depth):
    """Add a flat holdout, which also hides surfaces behind it.

    Args:
        occluder_depth, covered: Planar depths and kinds of surfaces, (h, w); changed in place.
        depth: Depth of the holdout, +inf where it is empty, shape (h, w) f32.
    """
    nearest = straight_depth(depth[y, x])
    if nearest < occluder_depth[y, x]:
        occluder_depth[y, x], covered[y, x] = nearest, MATTE


@kernel(over="image", writes=("through", "left"), axes=2)
def show_through(y, x, image, through, covered, occluder_depth, holdout, left):
    """Compute the transmittance of the layer in front of a surface.

    Args:
        image: The layer, premultiplied with coverage, shape (h, w, 4) f32.
        through: Its transmittance, shape (h, w) f32; empty if it is 1 − coverage.
        covered, occluder_depth: Kinds of the surfaces and their planar depth, (h, w).
        holdout: Holdout that hides in part and may be in front of the surface, see `walk`.
        left: Receives 0..1, 0 where no surface is in the picture, shape (h, w) f32.
    """
    offsets, depths, held = holdout
    left[y, x] = np.float32(0)
    if covered[y, x] == DRAWN:
        part = through[y, x] if through.shape[0] > 0 else np.float32(1) - image[y, x, 3]
        if offsets.shape[0] > 0:
            pixel = y * image.shape[1] + x
            part *= held_through(offsets, depths, held, pixel, occluder_depth[y, x])
        left[y, x] = part


@kernel(over="image", writes=("image",), axes=2)
def over(y, x, image, left, surface):
    """Composite a premultiplied layer over a surface, in place.

    Args:
        image: The layer, shape (h, w, 4) f32.
        left: Result of `show_through`.
        surface: Three values of the surface, shape (h, w, 3) f32.
    """
    part = left[y, x]
    if part > np.float32(0):
        for c in range(3):
            image[y, x, c] += part * surface[y, x, c]
        image[y, x, 3] += part


@kernel(over="depth", writes=("depth", "ids"), axes=2)
def nearest(y, x, depth, ids, occluder_depth, covered, surface_ids):
    """Write depth and ids of surfaces where no splat is, in place.

    Args:
        depth, ids: Values of splats, +inf and -1 where there is none, (h, w) f32 and (4, h, w) i32.
        occluder_depth, covered: Values of surfaces, (h, w).
        surface_ids: (prim, instance, face) of surfaces, (3, h, w).
    """
    if covered[y, x] == DRAWN and ids[0, y, x] < 0:
        depth[y, x] = occluder_depth[y, x]
        for k in range(3):
            ids[k, y, x] = surface_ids[k, y, x]


@kernel(over="left", writes=("out",), axes=2)
def shown(y, x, left, surface_ids, groups, out):
    """Set out[y, x] to the group of the surface's prim, -1 where it is completely hidden.

    Args:
        left: Result of `show_through`.
        surface_ids: See `nearest`.
        groups: Group of each prim, shape (prims,) i32.
        out: Shape (h, w) i32.
    """
    is_seen = left[y, x] > np.float32(0)
    out[y, x] = groups[surface_ids[0, y, x]] if is_seen else np.int32(-1)


@kernel(over="left", writes=("out",), axes=2)
def shown_material(y, x, left, hit, appearances, material_of, groups, out):
    """Set out[y, x] to the group of the surface's material, -1 where it is completely hidden.

    Args:
        left: Result of `show_through`.
        hit: Appearance and triangle of each pixel, shape (2, h, w) i32.
        appearances: APPEARANCE records.
        material_of: Material of each triangle, see `shade.shade`.
        groups: Group of each material, shape (materials,) i32.
        out: Shape (h, w) i32.
    """
    out[y, x] = np.int32(-1)
    if left[y, x] > np.float32(0):
        look = appearances[hit[0, y, x]]
        number = look.material
        if look.material_of >= 0:
            number += material_of[look.material_of + hit[1, y, x]]
        out[y, x] = groups[number]
