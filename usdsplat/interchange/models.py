"""Author the model prim above an imported field: kind, asset information and bounds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pxr import Kind, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.core.text import shown
from usdsplat.schema.stage_values import extents_hint

FIELD = "splats"
"""Name of the field below its model."""

_HINT = UsdGeom.Tokens.extentsHint


def author_model(field: Usd.Prim, target: Path | None) -> None:
    """Make the prim above a field a model: kind, assetInfo and extentsHint.

    The kind is component, or subcomponent if the prim is part of a component.

    Args:
        field: The field.
        target: File that the stage is saved to, which becomes the asset's identifier; None for a
            stage that is not an asset of its own.
    """
    prim = field.GetParent()
    model = Usd.ModelAPI(prim)
    is_part = any(_is_component(each) for each in _above(prim))
    model.SetKind(Kind.Tokens.subcomponent if is_part else Kind.Tokens.component)
    model.SetAssetName(prim.GetName())
    if target is not None:
        model.SetAssetIdentifier(Sdf.AssetPath(f"./{shown(target.name)}"))
    if not prim.HasAPI(UsdGeom.ModelAPI):
        author_extents(field)


def author_extents(field: Usd.Prim, time: float | None = None) -> None:
    """Author the bounds of the prim above a field for each purpose: USD's extentsHint.

    Args:
        field: The field.
        time: Time code of a sample; None writes the default value.
    """
    _author(UsdGeom.ModelAPI.Apply(field.GetParent()), _code(time))


def update_extents(field: Usd.Prim) -> None:
    """Compute the authored bounds of all models above a field again, after its splats changed."""
    for prim in _above(field):
        attribute = prim.GetAttribute(_HINT)
        if not attribute or not attribute.HasAuthoredValue():
            continue
        times = attribute.GetTimeSamples()
        if times or not schema.is_time_varying(field):
            for time in times or (None,):
                _author(UsdGeom.ModelAPI(prim), _code(time))


def _author(model: UsdGeom.ModelAPI, code: Usd.TimeCode) -> None:
    """Author extentsHint at a time."""
    cache = UsdGeom.BBoxCache(code, [UsdGeom.Tokens.default_])
    with suppress(StageError):  # such a prim is not drawn either, and is reported there
        model.SetExtentsHint(extents_hint(model, cache), code)


def _code(time: float | None) -> Usd.TimeCode:
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)


def _above(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield the ancestors of a prim, the nearest first."""
    while (prim := prim.GetParent()) and not prim.IsPseudoRoot():
        yield prim


def _is_component(prim: Usd.Prim) -> bool:
    """Return whether a prim's kind is component, or derived from it."""
    kind = Usd.ModelAPI(prim).GetKind()
    return bool(kind) and bool(Kind.Registry.IsA(kind, Kind.Tokens.component))
