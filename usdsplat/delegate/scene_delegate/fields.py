"""Read splat fields in the renderer's form."""

from __future__ import annotations

from typing import cast

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.scene_delegate.points import is_points, read_points
from usdsplat.images.color import color_space
from usdsplat.images.grade import grade_matrix
from usdsplat.render.specs import (
    FieldSpec,
    LightingMode,
    PackedSpec,
    ProjectionMode,
    RasterizeMode,
    SortingMode,
    SurfaceSpec,
)


def read_field(prim: Usd.Prim, time: float | None) -> FieldSpec | None:
    """Read the splats of a field or of points; None if there are none at this time.

    If the time is None, an attribute that has only time samples has the value of the first one.

    Raises:
        UsdSplatError: If the field cannot be drawn.
    """
    if is_points(prim):
        return read_points(prim, time)
    return read_cloud(prim, time, schema.fetch(prim, time), packed=_packed(prim, time))


def read_cloud(
    prim: Usd.Prim,
    time: float | None,
    cloud: SplatCloud,
    *,
    packed: PackedSpec | None = None,
    moves: bool = False,
) -> FieldSpec | None:
    """Read how a field's splats are drawn; None if there are none.

    Args:
        prim: A splat field.
        time: Time code.
        cloud: Its splats at this time.
        packed: Its packed arrays.
        moves: Whether these splats move although the stage has only some of their samples.

    Raises:
        UsdSplatError: If the field cannot be drawn.
    """
    space = schema.color_space(prim)
    color_space(space, where=f"{prim.GetPath()} color space")
    if not len(cloud):
        return None
    mode, footprint = cast(RasterizeMode, schema.rasterize_mode(prim)), schema.footprint(prim)
    return FieldSpec(
        cloud=cloud,
        color_space=space,
        rasterize_mode="footprint" if footprint and mode == "classic" else mode,
        footprint=footprint or 0.0,
        projection_mode=cast(ProjectionMode, schema.projection_mode(prim)),
        sorting_mode=cast(SortingMode, schema.sorting_mode(prim)),
        grade=grade_matrix(schema.grade(prim, time), space),
        packed=packed,
        surface=_surface(prim, len(cloud), time, moves=moves),
        lighting=cast(LightingMode, schema.lighting_mode(prim)),
        captured_lights=schema.captured_lights(prim),
        is_catcher=schema.is_shadow_catcher(prim),
    )


def _surface(prim: Usd.Prim, count: int, time: float | None, *, moves: bool) -> SurfaceSpec | None:
    """Return the authored normals; None if there are none, or if the splats move without them."""
    if not schema.has_normals(prim, moves=moves):
        return None
    found = schema.fetch_surface(prim, count, time)
    if found.normals is None:
        return None
    return SurfaceSpec(
        normals=found.normals, confidence=found.confidence, occlusion=found.occlusion
    )


def _packed(prim: Usd.Prim, time: float | None) -> PackedSpec | None:
    """Return the packed arrays of a packed prim; None for others, and between samples."""
    arrays = schema.fetch_packed(prim, time) if schema.is_packed(prim) else None
    if arrays is None:
        return None
    width = schema.harmonics_width(arrays.degree)
    return PackedSpec(
        words=arrays.core,
        harmonics=arrays.harmonics.reshape(-1, 4 * max(1, width)),
        color_range=arrays.color_range.ravel(),
        steps=arrays.harmonics_range / np.float32(127),
    )
