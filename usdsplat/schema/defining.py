"""Define prims of our types, with a colour space and a fallback for other applications."""

from __future__ import annotations

from pxr import Sdf, Usd, Vt

from usdsplat.core.errors import StageError
from usdsplat.schema import hints, tokens


def define(stage: Usd.Stage, path: str | Sdf.Path, type_name: str) -> Usd.Prim:
    """Return the prim at `path` with that type, defined or retyped as needed.

    Raises:
        StageError: If the prim is inside an instance.
    """
    prim = stage.GetPrimAtPath(path)
    if prim and (prim.IsInstanceProxy() or prim.IsInPrototype()):
        raise StageError(str(path), "a prim inside an instance", "a prim that can be edited")
    if not prim or not prim.IsDefined():
        prim = stage.DefinePrim(path, type_name)
    elif prim.GetTypeName() != type_name:
        prim = stage.OverridePrim(path)
        prim.SetTypeName(type_name)
    return prim


def author_fallback_type(stage: Usd.Stage, type_name: str) -> None:
    """Author fallbackPrimTypes, so that applications without our schema see the base type."""
    root = stage.GetEditTarget().GetLayer().pseudoRoot
    known = dict(root.GetInfo("fallbackPrimTypes") or {})
    known[type_name] = Vt.TokenArray([tokens.BASE_TYPE])
    root.SetInfo("fallbackPrimTypes", known)


def author_color_space(prim: Usd.Prim, name: str | None) -> None:
    """Write the given colour space, or the default if none is authored or inherited."""
    if name is None:
        if hints.written_color_space(prim):
            return
        name = tokens.DEFAULT_COLOR_SPACE
    api = Usd.ColorSpaceAPI.Apply(prim)
    api.CreateColorSpaceNameAttr(tokens.COLOR_SPACE_ALIASES.get(name, name))
