"""Tests of light groups on the stage: which attributes name them, edits, and RenderVars."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender

from usdsplat.delegate.engine import Engine

KEY, FILL = "/World/Lights/Key", "/World/Lights/Fill"
TYPES = Sdf.ValueTypeNames


@pytest.fixture
def stage():
    """A square under two suns of one group of prims."""
    made = Usd.Stage.CreateInMemory()
    ground = UsdGeom.Mesh.Define(made, "/World/Ground")
    ground.CreatePointsAttr([(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)])
    ground.CreateFaceVertexCountsAttr([4])
    ground.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    for path, strength in ((KEY, 2.0), (FILL, 0.5)):
        light = UsdLux.DistantLight.Define(made, path)
        light.CreateIntensityAttr(strength)
        light.CreateAngleAttr(0.0)
        light.AddRotateXYZOp().Set((-90, 0, 0))
    camera = UsdGeom.Camera.Define(made, "/World/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 4, 0))
    camera.AddRotateXYZOp().Set((-90, 0, 0))
    return made


def named(stage, path, group, attribute="primvars:lightGroup", kind=TYPES.Token):
    """Name the group of a prim."""
    stage.GetPrimAtPath(path).CreateAttribute(attribute, kind).Set(group)


def lights(stage):
    """AOVs of the groups."""
    with Engine(stage, device="cpu") as engine:
        return engine.stage_info().lights


def test_lights_without_a_group_are_the_default(stage):
    """Oracle: the names."""
    assert lights(stage) == ("light_default", "light_captured")
    named(stage, KEY, "key")
    assert lights(stage) == ("light_default", "light_key", "light_captured")


def test_a_prim_above_names_the_group_of_its_lights(stage):
    """Oracle: USD's inheritance of primvars; a light's own name counts first."""
    named(stage, "/World/Lights", "rig")
    assert lights(stage) == ("light_rig", "light_captured")
    named(stage, KEY, "key")
    assert lights(stage) == ("light_key", "light_rig", "light_captured")


@pytest.mark.parametrize(
    "attribute",
    [
        "inputs:karma:light:lpetag", "karma:light:lpetag", "primvars:arnold:aov",
        "inputs:ri:light:lightGroup",
    ],
)  # fmt: skip
def test_attributes_of_other_renderers_are_read_where_ours_is_missing(stage, attribute):
    """Oracle: the names that Karma, Arnold and RenderMan document."""
    named(stage, KEY, "theirs", attribute, TYPES.String)
    assert "light_theirs" in lights(stage)
    named(stage, KEY, "ours")
    assert lights(stage) == ("light_default", "light_ours", "light_captured")


def test_a_light_that_never_shines_has_no_group(stage):
    """Oracle: the names; one that is hidden at some times has, so that all frames have the same."""
    named(stage, KEY, "key")
    visibility = UsdGeom.Imageable(stage.GetPrimAtPath(KEY)).CreateVisibilityAttr("invisible")
    assert lights(stage) == ("light_default", "light_captured")
    visibility.Set("invisible", 1)
    visibility.Set("inherited", 2)
    assert lights(stage) == ("light_default", "light_key", "light_captured")


def test_an_edited_group_moves_light_to_another_part(stage):
    """Oracle: Lambert's law for the light of each part, before and after."""
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/World/Camera", resolution=(8, 8))
        names = ("light_default", "light_rig")

        def parts():
            found = engine.picture(view, aovs=names)
            return [float(found[name][4, 4, 0]) for name in names]

        albedo = 0.18 / np.pi
        np.testing.assert_allclose(parts(), [2.5 * albedo, 0.0], rtol=1e-5)
        named(stage, "/World/Lights", "rig")
        np.testing.assert_allclose(parts(), [0.0, 2.5 * albedo], rtol=1e-5)
        named(stage, KEY, "default")
        np.testing.assert_allclose(parts(), [2 * albedo, 0.5 * albedo], rtol=1e-5)


def test_render_vars_ask_for_light_groups_by_name_and_by_light_path(stage):
    """Oracle: the product's AOVs, and a finding on a group without lights."""
    named(stage, KEY, "key")
    product = UsdRender.Product.Define(stage, "/Render/Product")
    sources = ("color", "irradiance", "light_key", "C.*<L.'default'>", "light_rim", "C.*<L.'rim'>")
    for k, source in enumerate(sources):
        var = UsdRender.Var.Define(stage, f"/Render/Var{k}")
        var.CreateSourceNameAttr(source)
        product.CreateOrderedVarsRel().AddTarget(var.GetPath())
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateProductsRel().AddTarget(product.GetPath())
    with Engine(stage, device="cpu") as engine:
        (found,) = engine.products()
    assert found.aovs == ("color", "irradiance", "light_key", "light_default")
    assert [each.code for each in found.findings] == ["unknown-var"] * 2
    assert "light_default, light_key, light_captured" in found.findings[0].message
