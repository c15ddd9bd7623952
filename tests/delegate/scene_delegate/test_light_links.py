"""Tests of findings on light linking."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdLux

from usdsplat.delegate.scene_delegate.light_links import findings_on_links
from usdsplat.products.checking import prim_findings

SUN = "/World/Sun"


def lit_stage(folder) -> Usd.Stage:
    """Make a stage of a sun, a ball and what is not loaded, and save it."""
    stage = Usd.Stage.CreateNew(str(folder / "lit.usda"))
    UsdLux.DistantLight.Define(stage, SUN)
    UsdGeom.Sphere.Define(stage, "/World/Ball")
    stage.DefinePrim("/World/Off").SetActive(False)
    stage.DefinePrim("/World/Heavy").GetPayloads().AddPayload("./heavy.usda")
    Usd.Stage.CreateNew(str(folder / "heavy.usda")).Save()
    stage.Save()
    return stage


def link(stage: Usd.Stage, name: str = "lightLink", *, root: bool | None = None, **targets):
    """Author a collection of the sun: `includes` and `excludes` are lists of paths."""
    collection = Usd.CollectionAPI.Apply(stage.GetPrimAtPath(SUN), name)
    if root is not None:
        collection.CreateIncludeRootAttr(root)
    for kind, paths in targets.items():
        stage.GetPrimAtPath(SUN).CreateRelationship(f"collection:{name}:{kind}").SetTargets(paths)


@pytest.mark.parametrize("name", ["lightLink", "shadowLink"])
@pytest.mark.parametrize("kind", ["includes", "excludes"])
def test_a_target_that_does_not_exist_is_a_finding(tmp_path, name, kind) -> None:
    """Oracle: the sentence, once, for the target without a prim."""
    stage = lit_stage(tmp_path)
    link(stage, name, root=False, **{kind: ["/World/Ball", "/World/Bal"]})
    found = [each for each in prim_findings(stage, None) if each.code == "unused"]
    assert [each.message for each in found] == [
        f"{SUN}.collection:{name}:{kind}: found /World/Bal, which does not exist, expected a prim"
    ]


def test_what_is_not_loaded_may_exist(tmp_path) -> None:
    """Oracle: prims below an inactive one, below a payload and outside of the mask are unknown;
    one with an existing parent is not."""
    lit_stage(tmp_path)
    mask = Usd.StagePopulationMask([SUN, "/World/Heavy", "/World/Off"])
    path = str(tmp_path / "lit.usda")
    stage = Usd.Stage.OpenMasked(path, mask, Usd.Stage.LoadNone)
    link(stage, includes=["/World/Heavy/A", "/World/Off/A", "/World/Ball", f"{SUN}/A"])
    found = list(findings_on_links(stage.GetPrimAtPath(SUN)))
    assert [each.found for each in found] == [f"{SUN}/A, which does not exist"]


def test_a_light_that_reaches_nothing_is_a_note(tmp_path) -> None:
    """Oracle: USD's rules of membership: the root, a target, or an expression are members."""
    stage = lit_stage(tmp_path)
    prim = stage.GetPrimAtPath(SUN)
    link(stage, "shadowLink", root=False)
    assert not list(findings_on_links(prim))
    link(stage, root=False)
    (found,) = findings_on_links(prim)
    assert (found.code, found.severity) == ("links-nothing", "note")
    assert found.message.startswith(f"{SUN}.collection:lightLink: found no members, expected")
    expression = prim.CreateAttribute(
        "collection:lightLink:membershipExpression", Sdf.ValueTypeNames.PathExpression
    )
    expression.Set(Sdf.PathExpression("/World/Ball"))
    assert not list(findings_on_links(prim))
    expression.Block()
    link(stage, includes=["/World/Ball"])
    assert not list(findings_on_links(prim))
    link(stage, root=True, includes=[])
    assert not list(findings_on_links(prim))
