"""Tests of the public interface of fields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.schema.clouds import cloud, stock_prim, three_points
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.schema import tokens

FORMS = ("float", "half", "packed")


@pytest.mark.parametrize("form", FORMS)
def test_a_field_knows_its_form(stage: Usd.Stage, form: str) -> None:
    """Oracle: the form that was asked for."""
    prim = schema.author(stage, "/Splats", cloud(), form=form)
    assert schema.is_splat_field(prim)
    assert schema.form_of(prim) == form
    assert schema.is_packed(prim) == (form == "packed")


@pytest.mark.parametrize("before", FORMS)
@pytest.mark.parametrize("after", FORMS)
def test_writing_another_form_leaves_nothing_of_the_first(stage, before: str, after: str) -> None:
    """Oracle: the properties that the same form has on a fresh prim."""
    prim = schema.author(stage, "/Splats", cloud(1, moving=True), form=before)
    schema.author(stage, "/Splats", cloud(2), form=after)
    fresh = schema.author(stage, "/Fresh", cloud(2), form=after)
    names = [{p.GetName() for p in item.GetAuthoredProperties()} for item in (prim, fresh)]
    assert names[0] == names[1]
    children = [[c.GetName() for c in item.GetChildren()] for item in (prim, fresh)]
    assert children[0] == children[1]
    found, expected = schema.fetch(prim), schema.fetch(fresh)
    np.testing.assert_array_equal(found.sh, expected.sh)
    assert found.ids is None


@pytest.mark.parametrize("form", FORMS)
def test_a_default_value_replaces_samples(stage: Usd.Stage, form: str) -> None:
    """Oracle: the last cloud that was written; in USD samples hide a default value."""
    prim = schema.author(stage, "/Splats", cloud(1, n=3), form=form, time=1)
    schema.author(stage, "/Splats", cloud(2, n=4), form=form, time=2)
    assert schema.is_time_varying(prim)
    assert schema.sample_times(prim) == [1, 2]
    schema.author(stage, "/Splats", cloud(3, n=5), form=form)
    np.testing.assert_array_equal(schema.fetch(prim, 1).positions, cloud(3, n=5).positions)
    assert not schema.is_time_varying(prim)
    assert schema.sample_times(prim) == []


def test_the_extent_is_sampled_with_the_splats(stage: Usd.Stage) -> None:
    """Oracle: USD's bound at each time against the centres."""
    prim = schema.author(stage, "/Splats", cloud(1, n=3), time=1)
    moved = replace(cloud(1, n=3), positions=cloud(1, n=3).positions + np.float32(100))
    schema.author(stage, "/Splats", moved, time=2)
    for time, centre in ((1, 0), (2, 100)):
        bound = UsdGeom.BBoxCache(time, ["default"]).ComputeWorldBound(prim).GetRange()
        np.testing.assert_allclose(bound.GetMidpoint(), centre, atol=5)


def test_without_a_time_the_first_sample_is_read(stage: Usd.Stage) -> None:
    """Oracle: the cloud at the first time; USD alone has no default value there."""
    prim = schema.author(stage, "/Splats", cloud(1, n=3), time=7)
    schema.author(stage, "/Splats", cloud(2, n=3), time=8)
    np.testing.assert_array_equal(schema.fetch(prim).positions, cloud(1, n=3).positions)
    np.testing.assert_array_equal(
        schema.fetch(prim, Usd.TimeCode.EarliestTime()).positions, cloud(1, n=3).positions
    )


def test_ids_and_velocities_that_end_are_gone(stage: Usd.Stage) -> None:
    """Oracle: the sample without them."""
    first = cloud(1, n=3, moving=True)
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", cloud(2, n=3), time=2)
    assert schema.fetch(prim, 1).ids is not None
    assert schema.fetch(prim, 2).ids is None
    assert schema.fetch(prim, 2).velocities is None


def test_a_sample_of_another_degree_is_refused(stage: Usd.Stage) -> None:
    """Oracle: the degree is uniform in the schema."""
    schema.author(stage, "/Splats", cloud(1, degree=2), time=1)
    with pytest.raises(StageError, match="degree 1, expected 2"):
        schema.author(stage, "/Splats", cloud(1, degree=1), time=2)


@pytest.mark.parametrize("form", FORMS)
def test_results_are_overs_that_leave_the_original_alone(stage: Usd.Stage, form: str) -> None:
    """Oracle: the original layer's text, and its cloud when the results are muted."""
    prim = schema.author(stage, "/Splats", cloud(1, n=3))
    before = stage.GetRootLayer().ExportToString()
    results = Sdf.Layer.CreateAnonymous("results.usda")
    stage.GetSessionLayer().subLayerPaths.append(results.identifier)
    with Usd.EditContext(stage, results):
        schema.author(stage, "/Splats", cloud(2, n=4), form=form, time=1)
    assert results.GetPrimAtPath("/Splats").specifier == Sdf.SpecifierOver
    np.testing.assert_array_equal(schema.fetch(prim, 1).positions, cloud(2, n=4).positions)
    assert len(schema.fetch(prim, 1)) == 4
    assert schema.form_of(prim) == form
    assert stage.GetRootLayer().ExportToString() == before
    stage.MuteLayer(results.identifier)
    prim = stage.GetPrimAtPath("/Splats")
    np.testing.assert_array_equal(schema.fetch(prim, 1).sh, cloud(1, n=3).sh)


def test_half_results_hide_the_originals_float_arrays(stage: Usd.Stage) -> None:
    """Oracle: the stock rule prefers float, so those of weaker layers must be blocked."""
    prim = schema.author(stage, "/Splats", cloud(1, n=3))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        schema.author(stage, "/Splats", cloud(2, n=3), form="half")
    np.testing.assert_allclose(schema.fetch(prim).sh, cloud(2, n=3).sh, atol=2e-3)


def test_instance_proxies_are_read_and_not_written(stage: Usd.Stage) -> None:
    """Oracle: the prototype's cloud; USD forbids edits beneath an instance."""
    schema.author(stage, "/Source/Splats", cloud(n=3))
    instance = stage.DefinePrim("/Instance")
    instance.GetReferences().AddInternalReference("/Source")
    instance.SetInstanceable(True)
    proxy = stage.GetPrimAtPath("/Instance/Splats")
    assert proxy.IsInstanceProxy()
    np.testing.assert_array_equal(schema.fetch(proxy).sh, cloud(n=3).sh)
    assert schema.color_space(proxy) == "srgb_rec709_scene"
    with pytest.raises(StageError, match="inside an instance"):
        schema.author(stage, "/Instance/Splats", cloud(n=3))


def test_a_prim_that_is_stock_by_fallback_is_read(stage: Usd.Stage) -> None:
    """Oracle: USD's fallbackPrimTypes."""
    stage.SetMetadata("fallbackPrimTypes", {"SomebodysSplats": Vt.TokenArray([tokens.STOCK_TYPE])})
    prim = stock_prim(stage, {"positions": three_points()}, type_name="SomebodysSplats")
    assert schema.is_splat_field(prim)
    assert len(schema.fetch(prim)) == 3


def test_the_draft_name_of_the_stock_type_is_read(stage: Usd.Stage) -> None:
    """Oracle: attributes by name, since USD does not know the type."""
    prim = stock_prim(stage, {"positions": three_points()}, type_name=tokens.PRERELEASE_TYPE)
    assert schema.is_splat_field(prim)
    assert len(schema.fetch(prim)) == 3
    assert schema.form_of(prim) == "float"


def test_other_prims_are_no_fields(stage: Usd.Stage) -> None:
    """Oracle: the documented error, which names the type."""
    mesh = stage.DefinePrim("/Mesh", "Mesh")
    assert not schema.is_splat_field(mesh)
    assert not schema.is_splat_field(Usd.Prim())
    with pytest.raises(StageError, match="a prim of type Mesh"):
        schema.fetch(mesh)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("form", "double"),
        ("color_space", "no_such_space"),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_is_written(
    stage: Usd.Stage, option: str, value: str
) -> None:
    """Oracle: the documented error, and the stage afterwards."""
    with pytest.raises(UsageError, match=value):
        schema.author(stage, "/Splats", cloud(), **{option: value})
    assert not stage.GetPrimAtPath("/Splats")


@pytest.mark.parametrize(
    ("hint", "value"),
    [("rasterize_mode", "sharp"), ("projection_mode", "fisheye"), ("sorting_mode", "random")],
)
def test_hints_that_cannot_be_are_refused(hint: str, value: str) -> None:
    """Oracle: the documented error."""
    with pytest.raises(UsageError, match=f"{hint}: found '{value}'"):
        schema.DrawingHints(**{hint: value})


def test_data_attributes_are_those_that_the_cloud_depends_on(stage: Usd.Stage) -> None:
    """Oracle: every attribute that authoring writes, except those that are known not to be."""
    others = {"extent", "colorSpace:name", "purpose"}
    for form in FORMS:
        prim = schema.author(stage, f"/{form}", cloud(moving=True), form=form)
        written = {a.GetName() for a in prim.GetAuthoredAttributes()} - others
        assert written <= schema.DATA_ATTRIBUTES


def test_error_bounds_name_fields_of_the_cloud() -> None:
    """Oracle: the cloud's own fields; the float form is exact."""
    assert schema.error_bounds("float") == {}
    for form in ("half", "packed"):
        assert set(schema.error_bounds(form)) == {"scales", "rotations", "opacities", "sh"}
