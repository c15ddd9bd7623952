"""Author captures on a stage: shared by single files and sequences."""

from __future__ import annotations

from dataclasses import fields

from pxr import Sdf, Usd, UsdGeom

from usdsplat import __version__, schema
from usdsplat.core import axes, edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.formats import Capture, ReadOptions
from usdsplat.interchange.placement import (
    OP,
    Placement,
    checked_unit,
    define_ancestors,
    set_default_prim,
    set_op,
)
from usdsplat.schema import DrawingHints, Form

IN_USD_MEMORY = ReadOptions(empty=schema.empty)
"""Options for reading captures that will be authored: most arrays are then not copied."""

_BLOCK = 1 << 16  # splats transformed at a time


def prepare(stage: Usd.Stage, up_axis: str | None, meters_per_unit: float | None) -> None:
    """Author up axis, unit and creator of a new stage.

    Args:
        stage: A new stage.
        up_axis: "Y" or "Z"; "Y" if None.
        meters_per_unit: 1 if None.

    Raises:
        UsageError: If the axis is unknown, or the unit is not positive.
    """
    up_axis = up_axis or "Y"
    if up_axis not in axes.UP_AXIS_FRAME:
        raise UsageError("up_axis", repr(up_axis), f"one of {', '.join(axes.UP_AXIS_FRAME)}")
    UsdGeom.SetStageUpAxis(stage, up_axis)
    unit = 1.0 if meters_per_unit is None else meters_per_unit
    UsdGeom.SetStageMetersPerUnit(stage, checked_unit(unit))
    stage.GetRootLayer().customLayerData = {"creator": f"usdsplat {__version__}"}


def author_field(
    stage: Usd.Stage,
    where: Sdf.Path,
    capture: Capture,
    placed: Placement,
    *,
    form: Form,
    bake_axes: bool,
    time: float | None = None,
) -> Usd.Prim:
    """Write the field of a capture, and the Xforms above it.

    Args:
        stage: The stage; its edit target is written.
        where: Path of the field.
        capture: The capture. The stage takes over its arrays: the caller must not use them
            afterwards.
        placed: Transformation from the capture's coordinates to the stage's.
        form: Storage form of the field, see `schema.author`.
        bake_axes: Transform the splats instead of authoring a transform op on the prim.
        time: Time code of a sample; None writes default values.

    Raises:
        UsdSplatError: As for `schema.author`.
    """
    define_ancestors(stage, where)
    if bake_axes and not placed.is_identity:
        _turn(capture.cloud, placed.matrix)
    prim = schema.author(
        stage,
        where,
        capture.cloud,
        form=form,
        time=time,
        color_space=capture.color_space,
        drawing=DrawingHints(rasterize_mode="antialiased" if capture.antialiased else "classic"),
    )
    set_op(prim, None if bake_axes else placed.matrix)
    schema.place_proxy(prim)
    set_default_prim(stage, where)
    return prim


def _turn(cloud: SplatCloud, matrix: F64) -> None:
    """Transform a cloud in place, so that it is not in memory twice."""
    arrays = {item.name: getattr(cloud, item.name) for item in fields(cloud)}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    for first in range(0, len(cloud), _BLOCK):
        rows = slice(first, first + _BLOCK)
        turned = edit.transform(SplatCloud(**{k: a[rows] for k, a in arrays.items()}), matrix)
        for name, array in arrays.items():
            array[rows] = getattr(turned, name)


def given_axes(capture: Capture) -> list[str]:
    """Return a note on axes that the caller has given."""
    if capture.frame_source != "given":
        return []
    return [f"the axes are {capture.frame!r} as given to the import"]


def missing_proxy(prim: Usd.Prim) -> list[str]:
    """Return a note if a packed field has no proxy points for renderers without its type."""
    if not schema.is_packed(prim) or prim.GetRelationship(schema.tokens.PROXY_PRIM).GetTargets():
        return []
    return [f"{prim.GetPath()} has no proxy points: a field has them only below another prim"]


def axes_text(placed: Placement, baked: bool) -> str:
    """Describe the change of axes in one sentence."""
    if placed.is_identity:
        return placed.text
    return placed.text + (" in the arrays" if baked else f" by {OP}")
