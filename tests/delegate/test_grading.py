"""Tests of grades, from the stage to the picture."""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd

from tests.delegate.stages import add_camera, random_cloud
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.grade import Grade
from usdsplat.core.sh import C0
from usdsplat.delegate.engine import Engine
from usdsplat.images.color import convert
from usdsplat.images.grade import grade_matrix
from usdsplat.render.settings import RenderSettings

GREY = (0.5, 0.4, 0.3)


def wall(color: tuple[float, float, float] = GREY) -> SplatCloud:
    """One opaque splat that fills the view, of one colour."""
    sh = (np.array(color) - 0.5) / C0
    return SplatCloud(
        positions=np.zeros((1, 3), np.float32),
        scales=np.array([[100, 100, 0.001]], np.float32),
        rotations=np.array([[1, 0, 0, 0]], np.float32),
        opacities=np.ones(1, np.float32),
        sh=sh.reshape(1, 1, 3).astype(np.float32),
    )


def middle(engine: Engine, mode: str = "display") -> np.ndarray:
    """The straight colour in the middle of the picture."""
    view = engine.view("/Camera", resolution=(9, 7))
    pixel = engine.picture(view, RenderSettings(color_mode=mode))["color"][3, 4]
    assert pixel[3] > 0.99
    return pixel[:3] / pixel[3]


def stage_with(**grade: object) -> Usd.Stage:
    """A wall with a grade, before a camera."""
    stage = Usd.Stage.CreateInMemory()
    schema.author_grade(schema.author(stage, "/Splats", wall()), **grade)
    add_camera(stage)
    return stage


def expected(space: str, **grade: object) -> np.ndarray:
    """The wall's colour, graded, in plain NumPy."""
    linear = convert(GREY, "srgb_rec709_scene", "lin_rec709_scene")
    matrix = np.reshape(grade_matrix(Grade(**grade), "lin_rec709_scene"), (3, 3))
    return convert(matrix @ linear, "lin_rec709_scene", space)


def test_a_grade_changes_linear_light_in_either_mode() -> None:
    """Oracle: the grade's matrix between `convert`s, in NumPy."""
    grade = {"exposure": 0.5, "temperature": 5200.0, "saturation": 0.8, "gain": (1.1, 1.0, 0.9)}
    with Engine(stage_with(**grade)) as engine:
        np.testing.assert_allclose(
            middle(engine), expected("srgb_rec709_scene", **grade), atol=1e-4
        )
        np.testing.assert_allclose(
            middle(engine, "scene"), expected("lin_rec709_scene", **grade), atol=1e-4
        )


def test_an_edit_of_the_grade_is_seen() -> None:
    """Oracle: a fresh engine of the edited stage, bit for bit."""
    stage = stage_with(exposure=0.0)
    prim = stage.GetPrimAtPath("/Splats")
    with Engine(stage) as engine:
        before = middle(engine)
        for values in ({"exposure": 1.0}, {"tint": 0.02}, {"matrix": (0, 1, 0, 1, 0, 0, 0, 0, 1)}):
            schema.author_grade(prim, **values)
            after = middle(engine)
            assert not np.array_equal(after, before)
            with Engine(stage) as fresh:
                np.testing.assert_array_equal(middle(fresh), after)
            before = after


def test_an_animated_grade_follows_the_time() -> None:
    """Oracle: the interpolated exposure, in NumPy."""
    stage = stage_with()
    prim = stage.GetPrimAtPath("/Splats")
    schema.author_grade(prim, time=1.0, exposure=0.0)
    schema.author_grade(prim, time=3.0, exposure=-2.0)
    with Engine(stage, time=1.0) as engine:
        np.testing.assert_allclose(middle(engine), GREY, atol=1e-4)
        engine.set_time(2.0)
        np.testing.assert_allclose(
            middle(engine), expected("srgb_rec709_scene", exposure=-1.0), atol=1e-4
        )


def test_a_grade_is_the_prim_s_own() -> None:
    """Oracle: the neighbour's spec is as before."""
    stage = Usd.Stage.CreateInMemory()
    one = schema.author(stage, "/One", random_cloud(1))
    schema.author(stage, "/Two", random_cloud(2))
    schema.author_grade(one, exposure=1.0)
    with Engine(stage) as engine:
        engine.sync()
        grades = {path: field.spec.grade for path, field, _ in engine.render_scene.drawn()}
    assert grades["/One"] == (2, 0, 0, 0, 2, 0, 0, 0, 2)
    assert grades["/Two"] == (1, 0, 0, 0, 1, 0, 0, 0, 1)


def test_a_grade_out_of_range_is_told() -> None:
    """Oracle: the sentence."""
    stage = stage_with(temperature=5000.0)
    stage.GetPrimAtPath("/Splats").GetAttribute("splat:grade:temperature").Set(10.0)
    with Engine(stage) as engine:
        assert engine.warnings == (
            "/Splats.splat:grade:temperature: found 10, expected 1000 to 25000; it is not drawn",
        )


def test_a_grade_on_a_model_applies_to_all_fields_below_it() -> None:
    """Oracle: the same values on the fields themselves, and the nearest opinion of each value."""
    stage = Usd.Stage.CreateInMemory()
    model = stage.DefinePrim("/scan", "Xform")
    for name in ("A", "B"):
        schema.author(stage, f"/scan/parts/{name}", wall())
    schema.author_grade(model, exposure=1.0, saturation=0.5)
    schema.author_grade(stage.GetPrimAtPath("/scan/parts"), saturation=0.25)
    schema.author_grade(stage.GetPrimAtPath("/scan/parts/B"), exposure=-1.0)
    found = [schema.grade(stage.GetPrimAtPath(f"/scan/parts/{name}")) for name in ("A", "B")]
    assert found == [Grade(exposure=1.0, saturation=0.25), Grade(exposure=-1.0, saturation=0.25)]


def test_a_graded_model_is_drawn_as_a_graded_field() -> None:
    """Oracle: the picture of the field with the same grade, bit for bit; after edits of the model,
    that of a fresh engine."""
    stage = Usd.Stage.CreateInMemory()
    model = stage.DefinePrim("/scan", "Xform")
    schema.author(stage, "/scan/splats", wall())
    add_camera(stage)
    with Engine(stage) as engine:
        plain = middle(engine)
        for exposure in (0.5, 0.25):
            schema.author_grade(model, exposure=exposure)
            with Engine(stage_with(exposure=exposure)) as other:
                np.testing.assert_array_equal(middle(engine), middle(other))
        model.GetAttribute("splat:grade:exposure").Set(0.5, 1)
        model.GetAttribute("splat:grade:exposure").Set(-0.5, 2)
        for time in (1, 2):
            engine.set_time(time)
            with Engine(stage, time=time) as fresh:
                np.testing.assert_array_equal(middle(engine), middle(fresh))
        model.RemoveProperty("splat:grade:exposure")
        np.testing.assert_array_equal(middle(engine), plain)


def test_instances_have_the_grades_of_their_own_models() -> None:
    """Oracle: the exposure authored above each instance, also after an edit."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/source/splats", wall())
    stage.OverridePrim("/source").SetSpecifier(Sdf.SpecifierClass)
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/source")
        prim.SetInstanceable(True)
    with Engine(stage) as engine:
        for graded in ((0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (3.0, 2.0)):
            for name, exposure in zip("AB", graded, strict=True):
                if exposure:
                    schema.author_grade(stage.GetPrimAtPath(f"/{name}"), exposure=exposure)
            engine.sync()
            found = {
                seen.path: field.spec.grade[0] for _, field, seen in engine.render_scene.drawn()
            }
            expected = {f"/{n}/splats": 2.0**e for n, e in zip("AB", graded, strict=True)}
            assert found == expected


def test_a_grade_without_a_field_below_is_a_finding() -> None:
    """Oracle: the code and the property; it goes when a field is there."""
    stage = Usd.Stage.CreateInMemory()
    schema.author_grade(stage.DefinePrim("/empty", "Xform"), exposure=1.0)
    with Engine(stage) as engine:
        (found,) = engine.findings
        assert (found.code, found.path) == ("unused", "/empty")
        assert found.attribute == "splat:grade:exposure"
        schema.author(stage, "/empty/splats", wall())
        engine.sync()
        assert engine.findings == ()
