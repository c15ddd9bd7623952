"""Tests of converting fields from stock to packed and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdValidation

from tests.interchange.samples import assert_same, capture
from tests.schema.clouds import angles, cloud
from usdsplat import schema
from usdsplat.core.edits import parsed
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import import_capture, repack
from usdsplat.interchange.options import ImportOptions
from usdsplat.schema import packing


def opened(path: Path, prim_path: str) -> Usd.Prim:
    """A prim of a file whose stage stays open."""
    OPEN.append(Usd.Stage.Open(str(path)))
    return OPEN[-1].GetPrimAtPath(prim_path)


OPEN: list[Usd.Stage] = []
V0_6 = Path(__file__).parents[1] / "data" / "v0_6_0"


@pytest.mark.parametrize("suffix", [".usdc", ".usdz"])
def test_a_capture_goes_to_packed_and_back_within_the_bounds(data, tmp_path, suffix) -> None:
    """Oracle: the bounds of the layout against the capture's own numbers."""
    import_capture(data / "oracle" / "tiny.ply", tmp_path / "a.usdc")
    report = repack(tmp_path / "a.usdc", tmp_path / f"b{suffix}", form="packed")
    assert (report.prim_paths, report.samples, report.splats) == (("/tiny/splats",), 1, 1000)
    repack(tmp_path / f"b{suffix}", tmp_path / "c.usdc", form="float")
    before = schema.fetch(opened(tmp_path / "a.usdc", "/tiny/splats"))
    after = schema.fetch(opened(tmp_path / "c.usdc", "/tiny/splats"))
    np.testing.assert_array_equal(after.positions, before.positions)
    np.testing.assert_allclose(after.scales, before.scales, rtol=3.4e-4)
    assert np.abs(after.opacities - before.opacities).max() <= 1 / 1022 + 1e-7
    assert angles(after.rotations, before.rotations).max() <= packing.ROTATION_ERROR
    for path in ("a.usdc", f"b{suffix}", "c.usdc"):
        stage = Usd.Stage.Open(str(tmp_path / path))
        assert schema.validate(stage) == []
        assert UsdGeom.GetStageUpAxis(stage) == "Y"
        ops = UsdGeom.Xformable(stage.GetPrimAtPath("/tiny/splats")).GetOrderedXformOps()
        assert [op.GetOpName() for op in ops] == ["xformOp:transform:axes"]


def test_packed_files_are_a_third_of_the_size(tmp_path: Path) -> None:
    """Oracle: 76 bytes of 236 a splat, and the proxy's points."""
    import_capture(capture(tmp_path, n=100_000), tmp_path / "a.usdc")
    repack(tmp_path / "a.usdc", tmp_path / "b.usdc", form="packed")
    sizes = [(tmp_path / name).stat().st_size for name in ("a.usdc", "b.usdc")]
    assert sizes[1] < sizes[0] * (76 / 236 + 0.02)


@pytest.mark.parametrize("form", ["half", "packed"])
def test_time_samples_stay_time_samples(tmp_path: Path, form: str) -> None:
    """Oracle: centres at each sample; counts may differ between them."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usdc"))
    for time, n in ((1, 3), (2, 3), (5, 4)):
        schema.author(stage, "/Splats", cloud(time, n=n, moving=True), time=time)
    stage.Save()
    report = repack(stage, tmp_path / "b.usdc", form=form)
    assert (report.samples, report.splats) == (3, 10)
    prim = opened(tmp_path / "b.usdc", "/Splats")
    assert schema.sample_times(prim) == [1, 2, 5]
    assert schema.form_of(prim) == form
    for time, n in ((1, 3), (2, 3), (5, 4)):
        found = schema.fetch(prim, time)
        np.testing.assert_array_equal(found.positions, cloud(time, n=n).positions)
        np.testing.assert_array_equal(found.ids, cloud(time, n=n, moving=True).ids)


def test_modes_colour_space_and_memory_of_the_import_stay(tmp_path: Path) -> None:
    """Oracle: the values on the original."""
    stage = Usd.Stage.CreateInMemory()
    import_capture(capture(tmp_path), stage, options=ImportOptions(prim_path="/Splats"))
    prim = schema.author(
        stage,
        "/Splats",
        cloud(),
        color_space="lin_rec709_scene",
        drawing=schema.DrawingHints(
            rasterize_mode="antialiased",
            sorting_mode="cameraDistance",
            projection_mode="tangential",
        ),
    )
    repack(stage, tmp_path / "b.usdc", form="packed")
    found = opened(tmp_path / "b.usdc", "/Splats")
    for question in (
        schema.color_space,
        schema.rasterize_mode,
        schema.sorting_mode,
        schema.projection_mode,
    ):
        assert question(found) == question(prim)
    before, after = (p.GetCustomDataByKey("usdsplat") for p in (prim, found))
    assert after["sha256"] == before["sha256"]
    assert after["error_bounds"]["opacities"] == "1/1022"


def test_layers_references_and_instances_are_flattened(tmp_path: Path) -> None:
    """Oracle: the world of the new file, opened where the old layers are gone."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usdc"))
    schema.author(asset, "/Tree/Splats", cloud(n=5))
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Tree"))
    asset.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddReference("./asset.usdc")
        prim.SetInstanceable(True)
    stage.Save()
    report = repack(tmp_path / "shot.usda", tmp_path / "flat.usdc", form="packed", flatten=True)
    assert report.samples == 1
    del asset, stage
    (tmp_path / "asset.usdc").unlink()
    for name in ("A", "B"):
        prim = opened(tmp_path / "flat.usdc", f"/{name}/Splats")
        assert prim.IsInstanceProxy()
        assert schema.is_packed(prim)
        np.testing.assert_array_equal(schema.fetch(prim).positions, cloud(n=5).positions)


def test_a_field_that_is_an_instance_itself_is_packed(tmp_path: Path) -> None:
    """Oracle: the centres; an instance can have no proxy, since USD allows it no children."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Source", cloud(n=5))
    stage.GetPrimAtPath("/Source").SetSpecifier(Sdf.SpecifierClass)
    instance = stage.DefinePrim("/Instance")
    instance.GetReferences().AddInternalReference("/Source")
    instance.SetInstanceable(True)
    repack(stage, tmp_path / "flat.usda", form="packed")
    prim = opened(tmp_path / "flat.usda", "/Instance")
    assert prim.IsInstance()
    assert schema.is_packed(prim)
    assert not prim.GetAllChildren()
    np.testing.assert_array_equal(schema.fetch(prim).positions, cloud(n=5).positions)


def test_fields_that_have_the_form_already_are_copied(tmp_path: Path) -> None:
    """Oracle: every array, bit for bit."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Float", cloud(1))
    packed = schema.author(stage, "/Packed", cloud(2), form="packed")
    report = repack(stage, tmp_path / "b.usdc", form="packed")
    assert report.prim_paths == ("/Float",)
    assert_same(schema.fetch(opened(tmp_path / "b.usdc", "/Packed")), schema.fetch(packed))


def test_the_source_is_not_changed(tmp_path: Path) -> None:
    """Oracle: the bytes of the file and the text of the open stage."""
    import_capture(capture(tmp_path), tmp_path / "a.usdc")
    before = (tmp_path / "a.usdc").read_bytes()
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    text = stage.ExportToString()
    repack(stage, tmp_path / "b.usdc", form="packed")
    assert (tmp_path / "a.usdc").read_bytes() == before
    assert stage.ExportToString() == text


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    """Oracle: the documented errors, and the folder afterwards."""
    import_capture(capture(tmp_path), tmp_path / "a.usdc")
    with pytest.raises(UsageError, match="double"):
        repack(tmp_path / "a.usdc", tmp_path / "b.usdc", form="double")
    with pytest.raises(OutputError, match="being read"):
        repack(tmp_path / "a.usdc", tmp_path / "a.usdc", form="packed")
    with pytest.raises(UnknownFormatError):
        repack(tmp_path / "a.usdc", tmp_path / "b.abc", form="packed")
    with pytest.raises(StageError, match="no splat field"):
        repack(Usd.Stage.CreateInMemory(), tmp_path / "b.usdc", form="packed")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.usdc", "tree.ply"]


def test_numbers_that_do_not_fit_leave_nothing_behind(tmp_path: Path) -> None:
    """Oracle: the folder afterwards."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Splats", replace(cloud(n=1), scales=np.full((1, 3), 1e9, np.float32)))
    with pytest.raises(UsageError, match="65504"):
        repack(stage, tmp_path / "b.usdc", form="half")
    assert list(tmp_path.iterdir()) == []


def drawn(path: Path) -> list[tuple[str, int]]:
    """What a render of the file shows: path and splats of each appearance."""
    with Engine(Usd.Stage.Open(str(path))) as engine:
        return [
            (seen.path, len(field.spec.cloud)) for _, field, seen in engine.render_scene.drawn()
        ]


@pytest.mark.parametrize("form", ["half", "packed"])
def test_prototypes_do_not_show_by_themselves(tmp_path: Path, form: str) -> None:
    """Oracle: what is drawn before: two instances, of which one is a guide, and a field that only
    a point instancer shows, kept under an `over`."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usdc"))
    schema.author(asset, "/Tree/Splats", cloud(n=5))
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Tree"))
    asset.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    for name in ("A", "B", "C"):
        prim = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        prim.GetReferences().AddReference("./asset.usdc", "/Tree")
        prim.SetInstanceable(True)
    UsdGeom.Imageable(stage.GetPrimAtPath("/C")).GetPurposeAttr().Set("guide")
    schema.author(stage, "/Kept/Splats", cloud(n=3))
    stage.GetPrimAtPath("/Kept").SetSpecifier(Sdf.SpecifierOver)
    stage.Save()
    expected = drawn(tmp_path / "shot.usda")
    assert expected == [("/A/Splats", 5), ("/B/Splats", 5)]
    repack(tmp_path / "shot.usda", tmp_path / "flat.usdc", form=form)
    assert drawn(tmp_path / "flat.usdc") == expected
    kept = Usd.Stage.Open(str(tmp_path / "flat.usdc"))
    assert not kept.GetPrimAtPath("/Kept/Splats").IsDefined()
    assert schema.form_of(kept.GetPrimAtPath("/Kept/Splats")) == form


@pytest.mark.parametrize("purpose", ["guide", "proxy", "render"])
def test_an_inherited_purpose_stays(tmp_path: Path, purpose: str) -> None:
    """Oracle: USD's computed purpose, on the way to packed and back, and what a render shows."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    group = UsdGeom.Xform.Define(stage, "/Group")
    group.GetPurposeAttr().Set(purpose)
    schema.author(stage, "/Group/Splats", cloud(n=5))
    own = schema.author(stage, "/Own", cloud(n=4))
    UsdGeom.Imageable(own).GetPurposeAttr().Set("guide")
    stage.Save()
    expected = drawn(tmp_path / "a.usda")
    repack(tmp_path / "a.usda", tmp_path / "b.usda", form="packed")
    repack(tmp_path / "b.usda", tmp_path / "c.usda", form="float")
    for name in ("b.usda", "c.usda"):
        field = UsdGeom.Imageable(opened(tmp_path / name, "/Group/Splats"))
        assert field.ComputePurpose() == purpose
        assert UsdGeom.Imageable(opened(tmp_path / name, "/Own")).ComputePurpose() == "guide"
        assert drawn(tmp_path / name) == expected


def test_what_could_not_be_read_is_noted(tmp_path: Path) -> None:
    """Oracle: a missing reference and a colour space that nobody knows, authored here."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    prim = schema.author(stage, "/Splats", cloud(n=3))
    prim.GetAttribute("colorSpace:name").Set("foo")
    stage.Save()
    stage.DefinePrim("/Lost").GetReferences().AddReference("./none.usda")
    stage.Save()
    report = repack(tmp_path / "a.usda", tmp_path / "b.usdc", form="half")
    (missing,), (unknown, _) = report.findings, report.notes
    assert (missing.code, missing.path) == ("missing-asset", "/Lost")
    assert unknown.startswith("/Splats: found colour space 'foo', expected one that USD knows")


@pytest.mark.parametrize(("form", "rules"), [("float", 0), ("half", 1), ("packed", 0)])
def test_the_published_rule_that_a_form_breaks_is_noted(tmp_path: Path, form, rules) -> None:
    """Oracle: VG.035 asks for the float attributes of stock fields."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/A/B", cloud(n=2), form="packed" if form == "float" else "float")
    notes = repack(stage, tmp_path / "b.usda", form=form).notes
    assert len(notes) == rules
    assert all(note.startswith("/A/B: NVIDIA's rule VG.035 for splats fails:") for note in notes)


def test_edits_are_done_to_each_field_in_its_own_coordinates(tmp_path: Path) -> None:
    """Oracle: the clouds and the extent, scaled by hand; ops stay; provenance has one more edit."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    import_capture(
        capture(tmp_path, n=20),
        stage,
        options=ImportOptions(prim_path="/A"),
        edits=[parsed("scale", "3")],
    )
    schema.author(stage, "/B", cloud(n=5))
    UsdGeom.Xformable(stage.GetPrimAtPath("/B")).AddTranslateOp().Set((7, 0, 0))
    stage.Save()
    repack(stage, tmp_path / "b.usdc", form="float", edits=[parsed("scale", "2")])
    for path in ("/A", "/B"):
        before, after = stage.GetPrimAtPath(path), opened(tmp_path / "b.usdc", path)
        found, source = schema.fetch(after), schema.fetch(before)
        np.testing.assert_allclose(found.positions, 2 * source.positions, rtol=1e-6)
        np.testing.assert_allclose(found.scales, 2 * source.scales, rtol=1e-6)
        boxes = [np.array(prim.GetAttribute("extent").Get()) for prim in (before, after)]
        np.testing.assert_allclose(boxes[1], 2 * boxes[0], rtol=1e-4)
        ops = [UsdGeom.Xformable(p).GetLocalTransformation() for p in (before, after)]
        assert ops[0] == ops[1]
    memory = opened(tmp_path / "b.usdc", "/A").GetCustomDataByKey("usdsplat")
    assert list(memory["edits"]) == ["scale 3", "scale 2"]


def moving_field(path: Path) -> Usd.Stage:
    """A field of 40 splats that drift, with two samples above a default value."""
    stage = Usd.Stage.CreateNew(str(path))
    first = cloud(n=40)
    schema.author(stage, "/S", cloud(3, n=7))
    for time, move in ((1, 0), (3, 0.5)):
        there = replace(first, positions=first.positions + np.float32(move))
        schema.author(stage, "/S", there, time=time)
    stage.Save()
    return stage


def test_a_splat_that_stays_is_the_same_one_at_the_next_sample(tmp_path: Path) -> None:
    """Oracle: rows picked by hand at each sample; ids say which they were, and so it is held."""
    stage = moving_field(tmp_path / "a.usda")
    box = parsed("crop-box", "0,-9,-9,9,9,9")
    report = repack(stage, tmp_path / "b.usdc", form="float", edits=[box])
    prim = opened(tmp_path / "b.usdc", "/S")
    for time in (1, 3):
        source = schema.fetch(stage.GetPrimAtPath("/S"), time).positions
        rows = np.flatnonzero(source[:, 0] >= 0)
        found = schema.fetch(prim, time)
        np.testing.assert_array_equal(found.positions, source[rows])
        np.testing.assert_array_equal(found.ids, rows)
    assert schema.sample_times(prim) == [1, 3]
    np.testing.assert_array_equal(schema.fetch(prim).ids, schema.fetch(prim, 1).ids)
    assert report.notes[0].startswith("/S at 1: crop-box 0,-9,-9,9,9,9: ")


@pytest.mark.parametrize(
    "edit", [parsed("decimate", "50%"), parsed("drop-outliers", "5,1"), parsed("morton", "")]
)
def test_edits_that_look_at_several_splats_need_a_field_that_does_not_move(tmp_path, edit) -> None:
    """Oracle: the documented error; a still field is edited."""
    stage = moving_field(tmp_path / "a.usda")
    with pytest.raises(UsageError, match=rf"^edit {edit.name}: found /S, which moves, expected"):
        repack(stage, tmp_path / "b.usdc", form="float", edits=[edit])
    assert not (tmp_path / "b.usdc").exists()
    still = Usd.Stage.CreateInMemory()
    schema.author(still, "/S", cloud(n=40))
    assert 0 < repack(still, tmp_path / "b.usdc", form="float", edits=[edit]).splats <= 40


def test_a_move_of_a_moving_field_keeps_its_motion(tmp_path: Path) -> None:
    """Oracle: between samples half way, moved by hand; rows need no ids for that."""
    stage = moving_field(tmp_path / "a.usda")
    edits = [parsed("translate", "0,0,1"), parsed("sh-degree", "0")]
    repack(stage, tmp_path / "b.usdc", form="float", edits=edits)
    found = schema.fetch(opened(tmp_path / "b.usdc", "/S"), 2)
    source = schema.fetch(stage.GetPrimAtPath("/S"), 2).positions
    np.testing.assert_allclose(found.positions, source + np.float32([0, 0, 1]), atol=1e-6)
    assert (found.ids, found.sh_degree) == (None, 0)


def test_a_packed_file_of_0_6_gets_its_proxy_beside_the_field(tmp_path: Path) -> None:
    """Oracle: USD's validators, the points of the file of 0.6, and its arrays."""
    repack(V0_6 / "packed.usdc", tmp_path / "a.usda", form="packed")
    before, after = (Usd.Stage.Open(str(p)) for p in (V0_6 / "packed.usdc", tmp_path / "a.usda"))
    old, new = (stage.GetPrimAtPath("/World/small") for stage in (before, after))
    assert old.GetChildren() and not new.GetChildren()
    points = after.GetPrimAtPath("/World/small_proxy")
    assert new.GetRelationship("proxyPrim").GetTargets() == [points.GetPath()]
    for name in ("points", "widths", "extent"):
        assert points.GetAttribute(name).Get() == old.GetChild("proxy").GetAttribute(name).Get()
    places = UsdGeom.XformCache()
    world = places.GetLocalToWorldTransform
    assert world(points) == world(new) == world(old)
    assert_same(schema.fetch(new), schema.fetch(old))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert UsdValidation.ValidationContext(validators).Validate(after) == []


def test_a_packed_field_at_the_root_is_noted(tmp_path: Path) -> None:
    """Oracle: the note, and the prims of the file."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/A", cloud(n=2))
    (note,) = repack(stage, tmp_path / "b.usda", form="packed").notes
    assert note.startswith("/A has no proxy points")
    assert len(Usd.Stage.Open(str(tmp_path / "b.usda")).GetPseudoRoot().GetChildren()) == 1
