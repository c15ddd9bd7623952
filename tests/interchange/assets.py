"""Stages with variants for tests of converting fields in place."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema

ASSET = """#usda 1.0
(
    defaultPrim = "T"
    upAxis = "Y"
    metersPerUnit = 1
)
def Xform "T" (
    kind = "component"
    assetInfo = {
        string name = "tree"
        string version = "7"
    }
    prepend references = @./field.usdc@
    variants = {
        string season = "summer"
    }
    prepend variantSets = "season"
) {
    variantSet "season" = {
        "summer" {
            over "F" {
                float[] opacities = [0.5, 0.25, 1]
            }
        }
        "winter" {
            over "F" {
                float[] opacities = [0.125, 0, 0.75]
            }
        }
        "none" {
            over "F" (
                active = false
            ) {
            }
        }
    }
}
"""


def asset(folder: Path) -> Path:
    """An asset of three splats by reference, whose opacities depend on a variant."""
    stage = Usd.Stage.CreateNew(str(folder / "field.usdc"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/T").GetPrim())
    schema.author(stage, "/T/F", cloud(n=3))
    stage.Save()
    path = folder / "asset.usda"
    path.write_text(ASSET)
    return path


OPEN: list[Usd.Stage] = []


def opened(path: Path) -> Usd.Stage:
    """The stage of a file, which stays open."""
    OPEN.append(Usd.Stage.Open(str(path)))
    return OPEN[-1]


def selected(path: Path, where: str, **variants: str) -> Usd.Stage:
    """The stage of a file with variants selected in the session layer."""
    stage = opened(path)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for name, variant in variants.items():
            stage.GetPrimAtPath(where).GetVariantSet(name).SetVariantSelection(variant)
    return stage
