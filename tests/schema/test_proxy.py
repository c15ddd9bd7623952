"""Tests of proxy points for renderers without the packed type."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdValidation

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.sh import C0
from usdsplat.schema import proxy, tokens


def points(prim: Usd.Prim) -> UsdGeom.Points:
    """The proxy of a packed field."""
    return UsdGeom.Points(prim.GetStage().GetPrimAtPath(f"{prim.GetPath()}_proxy"))


def test_other_renderers_find_points_of_purpose_proxy(stage: Usd.Stage) -> None:
    """Oracle: USD's purposes and the proxyPrim relationship."""
    prim = schema.author(stage, "/World/Splats", cloud(n=20), form="packed")
    found = points(prim)
    assert found.GetPurposeAttr().Get() == "proxy"
    assert UsdGeom.Imageable(prim).ComputePurpose() == "render"
    assert UsdGeom.Imageable(prim).ComputeProxyPrim()[0] == found.GetPrim()
    assert len(found.GetPointsAttr().Get()) == 20
    assert stage.GetRootLayer().pseudoRoot.GetInfo("fallbackPrimTypes") == {
        tokens.PACKED_TYPE: [tokens.BASE_TYPE]
    }


def test_colours_are_those_of_degree_zero(stage: Usd.Stage) -> None:
    """Oracle: 0.5 + C0 times the coefficient, within what a display shows."""
    source = replace(cloud(n=2), sh=np.zeros((2, 1, 3), np.float32))
    source.sh[1] = (1, -9, 9)
    found = points(schema.author(stage, "/World/Splats", source, form="packed"))
    primvar = found.GetDisplayColorPrimvar()
    assert primvar.GetInterpolation() == "vertex"
    np.testing.assert_allclose(primvar.Get(), [[0.5] * 3, [0.5 + C0, 0, 1]], atol=1e-6)


def test_a_large_field_has_few_points(stage: Usd.Stage) -> None:
    """Oracle: the promised number, each a centre of the field, inside USD's bound."""
    source = cloud(n=proxy.MAX_POINTS * 2 + 1, degree=0)
    prim = schema.author(stage, "/World/Splats", source, form="packed")
    found = np.asarray(points(prim).GetPointsAttr().Get())
    assert proxy.MAX_POINTS / 2 < len(found) <= proxy.MAX_POINTS
    np.testing.assert_array_equal(found, source.positions[::3])
    bound = UsdGeom.BBoxCache(0, ["proxy"]).ComputeWorldBound(points(prim).GetPrim()).GetRange()
    assert (found >= np.array(bound.GetMin())).all()
    assert (found <= np.array(bound.GetMax())).all()


def test_a_purpose_that_somebody_chose_stays(stage: Usd.Stage) -> None:
    """Oracle: the authored value."""
    prim = stage.DefinePrim("/World/Splats", tokens.STOCK_TYPE)
    UsdGeom.Imageable(prim).CreatePurposeAttr("guide")
    schema.author(stage, "/World/Splats", cloud(), form="packed")
    assert UsdGeom.Imageable(prim).GetPurposeAttr().Get() == "guide"


def test_an_empty_field_has_an_empty_proxy(stage: Usd.Stage) -> None:
    """Oracle: the counts."""
    prim = schema.author(stage, "/World/Splats", cloud(n=0), form="packed")
    assert len(points(prim).GetPointsAttr().Get()) == 0


@pytest.mark.parametrize("time", [None, 4.0])
def test_the_proxy_moves_with_the_field(stage: Usd.Stage, time: float | None) -> None:
    """Oracle: the centres at that time."""
    prim = schema.author(stage, "/World/Splats", cloud(3), form="packed", time=time)
    found = points(prim).GetPointsAttr().Get(Usd.TimeCode(4))
    np.testing.assert_array_equal(np.asarray(found), cloud(3).positions)


def test_no_prim_of_a_packed_field_is_below_another(stage: Usd.Stage) -> None:
    """Oracle: USD's rule that a Gprim has no Gprim below it, by its own validators."""
    schema.author(stage, "/World/Splats", cloud(n=20), form="packed")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert UsdValidation.ValidationContext(validators).Validate(stage) == []
    bound = UsdGeom.BBoxCache(0, ["default", "proxy"]).ComputeWorldBound(stage.GetDefaultPrim())
    assert not bound.GetRange().IsEmpty()


def test_a_field_at_the_root_has_no_proxy(stage: Usd.Stage) -> None:
    """Oracle: a reference to the field, which would not include a prim beside it."""
    prim = schema.author(stage, "/Splats", cloud(), form="packed")
    assert [each.GetName() for each in stage.GetPseudoRoot().GetChildren()] == ["Splats"]
    assert not prim.GetRelationship("proxyPrim").GetTargets()
    assert UsdGeom.Imageable(prim).ComputePurpose() == "default"


def test_the_name_of_another_prim_is_left_alone(stage: Usd.Stage) -> None:
    """Oracle: the prim that was there, and the name with a number, also when authored again."""
    UsdGeom.Cube.Define(stage, "/World/Splats_proxy")
    for seed in (1, 2):
        prim = schema.author(stage, "/World/Splats", cloud(seed), form="packed")
    assert stage.GetPrimAtPath("/World/Splats_proxy").GetTypeName() == "Cube"
    assert prim.GetRelationship("proxyPrim").GetTargets() == ["/World/Splats_proxy_1"]
    assert len(stage.GetPrimAtPath("/World").GetChildren()) == 3


def test_the_proxy_lies_where_the_field_lies(stage: Usd.Stage) -> None:
    """Oracle: USD's local transformations at several times, and visibility; changed, then gone."""
    prim = stage.DefinePrim("/World/Splats", tokens.STOCK_TYPE)
    xformable = UsdGeom.Xformable(prim)
    move = xformable.AddTranslateOp()
    move.Set((1, 2, 3), 1)
    move.Set((5, 2, 3), 2)
    xformable.AddRotateXOp().Set(30)
    xformable.AddTranslateOp(isInverseOp=True)
    UsdGeom.Imageable(prim).CreateVisibilityAttr("invisible")
    schema.author(stage, "/World/Splats", cloud(), form="packed")
    found = points(prim)

    def places(what: UsdGeom.Xformable) -> list[object]:
        return [what.GetLocalTransformation(t) for t in (Usd.TimeCode.Default(), 1, 1.5, 2)]

    assert places(found) == places(xformable)
    assert found.GetVisibilityAttr().Get() == "invisible"
    xformable.ClearXformOpOrder()
    xformable.AddScaleOp().Set((2, 2, 2))
    schema.place_proxy(prim)
    assert places(found) == places(xformable)
    xformable.ClearXformOpOrder()
    prim.RemoveProperty("xformOpOrder")
    prim.RemoveProperty("visibility")
    schema.place_proxy(prim)
    assert places(found) == places(xformable)
    assert found.GetVisibilityAttr().Get() == "inherited"


def below(stage: Usd.Stage) -> Usd.Prim:
    """A packed field with its proxy below it, as 0.6 wrote it."""
    prim = schema.author(stage, "/World/Splats", cloud(1), form="packed")
    layer = stage.GetEditTarget().GetLayer()
    Sdf.CopySpec(layer, "/World/Splats_proxy", layer, "/World/Splats/proxy")
    stage.RemovePrim("/World/Splats_proxy")
    prim.GetRelationship("proxyPrim").SetTargets(["/World/Splats/proxy"])
    return prim


@pytest.mark.parametrize("how", ["author", "settle"])
def test_a_proxy_of_0_6_moves_beside_its_field(stage: Usd.Stage, how: str) -> None:
    """Oracle: the prims, and the points' centres."""
    prim = below(stage)
    if how == "author":
        schema.author(stage, "/World/Splats", cloud(1), form="packed")
    else:
        schema.settle_proxy(prim)
    assert not prim.GetChildren()
    assert prim.GetRelationship("proxyPrim").GetTargets() == ["/World/Splats_proxy"]
    np.testing.assert_array_equal(points(prim).GetPointsAttr().Get(), cloud(1).positions)
    assert UsdGeom.Imageable(prim).ComputePurpose() == "render"


def test_a_proxy_of_0_6_in_a_weaker_layer_is_switched_off(stage: Usd.Stage) -> None:
    """Oracle: the prims that the stage composes, with and without the stronger layer."""
    prim = below(stage)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        schema.author(stage, "/World/Splats", cloud(2), form="packed")
        assert not prim.GetChildren()
        np.testing.assert_array_equal(points(prim).GetPointsAttr().Get(), cloud(2).positions)
    stage.GetSessionLayer().Clear()
    assert [str(each.GetPath()) for each in prim.GetChildren()] == ["/World/Splats/proxy"]
    assert not points(prim)


@pytest.mark.parametrize("old", [False, True])
def test_a_field_that_becomes_a_stock_one_has_no_proxy(stage: Usd.Stage, old: bool) -> None:
    """Oracle: the prims and properties."""
    make = below if old else lambda on: schema.author(on, "/World/Splats", cloud(), form="packed")
    prim = make(stage)
    schema.author(stage, "/World/Splats", cloud())
    assert stage.GetPrimAtPath("/World").GetChildren() == [prim] and not prim.GetChildren()
    assert (
        not prim.HasRelationship("proxyPrim")
        or not prim.GetRelationship("proxyPrim").HasAuthoredTargets()
    )
    assert UsdGeom.Imageable(prim).ComputePurpose() == "default"
