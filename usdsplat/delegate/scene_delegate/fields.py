"""Splat prims, as the renderer takes them."""

from __future__ import annotations

from pxr import Usd

from usdsplat import schema
from usdsplat.delegate.specs import FieldSpec
from usdsplat.images.color import color_space


def read_field(prim: Usd.Prim, time: Usd.TimeCode) -> FieldSpec | None:
    """Return the splats of `prim`, or None when it has none at this time.

    Raises:
        UsdSplatError: If what it holds cannot be drawn.
    """
    space = schema.color_space(prim)
    color_space(space, where=f"{prim.GetPath()} color space")
    cloud = schema.fetch(prim, time)
    if not len(cloud):
        return None
    return FieldSpec(
        cloud=cloud,
        color_space=space,
        rasterize_mode=schema.rasterize_mode(prim),
        projection_mode=schema.projection_mode(prim),
        sorting_mode=schema.sorting_mode(prim),
    )
