"""Tests of UsdGeomPoints, which are drawn as round splats."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import add_camera, contents
from usdsplat.core.sh import dc_to_rgb
from usdsplat.delegate.engine import Engine
from usdsplat.images.color import convert
from usdsplat.render.settings import RenderSettings


def stage_of(points=((0, 0, 0),), widths=(2.0,), color=None) -> tuple[Usd.Stage, UsdGeom.Points]:
    """A stage of points before a camera."""
    stage = Usd.Stage.CreateInMemory()
    add_camera(stage)
    prim = UsdGeom.Points.Define(stage, "/World/Points")
    prim.CreatePointsAttr(list(points))
    prim.CreateWidthsAttr(list(widths))
    if color is not None:
        prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([color])
    return stage, prim


def drawn(stage: Usd.Stage, **options):
    """The specs that an engine draws, by path."""
    with Engine(stage, **options) as engine:
        assert engine.findings == ()
        return {path: field.spec for path, field, _ in engine.render_scene.drawn()}


def test_a_point_is_half_transparent_at_its_radius() -> None:
    """Oracle: the Gaussian of the definition, exp(-ln 2 (d / r)^2), at pixels whose distance from
    the centre follows from similar triangles: 48 pixels for 1 unit at depth 1."""
    stage, _ = stage_of(color=(1, 1, 1))
    stage.GetPrimAtPath("/Camera").GetAttribute("xformOp:translate").Set((0, 0, 100))
    stage.GetPrimAtPath("/Camera").GetAttribute("focalLength").Set(2000)
    with Engine(stage) as engine:
        view = engine.view("/Camera", resolution=(65, 49))
        alpha = engine.picture(view, RenderSettings())["color"][..., 3]
    pixels = 65 * 2000 / 20 / 100  # of one unit
    for column in (40, 48, 52, 60):
        distance = (column - 32) / pixels
        assert alpha[24, column] == pytest.approx(math.exp(-math.log(2) * distance**2), abs=0.01)


def test_widths_colours_and_opacities_follow_their_interpolation() -> None:
    """Oracle: the values authored for each point; indices are resolved by hand."""
    stage, prim = stage_of(((0, 0, 0), (1, 0, 0), (2, 0, 0)), (1.0, 2.0, 4.0))
    colors = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    colors.Set([(1, 0, 0), (0, 0.25, 0)])
    colors.SetIndices(Vt.IntArray([1, 0, 1]))
    prim.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.constant).Set([0.5])
    prim.CreateIdsAttr([7, 8, 9])
    cloud = drawn(stage)["/World/Points"].cloud
    ratios = cloud.scales / cloud.scales[0]
    np.testing.assert_allclose(ratios, [[1] * 3, [2] * 3, [4] * 3], rtol=1e-6)
    np.testing.assert_array_equal(cloud.opacities, [0.5] * 3)
    np.testing.assert_array_equal(cloud.ids, [7, 8, 9])
    linear = np.array([(0, 0.25, 0), (1, 0, 0), (0, 0.25, 0)])
    expected = convert(linear, "lin_rec709_scene", "srgb_rec709_scene")
    np.testing.assert_allclose(dc_to_rgb(cloud.sh[:, 0]), expected, atol=1e-6)
    prim.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    prim.GetWidthsAttr().Set([3.0])
    assert np.ptp(drawn(stage)["/World/Points"].cloud.scales) == 0


def test_the_primvar_of_widths_has_precedence() -> None:
    """Oracle: the documentation of UsdGeomPoints; a blocked primvar has no value."""
    stage, prim = stage_of(((0, 0, 0), (1, 0, 0)), (8.0, 8.0))
    before = drawn(stage)["/World/Points"].cloud.scales
    widths = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
        "widths", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex
    )
    widths.Set([2.0, 4.0])
    scales = drawn(stage)["/World/Points"].cloud.scales
    np.testing.assert_allclose(scales, before * [[0.25], [0.5]], rtol=1e-6)
    widths.Set([2.0, 4.0], 1)
    widths.Set([4.0, 8.0], 2)
    with Engine(stage, time=1) as engine:
        engine.set_time(2)
        engine.sync()
        ((_, field, _),) = engine.render_scene.drawn()
        np.testing.assert_allclose(field.spec.cloud.scales, before * [[0.5], [1]], rtol=1e-6)
    widths.GetAttr().Block()
    np.testing.assert_array_equal(drawn(stage)["/World/Points"].cloud.scales, before)


def test_a_colour_may_be_inherited_and_in_another_space() -> None:
    """Oracle: USD's inheritance of constant primvars, and the identity from sRGB to sRGB."""
    stage, _ = stage_of()
    world = UsdGeom.PrimvarsAPI(stage.DefinePrim("/World", "Xform"))
    color = world.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray)
    color.Set([(0.25, 0.5, 0.75)])
    color.GetAttr().SetColorSpace("srgb_rec709_scene")
    cloud = drawn(stage)["/World/Points"].cloud
    np.testing.assert_allclose(dc_to_rgb(cloud.sh[:, 0]), [(0.25, 0.5, 0.75)], atol=1e-6)


def test_purpose_visibility_and_instances_are_as_for_fields() -> None:
    """Oracle: what each opinion means in UsdGeom."""
    stage, prim = stage_of()
    prim.CreatePurposeAttr("proxy")
    assert drawn(stage) == {}
    assert list(drawn(stage, purposes=("default", "proxy"))) == ["/World/Points"]
    prim.GetPurposeAttr().Set("default")
    prim.CreateVisibilityAttr("invisible")
    assert drawn(stage) == {}
    prim.GetVisibilityAttr().Set("inherited")
    for name in ("A", "B"):
        instance = stage.DefinePrim(f"/{name}", "Xform")
        instance.GetReferences().AddInternalReference("/World")
        instance.SetInstanceable(True)
    with Engine(stage) as engine:
        paths = [each.path for _, _, each in engine.render_scene.drawn()]
    assert paths == ["/A/Points", "/B/Points", "/World/Points"]


def test_points_move_with_their_samples_and_velocities() -> None:
    """Oracle: UsdGeomPointBased's own ComputePointsAtTime."""
    stage, prim = stage_of()
    stage.SetTimeCodesPerSecond(24)
    points, velocities = prim.GetPointsAttr(), prim.CreateVelocitiesAttr()
    for time in (1, 5):
        points.Set([(time, 0, 0)], time)
        velocities.Set([(0, 24, 0)], time)
    with Engine(stage, time=1) as engine:
        for time in (1, 3, 5, 6.5):
            engine.set_time(time)
            engine.sync()
            ((_, field, _),) = engine.render_scene.drawn()
            expected = prim.ComputePointsAtTime(Usd.TimeCode(time), Usd.TimeCode(time))
            np.testing.assert_allclose(field.spec.cloud.positions, expected, atol=1e-5)


def test_edits_are_drawn_as_by_a_fresh_engine() -> None:
    """Oracle: a fresh engine of the edited stage, bit for bit; a clean sync pulls nothing."""
    stage, prim = stage_of(((0, 0, 0), (1, 0, 0)), (1.0, 2.0), color=(1, 0, 0))
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    inherited = UsdGeom.PrimvarsAPI(world)
    opacity = Sdf.ValueTypeNames.FloatArray
    edits = (
        lambda: prim.GetPointsAttr().Set([(0, 1, 0), (1, 0, 1)]),
        lambda: prim.GetWidthsAttr().Set([0.5, 0.25]),
        lambda: prim.GetDisplayColorPrimvar().Set([(0, 1, 0.5)]),
        lambda: UsdGeom.PrimvarsAPI(prim).CreatePrimvar("widths", opacity).Set([0.75]),
        lambda: UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths").Set([0.125]),
        lambda: UsdGeom.PrimvarsAPI(prim).RemovePrimvar("widths"),
        lambda: inherited.CreatePrimvar("displayOpacity", opacity).Set([0.5]),
        lambda: prim.CreateVelocitiesAttr().Set([(1, 0, 0), (0, 1, 0)]),
        lambda: UsdGeom.XformCommonAPI(world).SetTranslate(Gf.Vec3d(1, 2, 3)),
    )
    with Engine(stage) as engine:
        for edit in edits:
            edit()
            with Engine(stage) as fresh:
                assert contents(engine) == contents(fresh)
            before = engine.pulls.copy() if hasattr(engine, "pulls") else None
            engine.sync()
            assert before is None or engine.pulls == before


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("points", [(float("nan"), 0, 0)]),
        ("widths", [-1.0]),
        ("primvars:widths", [-1.0]),
        ("primvars:displayColor", [(float("inf"), 0, 0)]),
    ],
)
def test_points_that_cannot_be_drawn_are_a_finding(name, value) -> None:
    """Oracle: the code, and the attribute that the sentence names."""
    stage, prim = stage_of(color=(1, 1, 1))
    if name == "primvars:widths":
        UsdGeom.PrimvarsAPI(prim).CreatePrimvar("widths", Sdf.ValueTypeNames.FloatArray)
    prim.GetPrim().GetAttribute(name).Set(value)
    with Engine(stage) as engine:
        (found,) = engine.findings
    assert (found.code, found.path, found.attribute) == ("not-drawn", "/World/Points", name)
