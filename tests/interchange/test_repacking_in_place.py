"""Tests of converting fields of a stage and keeping what it composes."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.interchange.assets import asset, opened, selected
from tests.interchange.samples import assert_same, capture
from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.edits import parsed
from usdsplat.core.errors import StageError
from usdsplat.interchange import import_capture, repack


@pytest.mark.parametrize("form", ["half", "packed"])
def test_each_variant_is_that_of_the_flattened_stage(tmp_path: Path, form) -> None:
    """Oracle: the clouds of the stage flattened with each variant selected, bit for bit; kind,
    assetInfo, arcs and the names of variants as in the source, written to another folder."""
    path, out = asset(tmp_path), tmp_path / "other" / "out.usda"
    out.parent.mkdir()
    report = repack(path, out, form=form)
    assert (report.prim_paths, report.samples) == (("/T/F",), 3)
    assert report.findings == ()
    for season in ("summer", "winter"):
        source = selected(path, "/T", season=season)
        repack(source, tmp_path / f"{season}.usda", form=form, flatten=True)
        flat = opened(tmp_path / f"{season}.usda")
        found = selected(out, "/T", season=season)
        assert schema.form_of(found.GetPrimAtPath("/T/F")) == form
        assert_same(
            schema.fetch(found.GetPrimAtPath("/T/F")), schema.fetch(flat.GetPrimAtPath("/T/F"))
        )
    model = opened(out).GetPrimAtPath("/T")
    assert model.GetVariantSet("season").GetVariantNames() == ["none", "summer", "winter"]
    assert model.GetVariantSet("season").GetVariantSelection() == "summer"
    assert Usd.ModelAPI(model).GetKind() == "component"
    assert dict(model.GetAssetInfo()) == {"name": "tree", "version": "7"}
    (spec,) = model.GetPrimStack()[0].referenceList.prependedItems
    assert spec.assetPath == "../field.usdc"
    none = selected(out, "/T", season="none").GetPrimAtPath("/T/F")
    assert not none.IsActive()


def test_variants_of_a_referenced_asset_are_kept_in_the_shot(tmp_path: Path) -> None:
    """Oracle: opacities as the asset states them in each variant of either of two references, and
    the arcs of the shot; the asset's file stays as it is."""
    path = asset(tmp_path)
    before = path.read_bytes()
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name in ("A", "B"):
        shot.DefinePrim(f"/{name}", "Xform").GetReferences().AddReference("./asset.usda")
    shot.Save()
    report = repack(tmp_path / "shot.usda", tmp_path / "out.usda", form="packed")
    assert report.prim_paths == ("/A/F", "/B/F")
    assert path.read_bytes() == before
    expected = {"summer": [0.5, 0.25, 1], "winter": [0.125, 0, 0.75]}
    for season, opacities in expected.items():
        for name in ("A", "B"):
            field = selected(tmp_path / "out.usda", f"/{name}", season=season).GetPrimAtPath(
                f"/{name}/F"
            )
            assert schema.is_packed(field)
            np.testing.assert_allclose(schema.fetch(field).opacities, opacities, atol=1 / 1022)


def test_a_field_in_instances_of_a_file_is_a_finding(tmp_path: Path) -> None:
    """Oracle: the finding and its cure; flattening converts the field."""
    path = asset(tmp_path)
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name in ("A", "B"):
        prim = shot.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddReference(f"./{path.name}")
        prim.SetInstanceable(True)
    shot.Save()
    (missed,) = repack(tmp_path / "shot.usda", tmp_path / "b.usda", form="packed").findings
    assert (missed.code, missed.path) == ("not-converted", "/A/F")
    assert "--flatten" in missed.cure
    flat = repack(tmp_path / "shot.usda", tmp_path / "c.usda", form="packed", flatten=True)
    assert (flat.findings, flat.samples) == ((), 1)


def test_local_data_above_variants_in_a_sublayer_is_a_finding(tmp_path: Path) -> None:
    """Oracle: USD's order of strength: local opinions of any sublayer hide variants of the root."""
    path = asset(tmp_path)
    over = Sdf.Layer.CreateNew(str(tmp_path / "over.usda"))
    spec = Sdf.CreatePrimInLayer(over, "/T/F")
    spec.typeName = schema.tokens.STOCK_TYPE
    Sdf.AttributeSpec(spec, "scales", Sdf.ValueTypeNames.Float3Array).default = [(1, 1, 1)] * 3
    over.Save()
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.subLayerPaths.append("./over.usda")
    layer.Save()
    (missed,) = repack(path, tmp_path / "b.usda", form="packed").findings
    assert (missed.code, missed.path) == ("not-converted", "/T/F")


def test_samples_over_a_referenced_default_value_can_be_read_at_any_time(tmp_path: Path) -> None:
    """Oracle: the clouds of the source at the default time and at each sample."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "field.usdc"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/T").GetPrim())
    schema.author(stage, "/T/F", cloud(3, n=7))
    for time in (1, 2):
        moved = replace(cloud(n=4), positions=cloud(n=4).positions + np.float32(time))
        schema.author(stage, "/T/F", moved, time=time)
    stage.Save()
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    shot.DefinePrim("/A", "Xform").GetReferences().AddReference("./field.usdc")
    shot.Save()
    repack(tmp_path / "shot.usda", tmp_path / "b.usdc", form="packed")
    out = Usd.Stage.Open(str(tmp_path / "b.usdc"))
    for time in (None, 1, 2):
        found = schema.fetch(out.GetPrimAtPath("/A/F"), time)
        expected = schema.fetch(shot.GetPrimAtPath("/A/F"), time)
        np.testing.assert_array_equal(found.positions, expected.positions)


def test_a_package_holds_what_it_refers_to(tmp_path: Path) -> None:
    """Oracle: the fields and variants of the package in a folder of its own."""
    path = asset(tmp_path)
    repack(path, tmp_path / "b.usdz", form="packed")
    (tmp_path / "alone").mkdir()
    shutil.move(tmp_path / "b.usdz", tmp_path / "alone" / "b.usdz")
    path.unlink()
    (tmp_path / "field.usdc").unlink()
    for season, first in (("summer", 0.5), ("winter", 0.125)):
        stage = selected(tmp_path / "alone" / "b.usdz", "/T", season=season)
        field = stage.GetPrimAtPath("/T/F")
        assert schema.is_packed(field)
        assert stage.GetCompositionErrors() == []
        assert schema.fetch(field).opacities[0] == pytest.approx(first, abs=1 / 1022)


def test_the_identifier_of_an_import_becomes_that_of_the_target(tmp_path: Path) -> None:
    """Oracle: an import writes its own file's name; the converted file is another one."""
    import_capture(capture(tmp_path), tmp_path / "tree.usdc")
    repack(tmp_path / "tree.usdc", tmp_path / "packed.usda", form="packed")
    model = opened(tmp_path / "packed.usda").GetPrimAtPath("/tree")
    assert model.GetAssetInfo()["identifier"].path == "./packed.usda"


def test_an_edited_field_is_edited_once(tmp_path: Path) -> None:
    """Oracle: the scale, also through an internal reference to the edited field."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    schema.author(stage, "/A/F", cloud(n=3))
    stage.DefinePrim("/B", "Xform").GetReferences().AddInternalReference("/A")
    stage.Save()
    repack(tmp_path / "a.usda", tmp_path / "b.usda", form="float", edits=[parsed("scale", "2")])
    out = Usd.Stage.Open(str(tmp_path / "b.usda"))
    for path in ("/A/F", "/B/F"):
        found = schema.fetch(out.GetPrimAtPath(path))
        np.testing.assert_allclose(found.positions, 2 * cloud(n=3).positions, rtol=1e-6)


def test_a_layer_is_searched_once_for_all_fields(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: as many traversals for nine fields as for three; converting takes linear time."""
    counts: list[int] = []
    traverse = Sdf.Layer.Traverse
    for fields in (3, 9):
        stage = Usd.Stage.CreateNew(str(tmp_path / f"a{fields}.usda"))
        for number in range(fields):
            schema.author(stage, f"/W/F{number}", cloud(n=1))
        calls: list[str] = []
        monkeypatch.setattr(
            Sdf.Layer,
            "Traverse",
            lambda self, *given, calls=calls: (calls.append("called"), traverse(self, *given)),
        )
        assert repack(stage, tmp_path / f"b{fields}.usda", form="packed").samples == fields
        counts.append(len(calls))
    assert counts[0] == counts[1] > 0


def test_a_stage_with_an_op_that_usd_does_not_know_is_converted(tmp_path: Path) -> None:
    """Oracle: the arrays; the op stays as authored, and bounds that cannot be computed too."""
    import_capture(capture(tmp_path), tmp_path / "tree.usda")
    stage = Usd.Stage.Open(str(tmp_path / "tree.usda"))
    field = stage.GetPrimAtPath("/tree/splats")
    UsdGeom.Xformable(field).GetXformOpOrderAttr().Set(["xformOp:wrong"])
    stage.Save()
    repack(stage, tmp_path / "packed.usda", form="packed")
    found = opened(tmp_path / "packed.usda").GetPrimAtPath("/tree/splats")
    assert schema.is_packed(found)
    assert list(found.GetAttribute("xformOpOrder").Get()) == ["xformOp:wrong"]
    before = schema.fetch(field).positions
    np.testing.assert_array_equal(schema.fetch(found).positions, before)


@pytest.mark.wrong_stages  # USD's validators raise errors for such a name
def test_names_of_any_text_can_be_identifiers(tmp_path: Path) -> None:
    """Oracle: an asset path has no line break; the files can be read."""
    import_capture(capture(tmp_path), tmp_path / "a\nb.usdc")
    repack(tmp_path / "a\nb.usdc", tmp_path / "c\nd.usdc", form="packed")
    for name in ("a\nb.usdc", "c\nd.usdc"):
        stage = opened(tmp_path / name)
        identifier = stage.GetDefaultPrim().GetAssetInfo()["identifier"].path
        assert identifier.isprintable()


@pytest.fixture
def strange(tmp_path: Path) -> Path:
    """A stage whose name is not UTF-8, with a reference to a field and a texture."""
    field = Usd.Stage.CreateNew(str(tmp_path / "bot.usdc"))
    field.SetDefaultPrim(UsdGeom.Xform.Define(field, "/T").GetPrim())
    schema.author(field, "/T/F", cloud(n=3))
    field.Save()
    shot = Usd.Stage.CreateNew(str(tmp_path / "v.usda"))
    prim = shot.DefinePrim("/A", "Xform")
    prim.GetReferences().AddReference("./bot.usdc")
    prim.CreateAttribute("texture", Sdf.ValueTypeNames.Asset).Set("./missing/x.png")
    shot.Save()
    path = tmp_path / os.fsdecode(b"v\xff.usda")
    try:
        shutil.move(tmp_path / "v.usda", path)
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    return path


def test_paths_are_beside_a_file_whose_name_is_not_utf_8(strange: Path) -> None:
    """Oracle: the paths as authored, beside the file; absolute ones if the stage is flattened."""
    out = strange.with_name("out.usda")
    repack(strange, out, form="packed")
    prim = opened(out).GetPrimAtPath("/A")
    (spec,) = prim.GetPrimStack()[0].referenceList.prependedItems
    assert spec.assetPath == "./bot.usdc"
    assert prim.GetAttribute("texture").Get().path == "./missing/x.png"
    below = strange.parent / "below" / "out.usda"
    below.parent.mkdir()
    repack(strange, below, form="packed")
    (spec,) = opened(below).GetPrimAtPath("/A").GetPrimStack()[0].referenceList.prependedItems
    assert spec.assetPath == "../bot.usdc"
    flat = strange.with_name("flat.usda")
    repack(strange, flat, form="packed", flatten=True)
    found = opened(flat).GetPrimAtPath("/A").GetAttribute("texture").Get().path
    assert found == str(strange.parent / "missing" / "x.png")


def test_a_path_that_is_not_utf_8_is_refused(strange: Path) -> None:
    """Oracle: the documented error: USD writes asset paths in UTF-8."""
    folder = strange.parent / os.fsdecode(b"d\xff")
    folder.mkdir()
    for name in (strange.name, "bot.usdc"):
        shutil.copy(strange.with_name(name), folder / name)
    with pytest.raises(StageError, match="not UTF-8"):
        repack(folder / strange.name, strange.with_name("out.usda"), form="packed")
    repack(folder / strange.name, strange.with_name("out.usda"), form="packed", flatten=True)
    (prim,) = opened(strange.with_name("out.usda")).GetPrimAtPath("/A").GetPrimStack()
    assert prim.attributes["texture"].default.path == str(strange.parent / "d\\xff/missing/x.png")


EXPRESSIONS = """#usda 1.0
(
    expressionVariables = {
        string X = "bot"
    }
    subLayers = [
        @`"./${X}_lights.usda"`@ (offset = 3)
    ]
)

def Xform "A" (
    prepend references = [@`"./${X}.usdc"`@, @./more.usda@]
)
{
    asset texture = @`"./${X}.png"`@
    asset moving.timeSamples = {
        1: @`"./${X}.1.png"`@,
    }
}
"""


def test_asset_paths_with_variables_stay_beside_the_source(tmp_path: Path) -> None:
    """Oracle: the paths as authored; in another folder, the files that they mean, with a note."""
    for name in ("bot.usdc", "bot_lights.usda", "more.usda"):
        stage = Usd.Stage.CreateNew(str(tmp_path / name))
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/T").GetPrim())
        if name == "bot.usdc":
            schema.author(stage, "/T/F", cloud(n=3))
        stage.Save()
    (tmp_path / "a.usda").write_text(EXPRESSIONS)
    report = repack(tmp_path / "a.usda", tmp_path / "b.usda", form="packed")
    assert (report.prim_paths, report.notes) == (("/A/F",), ())
    source, out = (Sdf.Layer.FindOrOpen(str(tmp_path / name)) for name in ("a.usda", "b.usda"))
    assert list(out.subLayerPaths) == list(source.subLayerPaths)
    assert out.subLayerOffsets[0] == source.subLayerOffsets[0]
    for path, key in (
        ("/A", "references"),
        ("/A.texture", "default"),
        ("/A.moving", "timeSamples"),
    ):
        found, expected = (each.GetObjectAtPath(path).GetInfo(key) for each in (out, source))
        assert found == expected
    assert opened(tmp_path / "b.usda").GetCompositionErrors() == []
    below = tmp_path / "below" / "b.usda"
    below.parent.mkdir()
    (note,) = repack(tmp_path / "a.usda", below, form="packed").notes
    assert note.startswith("asset paths with variables were evaluated")
    assert opened(below).GetCompositionErrors() == []
    assert opened(below).GetRootLayer().subLayerOffsets[0] == Sdf.LayerOffset(3)
    assert opened(below).GetPrimAtPath("/A").GetAttribute("texture").Get().path == "../bot.png"
