"""Tests of proxy points for renderers without the packed type."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.sh import C0
from usdsplat.schema import proxy, tokens


def points(prim: Usd.Prim) -> UsdGeom.Points:
    """The proxy of a packed field."""
    return UsdGeom.Points(prim.GetChild(tokens.PROXY_CHILD))


def test_other_renderers_find_points_of_purpose_proxy(stage: Usd.Stage) -> None:
    """Oracle: USD's purposes and the proxyPrim relationship."""
    prim = schema.author(stage, "/Splats", cloud(n=20), form="packed")
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
    found = points(schema.author(stage, "/Splats", source, form="packed"))
    primvar = found.GetDisplayColorPrimvar()
    assert primvar.GetInterpolation() == "vertex"
    np.testing.assert_allclose(primvar.Get(), [[0.5] * 3, [0.5 + C0, 0, 1]], atol=1e-6)


def test_a_large_field_has_few_points(stage: Usd.Stage) -> None:
    """Oracle: the promised number, each a centre of the field, inside USD's bound."""
    source = cloud(n=proxy.MAX_POINTS * 2 + 1, degree=0)
    prim = schema.author(stage, "/Splats", source, form="packed")
    found = np.asarray(points(prim).GetPointsAttr().Get())
    assert proxy.MAX_POINTS / 2 < len(found) <= proxy.MAX_POINTS
    np.testing.assert_array_equal(found, source.positions[::3])
    bound = UsdGeom.BBoxCache(0, ["proxy"]).ComputeWorldBound(points(prim).GetPrim()).GetRange()
    assert (found >= np.array(bound.GetMin())).all()
    assert (found <= np.array(bound.GetMax())).all()


def test_a_purpose_that_somebody_chose_stays(stage: Usd.Stage) -> None:
    """Oracle: the authored value."""
    prim = stage.DefinePrim("/Splats", tokens.STOCK_TYPE)
    UsdGeom.Imageable(prim).CreatePurposeAttr("guide")
    schema.author(stage, "/Splats", cloud(), form="packed")
    assert UsdGeom.Imageable(prim).GetPurposeAttr().Get() == "guide"


def test_an_empty_field_has_an_empty_proxy(stage: Usd.Stage) -> None:
    """Oracle: the counts."""
    prim = schema.author(stage, "/Splats", cloud(n=0), form="packed")
    assert len(points(prim).GetPointsAttr().Get()) == 0


@pytest.mark.parametrize("time", [None, 4.0])
def test_the_proxy_moves_with_the_field(stage: Usd.Stage, time: float | None) -> None:
    """Oracle: the centres at that time."""
    prim = schema.author(stage, "/Splats", cloud(3), form="packed", time=time)
    found = points(prim).GetPointsAttr().Get(Usd.TimeCode(4))
    np.testing.assert_array_equal(np.asarray(found), cloud(3).positions)
