"""Tests of bakes of the packed type."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.schema.clouds import angles
from tests.sim.stage.bakes import PATH, shot
from usdsplat import schema
from usdsplat.schema import packing, tokens


@pytest.mark.parametrize("form", ["float", "packed"])
@pytest.mark.parametrize("lives", [True, False], ids=["births", "fixed"])
def test_every_sample_is_the_state_within_the_layouts_bounds(
    tmp_path: Path, form: str, lives: bool
) -> None:
    """Oracle: the solver's arrays, and the bounds that the layout promises."""
    bake = shot(tmp_path, "packed", form=form, lives=lives)
    stage = Usd.Stage.Open(str(bake.run()))
    prim = stage.GetPrimAtPath(PATH)
    assert prim.GetTypeName() == tokens.PACKED_TYPE
    for frame in bake.frames[PATH]:
        found, cloud = schema.fetch(prim, frame.time), frame.cloud
        at = np.searchsorted(found.ids, cloud.ids)
        np.testing.assert_array_equal(found.ids[at], cloud.ids)
        np.testing.assert_array_equal(found.positions[at], cloud.positions)
        np.testing.assert_allclose(found.scales[at], cloud.scales, rtol=packing.SCALE_ERROR * 1.01)
        np.testing.assert_allclose(found.opacities[at], cloud.opacities, atol=1 / 1022 + 1e-6)
        assert angles(found.rotations[at], cloud.rotations).max() <= packing.ROTATION_ERROR
        spread = np.ptp(cloud.sh[:, 0], axis=0).max() / 510 + np.abs(cloud.sh[:, 1:]).max() / 254
        np.testing.assert_allclose(found.sh[at], cloud.sh, atol=2 * spread)


def test_harmonics_that_do_not_change_are_packed_once_an_epoch(tmp_path: Path) -> None:
    """Oracle: the capture's harmonics at every frame; samples where epochs begin and as they end
    with the population."""
    writes = frozenset({"positions", "rotations"})
    bake = shot(tmp_path, "packed", lives=False, writes=writes)
    solvers = bake.solvers
    read = schema.fetch(bake.stage.GetPrimAtPath(PATH))
    target = bake.run()
    stage = Usd.Stage.Open(str(target))
    prim = stage.GetPrimAtPath(PATH)
    codes = [np.asarray(prim.GetAttribute(tokens.PACKED_HARMONICS).Get(t)) for t in bake.times]
    assert all(np.array_equal(code, codes[0]) for code in codes)
    expected = packing.pack(read).harmonics
    np.testing.assert_array_equal(codes[0], expected)
    assert solvers()[PATH].lives is False


def test_others_see_points_and_a_base_type(tmp_path: Path) -> None:
    """Oracle: the stage's fallback types, the proxy's points and purposes."""
    bake = shot(tmp_path, "packed", lives=False)
    stage = Usd.Stage.Open(str(bake.run()))
    known = stage.GetRootLayer().pseudoRoot.GetInfo("fallbackPrimTypes")
    assert list(known[tokens.PACKED_TYPE]) == [tokens.BASE_TYPE]
    prim = stage.GetPrimAtPath(PATH)
    child = stage.GetPrimAtPath(f"{PATH}_proxy")
    assert UsdGeom.Imageable(child).ComputePurpose() == "proxy"
    assert UsdGeom.Imageable(prim).ComputePurpose() == "render"
    assert prim.GetRelationship("proxyPrim").GetTargets() == [child.GetPath()]
    for frame in bake.frames[PATH]:
        points = np.asarray(UsdGeom.Points(child).GetPointsAttr().Get(frame.time))
        np.testing.assert_array_equal(points, frame.cloud.positions)


def test_a_purpose_of_the_capture_stays(tmp_path: Path) -> None:
    """Oracle: the capture's own."""
    bake = shot(tmp_path, "packed", lives=False)
    UsdGeom.Imageable(bake.stage.GetPrimAtPath("/World")).CreatePurposeAttr("guide")
    bake.stage.Save()
    stage = Usd.Stage.Open(str(bake.run()))
    assert UsdGeom.Imageable(stage.GetPrimAtPath(PATH)).ComputePurpose() == "guide"


@pytest.mark.parametrize(("form", "mode"), [("float", "packed"), ("packed", "dense")])
def test_without_a_time_it_is_the_first_sample(tmp_path: Path, form: str, mode: str) -> None:
    """Oracle: the first frame: the capture's default values belong to another type."""
    bake = shot(tmp_path, mode, form=form, lives=False)
    stage = Usd.Stage.Open(str(bake.run()))
    found = schema.fetch(stage.GetPrimAtPath(PATH))
    first = schema.fetch(stage.GetPrimAtPath(PATH), 1.0)
    for name in ("positions", "rotations", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(first, name))


@pytest.mark.parametrize("form", ["float", "packed"])
def test_the_proxy_lies_where_the_field_lies_and_goes_with_the_bake(tmp_path, form: str) -> None:
    """Oracle: USD's world matrices of a field that moves; the capture's prims once muted."""
    bake = shot(tmp_path, "packed", form=form, lives=False)
    move = UsdGeom.Xformable(bake.stage.GetPrimAtPath(PATH)).AddTranslateOp()
    move.Set((1, 0, 0), 1)
    move.Set((4, 0, 0), 4)
    bake.stage.Save()
    before = [prim.GetPath() for prim in bake.stage.Traverse()]
    stage = Usd.Stage.Open(str(bake.run()))
    prim, points = (stage.GetPrimAtPath(PATH + end) for end in ("", "_proxy"))
    for time in (1, 2.5, 4):
        places = UsdGeom.XformCache(time)
        world = [places.GetLocalToWorldTransform(each) for each in (prim, points)]
        assert world[0] == world[1] == Gf.Matrix4d().SetTranslate((time, 0, 0))
    results = stage.GetRootLayer().subLayerPaths[0]
    stage.MuteLayer(stage.GetRootLayer().ComputeAbsolutePath(results))
    assert [each.GetPath() for each in stage.Traverse()] == before


def test_a_bake_over_a_packed_field_of_0_6_switches_its_proxy_off(tmp_path: Path) -> None:
    """Oracle: the prims; of the proxy that 0.6 wrote below the field, muting brings back."""
    bake = shot(tmp_path, "packed", form="packed", lives=False)
    layer = bake.stage.GetRootLayer()
    Sdf.CopySpec(layer, f"{PATH}_proxy", layer, f"{PATH}/proxy")
    bake.stage.RemovePrim(f"{PATH}_proxy")
    bake.stage.GetPrimAtPath(PATH).GetRelationship("proxyPrim").SetTargets([f"{PATH}/proxy"])
    bake.stage.Save()
    stage = Usd.Stage.Open(str(bake.run()))
    prim = stage.GetPrimAtPath(PATH)
    assert not prim.GetChildren()
    assert prim.GetRelationship("proxyPrim").GetTargets() == [f"{PATH}_proxy"]
    stage.MuteLayer(layer.ComputeAbsolutePath(stage.GetRootLayer().subLayerPaths[0]))
    assert [each.GetName() for each in prim.GetChildren()] == ["proxy"]
    assert not stage.GetPrimAtPath(f"{PATH}_proxy")
