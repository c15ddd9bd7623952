"""Tests of the model prim above an imported field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Kind, Usd, UsdGeom

from tests.interchange.samples import capture
from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.edits import parsed
from usdsplat.interchange import convert, export_each, import_capture, import_sequence
from usdsplat.interchange.options import ImportOptions, SequenceOptions
from usdsplat.interchange.repacking import repack

PURPOSES = ("default", "render", "proxy", "guide")


def bounds(model: Usd.Prim, time: float | None = None) -> list[Gf.Range3d]:
    """USD's bounds of each purpose in the model's own space, without hints, float32."""
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    boxes = [UsdGeom.BBoxCache(code, [each]).ComputeUntransformedBound(model) for each in PURPOSES]
    return [box.ComputeAlignedRange() for box in boxes]


def hints(model: Usd.Prim, time: float | None = None) -> list[Gf.Range3d]:
    """The authored bounds of each purpose; empty ones at the end may be missing."""
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    corners = UsdGeom.ModelAPI(model).GetExtentsHint(code)
    pairs = [corners[i : i + 2] for i in range(0, len(corners), 2)]
    boxes = [Gf.Range3d(*map(Gf.Vec3d, pair)) for pair in pairs]
    return boxes + [Gf.Range3d()] * (len(PURPOSES) - len(boxes))


def assert_bounded(model: Usd.Prim, time: float | None = None) -> None:
    """The hints are the bounds, to float32."""
    for found, expected in zip(hints(model, time), bounds(model, time), strict=True):
        assert found.IsEmpty() == expected.IsEmpty()
        if not expected.IsEmpty():
            np.testing.assert_allclose(found.GetMin(), expected.GetMin(), rtol=1e-6)
            np.testing.assert_allclose(found.GetMax(), expected.GetMax(), rtol=1e-6)


@pytest.mark.parametrize("form", ["float", "packed"])
def test_an_imported_capture_is_a_component(tmp_path: Path, form: str) -> None:
    """Oracle: USD's model hierarchy, and its bounds of each purpose."""
    report = import_capture(
        capture(tmp_path), tmp_path / "hero.usda", options=ImportOptions(form=form)
    )
    stage = Usd.Stage.Open(str(tmp_path / "hero.usda"))
    model = stage.GetDefaultPrim()
    assert (model.GetPath(), report.prim_path) == ("/tree", "/tree/splats")
    assert model.GetTypeName() == "Xform" and model.IsModel()
    assert Usd.ModelAPI(model).GetKind() == Kind.Tokens.component
    assert Usd.ModelAPI(model).GetAssetName() == "tree"
    assert Usd.ModelAPI(model).GetAssetIdentifier().path == "./hero.usda"
    assert_bounded(model)
    shown = [not box.IsEmpty() for box in bounds(model)]
    assert shown == [form == "float", form == "packed", form == "packed", False]


def test_a_reference_to_the_file_has_everything(tmp_path: Path) -> None:
    """Oracle: the prims below the reference, and a group that makes it a model."""
    import_capture(capture(tmp_path), tmp_path / "a.usda", options=ImportOptions(form="packed"))
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    Usd.ModelAPI(shot.DefinePrim("/Set", "Xform")).SetKind(Kind.Tokens.assembly)
    prim = shot.DefinePrim("/Set/Tree")
    prim.GetReferences().AddReference("./a.usda")
    assert prim.IsModel() and not shot.GetCompositionErrors()
    assert [each.GetName() for each in prim.GetChildren()] == ["splats", "splats_proxy"]
    field = prim.GetChild("splats")
    assert UsdGeom.Imageable(field).ComputeProxyPrim()[0] == prim.GetChild("splats_proxy")


@pytest.mark.parametrize(
    ("root", "kind", "expected"),
    [
        ("Xform", "", "component"),
        ("Xform", "group", "component"),
        ("Xform", "component", "subcomponent"),
    ],
)
def test_the_kind_on_a_stage_depends_on_the_prims_above(tmp_path, root, kind, expected) -> None:
    """Oracle: USD's rule: a component has no component below it."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetDefaultPrim(stage.DefinePrim("/Shot", root))
    if kind:
        Usd.ModelAPI(stage.GetDefaultPrim()).SetKind(kind)
    report = import_capture(capture(tmp_path), stage)
    model = stage.GetPrimAtPath("/Shot/tree")
    assert report.prim_path == "/Shot/tree/splats"
    assert Usd.ModelAPI(model).GetKind() == expected
    assert Usd.ModelAPI(model).GetAssetIdentifier().path == ""
    assert_bounded(model)


def test_nothing_is_put_below_a_field(tmp_path: Path) -> None:
    """Oracle: USD's rule that a Gprim has no prims that are drawn below it."""
    stage = Usd.Stage.CreateInMemory()
    import_capture(capture(tmp_path), stage, options=ImportOptions(prim_path="/Field"))
    assert stage.GetDefaultPrim().GetPath() == "/Field"
    assert import_capture(capture(tmp_path), stage).prim_path == "/tree/splats"


def test_a_path_that_is_asked_for_has_no_model(tmp_path: Path) -> None:
    """Oracle: the caller's own layout, without kinds."""
    stage = Usd.Stage.CreateInMemory()
    import_capture(capture(tmp_path), stage, options=ImportOptions(prim_path="/Set/Tree"))
    assert not Usd.ModelAPI(stage.GetPrimAtPath("/Set")).GetKind()
    assert not stage.GetPrimAtPath("/Set").HasAPI(UsdGeom.ModelAPI)


def test_bounds_follow_an_import_into_the_same_field(tmp_path: Path) -> None:
    """Oracle: USD's bounds of the new splats."""
    stage = Usd.Stage.CreateInMemory()
    import_capture(capture(tmp_path), stage)
    model = stage.GetPrimAtPath("/tree")
    before = hints(model)
    again = ImportOptions(prim_path="/tree/splats")
    import_capture(capture(tmp_path, seed=7), stage, options=again)
    assert hints(model) != before
    assert_bounded(model)


@pytest.mark.parametrize("form", ["float", "packed"])
def test_bounds_follow_an_edit_and_another_form(tmp_path: Path, form: str) -> None:
    """Oracle: USD's bounds in the new file."""
    import_capture(capture(tmp_path), tmp_path / "a.usda")
    edits = [parsed("scale", "3")] if form == "float" else []
    repack(tmp_path / "a.usda", tmp_path / "b.usda", form=form, edits=edits)
    stage = Usd.Stage.Open(str(tmp_path / "b.usda"))
    model = stage.GetDefaultPrim()
    assert Usd.ModelAPI(model).GetKind() == Kind.Tokens.component
    before = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert hints(model) != hints(before.GetDefaultPrim())
    assert_bounded(model)


@pytest.mark.parametrize("clips", [False, True])
def test_bounds_of_a_sequence_are_those_of_each_frame(tmp_path: Path, clips: bool) -> None:
    """Oracle: USD's bounds at each frame."""
    for frame in (1, 2, 3):
        capture(tmp_path, f"cap.{frame}.ply", seed=frame)
    import_sequence(
        tmp_path / "cap.%d.ply",
        tmp_path / "a.usda",
        options=ImportOptions(form="packed"),
        sequence=SequenceOptions(clips=clips),
    )
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    model = stage.GetDefaultPrim()
    assert (model.GetPath(), Usd.ModelAPI(model).GetKind()) == ("/cap", Kind.Tokens.component)
    assert len({str(hints(model, frame)) for frame in (1, 2, 3)}) == 3
    for frame in (1, 2, 3):
        assert_bounded(model, frame)
    convert(tmp_path / "a.usda", tmp_path / "b.usda", edits=[parsed("scale", "2")])
    larger = Usd.Stage.Open(str(tmp_path / "b.usda"))
    for frame in (1, 2, 3):
        assert_bounded(larger.GetDefaultPrim(), frame)
        assert hints(larger.GetDefaultPrim(), frame) != hints(model, frame)


def test_files_of_each_field_are_named_after_the_models(tmp_path: Path) -> None:
    """Oracle: the names of the captures; a field elsewhere keeps its own."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetDefaultPrim(stage.DefinePrim("/Shot", "Xform"))
    for name in ("oak.ply", "elm.ply"):
        import_capture(capture(tmp_path, name), stage)
    schema.author(stage, "/Shot/Rock", cloud(n=2))
    report = export_each(stage, tmp_path / "a.ply")
    names = sorted(Path(part.target).name for part in report.parts)
    assert names == ["a_Rock.ply", "a_elm.ply", "a_oak.ply"]
