"""Find the material that is bound to a prim."""

from __future__ import annotations

from pxr import Usd, UsdShade

BINDING = "material:binding"
"""Prefix of relationships that bind materials."""
PURPOSES = (UsdShade.Tokens.preview, UsdShade.Tokens.full)
"""Binding purposes in order; each also finds bindings for all purposes."""


def computed_material(prim: Usd.Prim) -> Usd.Prim | None:
    """Return the material bound to a prim, or None."""
    for purpose in PURPOSES:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(purpose)
        if material:
            return material.GetPrim()
    return None
