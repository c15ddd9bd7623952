"""Splat prims, as the renderer takes them."""

from __future__ import annotations

from typing import cast

from pxr import Usd

from usdsplat import schema
from usdsplat.delegate.specs import FieldSpec, ProjectionMode, RasterizeMode, SortingMode
from usdsplat.images.color import color_space
from usdsplat.images.grade import grade_matrix


def read_field(prim: Usd.Prim, time: float | None) -> FieldSpec | None:
    """Return the splats of `prim`, or None when it has none at this time.

    With None for the time a prim that has time samples only shows its first.

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
        rasterize_mode=cast(RasterizeMode, schema.rasterize_mode(prim)),
        projection_mode=cast(ProjectionMode, schema.projection_mode(prim)),
        sorting_mode=cast(SortingMode, schema.sorting_mode(prim)),
        grade=grade_matrix(schema.grade(prim, time), space),
    )
