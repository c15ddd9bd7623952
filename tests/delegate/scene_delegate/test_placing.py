"""Tests of transforms, visibility and purpose, compared with USD's own computations."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.delegate.stages import random_cloud
from usdsplat import schema
from usdsplat.delegate.engine import Engine


@pytest.fixture
def stage():
    stage = Usd.Stage.CreateInMemory()
    for path in ("/A", "/A/B"):
        UsdGeom.Xform.Define(stage, path)
    stage.DefinePrim("/A/B/Untyped")
    schema.author(stage, "/A/B/Untyped/Splats", random_cloud())
    return stage


def world_of(engine):
    ((_, _, seen),) = engine.render_scene.drawn()
    return np.reshape(seen.transform, (4, 4))


def test_any_affine_transform_arrives_exactly(stage):
    """Oracle: UsdGeom.Imageable.ComputeLocalToWorldTransform, transposed; mirrored and sheared."""
    rng = np.random.default_rng(1)
    for path in ("/A", "/A/B", "/A/B/Untyped/Splats"):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[3, :3] = rng.normal(size=(3, 3)), rng.normal(size=3)
        op = UsdGeom.Xformable(stage.GetPrimAtPath(path)).AddTransformOp()
        for time in (1, 2):
            op.Set(Gf.Matrix4d(time * matrix), time)
    prim = stage.GetPrimAtPath("/A/B/Untyped/Splats")
    for time in (1, 1.25, 2):
        with Engine(stage, time=time) as engine:
            expected = UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time)
            np.testing.assert_array_equal(world_of(engine), np.array(expected).T)


def test_a_reset_transform_stack_cuts_off_what_is_above(stage):
    """Oracle: the closed form: a reset prim stands in the world."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/A")).AddTranslateOp().Set((100, 0, 0))
    inner = UsdGeom.Xformable(stage.GetPrimAtPath("/A/B"))
    inner.AddTranslateOp().Set((0, 7, 0))
    with Engine(stage) as engine:
        np.testing.assert_array_equal(world_of(engine)[:3, 3], [100, 7, 0])
        inner.SetResetXformStack(True)
        np.testing.assert_array_equal(world_of(engine)[:3, 3], [0, 7, 0])
        UsdGeom.Xformable(stage.GetPrimAtPath("/A")).GetPrim().GetAttribute(
            "xformOp:translate"
        ).Set((5, 0, 0))
        np.testing.assert_array_equal(world_of(engine)[:3, 3], [0, 7, 0])


@pytest.mark.parametrize("hidden", ["/A", "/A/B", "/A/B/Untyped", "/A/B/Untyped/Splats"])
def test_visibility_is_usds(stage, hidden):
    """Oracle: UsdGeom.Imageable.ComputeVisibility, for whom untyped prims have none; animated."""
    prim = stage.GetPrimAtPath("/A/B/Untyped/Splats")
    attribute = UsdGeom.Imageable(stage.GetPrimAtPath(hidden)).CreateVisibilityAttr()
    attribute.Set("inherited", 1)
    attribute.Set("invisible", 2)
    with Engine(stage, time=1) as engine:
        for time in (1, 2, 1.5, 3):
            engine.set_time(time)
            visible = UsdGeom.Imageable(prim).ComputeVisibility(time) != "invisible"
            assert bool(engine.drawn_paths()) == visible


@pytest.mark.parametrize("owner", ["/A", "/A/B", "/A/B/Untyped", "/A/B/Untyped/Splats"])
@pytest.mark.parametrize("purpose", ["default", "render", "proxy", "guide"])
def test_purpose_is_usds(stage, owner, purpose):
    """Oracle: UsdGeom.Imageable.ComputePurpose."""
    UsdGeom.Imageable(stage.GetPrimAtPath("/A")).CreatePurposeAttr("guide")
    UsdGeom.Imageable(stage.GetPrimAtPath(owner)).CreatePurposeAttr(purpose)
    prim = stage.GetPrimAtPath("/A/B/Untyped/Splats")
    computed = UsdGeom.Imageable(prim).ComputePurpose()
    for wanted in ("default", "render", "proxy", "guide"):
        with Engine(stage, purposes=(wanted,)) as engine:
            assert bool(engine.drawn_paths()) == (wanted == computed)
