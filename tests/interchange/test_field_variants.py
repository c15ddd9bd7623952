"""Tests of converting fields whose data depends on variants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.interchange.assets import asset, selected
from tests.interchange.samples import assert_same
from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.interchange import repack


def test_a_variant_set_without_data_stays_outside(tmp_path: Path) -> None:
    """Oracle: one cloud is written, although the set of looks has two variants."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    schema.author(stage, "/M/F", cloud(n=4))
    looks = model.GetVariantSets().AddVariantSet("look")
    for look in ("clean", "dirty"):
        looks.AddVariant(look)
        looks.SetVariantSelection(look)
        with looks.GetVariantEditContext():
            stage.GetPrimAtPath("/M/F").CreateAttribute("note", Sdf.ValueTypeNames.String).Set(look)
    stage.Save()
    report = repack(tmp_path / "a.usda", tmp_path / "b.usda", form="packed")
    assert report.samples == 1
    for look in ("clean", "dirty"):
        field = selected(tmp_path / "b.usda", "/M", look=look).GetPrimAtPath("/M/F")
        assert schema.is_packed(field)
        assert field.GetAttribute("note").Get() == look
        np.testing.assert_array_equal(schema.fetch(field).positions, cloud(n=4).positions)


def test_a_field_that_only_one_variant_defines_appears_only_there(tmp_path: Path) -> None:
    """Oracle: the prims of each variant in the source."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    sets = model.GetVariantSets().AddVariantSet("detail")
    for name in ("full", "empty"):
        sets.AddVariant(name)
    sets.SetVariantSelection("full")
    with sets.GetVariantEditContext():
        schema.author(stage, "/M/F", cloud(n=4))
    sets.SetVariantSelection("empty")
    stage.Save()
    repack(tmp_path / "a.usda", tmp_path / "b.usda", form="half")
    full = selected(tmp_path / "b.usda", "/M", detail="full").GetPrimAtPath("/M/F")
    assert schema.form_of(full) == "half"
    assert full.IsDefined()
    assert not selected(tmp_path / "b.usda", "/M", detail="empty").GetPrimAtPath("/M/F")


def test_a_field_of_two_sets_is_written_for_each_combination(tmp_path: Path) -> None:
    """Oracle: the values that each combination has in the source."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    group = UsdGeom.Xform.Define(stage, "/M/G").GetPrim()
    first = cloud(n=2)
    schema.author(stage, "/Base/F", first)
    group.GetReferences().AddInternalReference("/Base")
    stage.OverridePrim("/Base").SetSpecifier(Sdf.SpecifierClass)
    for prim, name, values in (
        (model, "place", {"left": ("positions", -1.0), "right": ("positions", 1.0)}),
        (group, "alpha", {"thin": ("opacities", 0.25), "thick": ("opacities", 0.75)}),
    ):
        sets = prim.GetVariantSets().AddVariantSet(name)
        for variant, (attribute, value) in values.items():
            sets.AddVariant(variant)
            sets.SetVariantSelection(variant)
            with sets.GetVariantEditContext():
                field = stage.GetPrimAtPath("/M/G/F").GetAttribute(attribute)
                field.Set([(value, 0, 0)] * 2 if attribute == "positions" else [value] * 2)
    stage.Save()
    report = repack(tmp_path / "a.usda", tmp_path / "b.usda", form="packed")
    assert report.samples == 5  # four combinations, and the class
    for place, x in (("left", -1), ("right", 1)):
        for alpha, opacity in (("thin", 0.25), ("thick", 0.75)):
            found = selected(tmp_path / "b.usda", "/M", place=place)
            with Usd.EditContext(found, found.GetSessionLayer()):
                found.GetPrimAtPath("/M/G").GetVariantSet("alpha").SetVariantSelection(alpha)
            seen = schema.fetch(found.GetPrimAtPath("/M/G/F"))
            assert schema.is_packed(found.GetPrimAtPath("/M/G/F"))
            np.testing.assert_array_equal(seen.positions[:, 0], [x, x])
            np.testing.assert_allclose(seen.opacities, opacity, atol=1 / 1022)


def test_too_many_variants_are_refused(tmp_path: Path) -> None:
    """Oracle: the documented error: 65 combinations."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    sets = model.GetVariantSets().AddVariantSet("many")
    for number in range(65):
        sets.AddVariant(f"v{number}")
        sets.SetVariantSelection(f"v{number}")
        with sets.GetVariantEditContext():
            schema.author(stage, "/M/F", cloud(n=1))
    with pytest.raises(StageError, match="--flatten"):
        repack(stage, tmp_path / "b.usda", form="packed")
    assert repack(stage, tmp_path / "b.usda", form="packed", flatten=True).samples == 1


def with_sets(folder: Path, sets: int, variants: int, *, attribute: str = "") -> Usd.Stage:
    """A stage of one field below a model with so many variant sets, which set an attribute of the
    field, or are inactive below another prim."""
    stage = Usd.Stage.CreateNew(str(folder / f"sets{sets}.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    schema.author(stage, "/M/F", cloud(n=1))
    for place in range(sets):
        found = model.GetVariantSets().AddVariantSet(f"set{place}")
        for number in range(variants):
            found.AddVariant(f"v{number}")
            found.SetVariantSelection(f"v{number}")
            with found.GetVariantEditContext():
                if attribute:
                    prim = stage.GetPrimAtPath("/M/F")
                    prim.CreateAttribute(attribute, Sdf.ValueTypeNames.Int).Set(number)
                else:
                    stage.OverridePrim("/M/Other").SetActive(False)
    return stage


def test_sets_without_opinions_on_fields_are_not_combined(tmp_path: Path) -> None:
    """Oracle: one cloud is written, although the sets have 4 ** 20 combinations."""
    stage = with_sets(tmp_path, 20, 4, attribute="note")
    assert repack(stage, tmp_path / "b.usda", form="packed").samples == 1
    field = selected(tmp_path / "b.usda", "/M", set3="v1").GetPrimAtPath("/M/F")
    assert schema.is_packed(field)
    assert field.GetAttribute("note").Get() == 3  # that of the first set, which is strongest


def test_too_many_combinations_to_walk_are_refused(tmp_path: Path) -> None:
    """Oracle: the documented error for 2 ** 11 combinations, none of which changes a field."""
    stage = with_sets(tmp_path, 11, 2)
    with pytest.raises(StageError, match="--flatten"):
        repack(stage, tmp_path / "b.usda", form="packed")


@pytest.mark.parametrize("selection", ["", "gone"])
def test_local_data_is_converted_if_no_variant_is_selected(tmp_path: Path, selection: str) -> None:
    """Oracle: the clouds of the source without a selection and in each variant; local data is
    stronger than that of variants."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    schema.author(stage, "/M/F", cloud(n=3))
    sets = model.GetVariantSets().AddVariantSet("lod")
    for name in ("a", "b"):
        sets.AddVariant(name)
    sets.SetVariantSelection("b")
    with sets.GetVariantEditContext():
        stage.GetPrimAtPath("/M/F").GetAttribute("positions").Set([(9, 9, 9)] * 3)
    if selection:
        sets.SetVariantSelection(selection)
    else:
        sets.ClearVariantSelection()
    stage.Save()
    report = repack(tmp_path / "a.usda", tmp_path / "b.usda", form="half")
    assert (report.samples, report.findings) == (1, ())
    for chosen in ({}, {"lod": "a"}, {"lod": "b"}):
        found = selected(tmp_path / "b.usda", "/M", **chosen).GetPrimAtPath("/M/F")
        expected = selected(tmp_path / "a.usda", "/M", **chosen).GetPrimAtPath("/M/F")
        assert schema.form_of(found) == "half"
        np.testing.assert_array_equal(
            schema.fetch(found).positions, schema.fetch(expected).positions
        )
    assert sets.GetVariantSelection() == selection


@pytest.mark.parametrize("selection", ["", "gone"])
def test_data_of_variants_of_which_none_is_selected_is_a_finding(
    tmp_path: Path, selection: str
) -> None:
    """Oracle: the finding; the clouds of the source without a selection and in each variant."""
    path = asset(tmp_path)
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.GetPrimAtPath("/T").variantSelections["season"] = selection
    layer.Save()
    (missed,) = repack(path, tmp_path / "b.usda", form="packed").findings
    assert (missed.code, missed.path) == ("not-converted", "/T/F")
    for chosen in ({}, {"season": "summer"}, {"season": "winter"}):
        found = selected(tmp_path / "b.usda", "/T", **chosen).GetPrimAtPath("/T/F")
        expected = selected(path, "/T", **chosen).GetPrimAtPath("/T/F")
        assert_same(schema.fetch(found), schema.fetch(expected))
    flat = repack(path, tmp_path / "c.usda", form="packed", flatten=True)
    assert (flat.samples, flat.findings) == (1, ())


def test_data_only_in_variants_is_converted_without_a_selection(tmp_path: Path) -> None:
    """Oracle: the number of splats of each variant in the source; none without a selection."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    model = UsdGeom.Xform.Define(stage, "/M").GetPrim()
    stage.DefinePrim("/M/F", schema.tokens.STOCK_TYPE)
    sets = model.GetVariantSets().AddVariantSet("lod")
    for name, count in (("few", 2), ("many", 5)):
        sets.AddVariant(name)
        sets.SetVariantSelection(name)
        with sets.GetVariantEditContext():
            schema.author(stage, "/M/F", cloud(n=count))
    sets.ClearVariantSelection()
    stage.Save()
    report = repack(tmp_path / "a.usda", tmp_path / "b.usda", form="packed")
    assert (report.samples, report.findings) == (2, ())
    for name, count in (("few", 2), ("many", 5)):
        field = selected(tmp_path / "b.usda", "/M", lod=name).GetPrimAtPath("/M/F")
        assert schema.is_packed(field)
        assert len(schema.fetch(field)) == count
