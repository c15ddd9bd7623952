"""Tests of importing a capture as a splat field."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdVol

from tests.interchange.samples import assert_same, capture, covariances, read_ply
from tests.schema.clouds import cloud
from usdsplat import formats, schema
from usdsplat.core.errors import (
    StageError,
    UsageError,
)
from usdsplat.interchange import import_capture
from usdsplat.interchange.options import ImportOptions

RDF_TO = {"Y": np.diag([1, -1, -1]), "Z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])}


def field(path: Path | Usd.Stage, prim_path: str = "/tree/splats") -> Usd.Prim:
    """A prim of a file; the stage stays open as long as the process."""
    stage = path if isinstance(path, Usd.Stage) else Usd.Stage.Open(str(path))
    OPEN.append(stage)
    return stage.GetPrimAtPath(prim_path)


OPEN: list[Usd.Stage] = []


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc", ".usdz"])
def test_every_number_of_a_ply_arrives(data: Path, tmp_path: Path, suffix: str) -> None:
    """Oracle: plyfile and the format's definition, read back through USD's own schema class."""
    target = tmp_path / f"tiny{suffix}"
    report = import_capture(data / "oracle" / "tiny.ply", target)
    assert (report.splats, report.degree, report.form) == (1000, 3, "float")
    prim = field(target, report.prim_path)
    oracle = read_ply(data / "oracle" / "tiny.ply")
    splats = UsdVol.ParticleField3DGaussianSplat(prim)
    np.testing.assert_array_equal(np.asarray(splats.GetPositionsAttr().Get()), oracle["positions"])
    scales = np.asarray(splats.GetScalesAttr().Get())
    np.testing.assert_allclose(scales, oracle["scales"], rtol=1e-5)
    xyzw = np.asarray(splats.GetOrientationsAttr().Get())
    np.testing.assert_allclose(xyzw[:, [3, 0, 1, 2]], oracle["rotations"], atol=1e-6)
    opacities = np.asarray(splats.GetOpacitiesAttr().Get())
    np.testing.assert_allclose(opacities, oracle["opacities"], atol=1e-6)
    flat = np.asarray(splats.GetRadianceSphericalHarmonicsCoefficientsAttr().Get())
    np.testing.assert_allclose(flat, oracle["sh"].reshape(-1, 3), atol=1e-6)


@pytest.mark.parametrize("name", ["splats/pod.spz", "splats/playbot_lod5.sog", "oracle/sogdir"])
def test_other_formats_arrive_as_their_readers_give_them(data, tmp_path, name: str) -> None:
    """Oracle: the reader, which has oracles of its own."""
    report = import_capture(data / name, tmp_path / "a.usdc")
    read = formats.read(data / name)
    assert_same(schema.fetch(field(tmp_path / "a.usdc", report.prim_path)), read.cloud)
    assert set(report.error_bounds) == set(read.error_bounds)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("bake", [False, True])
def test_axes_are_turned_the_way_that_is_reported(tmp_path, up_axis: str, bake: bool) -> None:
    """Oracle: right-down-forward in words: x stays, down becomes minus up."""
    source = capture(tmp_path, degree=0)
    target = tmp_path / "tree.usdc"
    report = import_capture(source, target, options=ImportOptions(up_axis=up_axis, bake_axes=bake))
    prim = field(target)
    assert UsdGeom.GetStageUpAxis(prim.GetStage()) == up_axis
    to_world = UsdGeom.XformCache().GetLocalToWorldTransform(prim)
    found = schema.fetch(prim)
    world = found.positions.astype(float) @ np.array(to_world)[:3, :3]
    np.testing.assert_allclose(world, cloud(degree=0).positions @ RDF_TO[up_axis].T, atol=1e-6)
    names = [op.GetOpName() for op in UsdGeom.Xformable(prim).GetOrderedXformOps()]
    assert names == ([] if bake else ["xformOp:transform:axes"])
    frame = {"Y": "rub", "Z": "rfu"}[up_axis]
    where = "in the arrays" if bake else "by xformOp:transform:axes"
    assert report.axes == f"rdf to {frame} {where}"


def test_baked_axes_turn_covariances_too(tmp_path: Path) -> None:
    """Oracle: A S A^T by hand."""
    source = capture(tmp_path, degree=1)
    import_capture(source, tmp_path / "baked.usdc", options=ImportOptions(bake_axes=True))
    turn = RDF_TO["Y"].astype(float)
    expected = turn @ covariances(formats.read(source).cloud) @ turn.T
    found = covariances(schema.fetch(field(tmp_path / "baked.usdc")))
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_frame_that_is_given_wins(tmp_path: Path) -> None:
    """Oracle: with USD's own axes nothing is left to turn."""
    report = import_capture(
        capture(tmp_path), tmp_path / "a.usdc", options=ImportOptions(axes="rub")
    )
    assert report.frame == "rub"
    assert report.axes == "rub, as the stage's"
    assert not UsdGeom.Xformable(field(tmp_path / "a.usdc")).GetOrderedXformOps()
    assert "the axes are 'rub' as given to the import" in report.notes


def test_a_file_says_its_default_prim_axes_and_unit(tmp_path: Path) -> None:
    """Oracle: what usdchecker asks of every stage, by USD's validators."""
    import_capture(
        capture(tmp_path), tmp_path / "a.usda", options=ImportOptions(meters_per_unit=0.01)
    )
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert stage.GetDefaultPrim().GetPath() == "/tree"
    assert stage.GetDefaultPrim().GetTypeName() == "Xform"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    assert schema.validate(stage) == []


def test_an_unknown_size_is_said(tmp_path: Path) -> None:
    """Oracle: captures have no unit; the report and the prim state the assumed one."""
    source = capture(tmp_path)
    assert any("a unit" in note for note in import_capture(source, tmp_path / "a.usd").notes)
    sized = import_capture(source, tmp_path / "b.usd", options=ImportOptions(meters_per_unit=1))
    assert not any("a unit" in note for note in sized.notes)


@pytest.mark.parametrize(("form", "bounds"), [("float", set()), ("packed", {"scales", "sh"})])
def test_the_prim_remembers_where_it_came_from(tmp_path: Path, form: str, bounds: set[str]) -> None:
    """Oracle: hashlib, and the report."""
    source = capture(tmp_path)
    report = import_capture(source, tmp_path / "a.usdc", options=ImportOptions(form=form))
    memory = field(tmp_path / "a.usdc").GetCustomDataByKey("usdsplat")
    assert memory["source"] == "tree.ply"
    assert memory["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert (memory["format"], memory["frame"]) == (report.format, "rdf")
    assert memory["axes"] == report.axes
    assert memory["reader"].startswith("usdsplat ")
    assert list(memory["notes"]) == list(report.notes)
    assert memory["error_bounds"] == dict(report.error_bounds)
    assert set(report.error_bounds) >= bounds
    assert str(tmp_path) not in str(memory)


def test_bounds_of_the_file_and_of_the_form_add_up(data: Path, tmp_path: Path) -> None:
    """Oracle: both texts stand in the sum."""
    source = data / "splats" / "pod.spz"
    report = import_capture(source, tmp_path / "a.usdc", options=ImportOptions(form="packed"))
    own = formats.read(source).error_bounds["opacities"]
    assert report.error_bounds["opacities"] == f"{own} + 1/1022"
    assert report.error_bounds["positions"] == formats.read(source).error_bounds["positions"]


def test_a_folder_is_hashed_as_a_whole_however_it_is_named(data: Path, tmp_path: Path) -> None:
    """Oracle: hashlib over the files that the format names; another hash when one byte changes."""
    folder = tmp_path / "scan"
    shutil.copytree(data / "oracle" / "sogdir", folder)

    def digest(source: Path) -> str:
        stage = Usd.Stage.CreateInMemory()
        report = import_capture(source, stage)
        assert report.prim_path == "/scan/splats"
        memory = field(stage, "/scan/splats").GetCustomDataByKey("usdsplat")
        assert memory["source"] == "scan"
        return memory["sha256"]

    whole = digest(folder)
    assert digest(folder / "meta.json") == whole
    (folder / "extra.txt").write_text("x")
    assert digest(folder) == whole
    meta = json.loads((folder / "meta.json").read_text())
    sections = (meta[name] for name in ("means", "scales", "quats", "sh0", "shN") if name in meta)
    names = sorted({"meta.json", *(name for section in sections for name in section["files"])})
    total = hashlib.sha256()
    for name in names:
        total.update(
            f"{name}\0{hashlib.sha256((folder / name).read_bytes()).hexdigest()}\n".encode()
        )
    assert whole == total.hexdigest()
    with (folder / "meta.json").open("a") as file:
        file.write(" ")
    assert digest(folder) != whole


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_way_of_rasterising_is_kept(tmp_path: Path, antialiased: bool) -> None:
    """Oracle: the reader's word for the same file."""
    source = capture(tmp_path, antialiased=antialiased)
    expected = "antialiased" if formats.read(source).antialiased else "classic"
    import_capture(source, tmp_path / "a.usdc")
    assert schema.rasterize_mode(field(tmp_path / "a.usdc")) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("my scan-2.ply", "my_scan_2"),
        ("2024.ply", "_2024"),
        ("Flügel.ply", "Flugel"),
        ("a.b.PLY", "a_b"),
        (".ply", "Splats"),
    ],
)
def test_prims_are_named_after_files(tmp_path: Path, name: str, expected: str) -> None:
    """Oracle: USD's rule for names: letters, digits and underscores; no digit first, none lost."""
    source = capture(tmp_path)
    source.rename(tmp_path / name)
    report = import_capture(tmp_path / name, tmp_path / "out.usdc")
    assert report.prim_path == f"/{expected}/splats"


def test_a_path_can_be_asked_for(tmp_path: Path) -> None:
    """Oracle: the prims on the way are groups, the first is the default prim."""
    report = import_capture(
        capture(tmp_path), tmp_path / "a.usda", options=ImportOptions(prim_path="/Set/Trees/Oak")
    )
    assert report.prim_path == "/Set/Trees/Oak"
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert stage.GetDefaultPrim().GetName() == "Set"
    assert [p.GetTypeName() for p in stage.Traverse()][:2] == ["Xform", "Xform"]


def test_a_capture_joins_a_stage(tmp_path: Path) -> None:
    """Oracle: the stage's own axes and unit; other prims and the numbering of equal names."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetDefaultPrim(stage.DefinePrim("/Shot", "Xform"))
    source = capture(tmp_path, degree=0)
    reports = [
        import_capture(source, stage, options=ImportOptions(meters_per_unit=1)) for _ in range(2)
    ]
    assert [r.prim_path for r in reports] == ["/Shot/tree/splats", "/Shot/tree_1/splats"]
    assert (reports[0].target, reports[0].meters_per_unit) == ("", 0.01)
    assert "100 times as large" in reports[0].axes
    prim = stage.GetPrimAtPath("/Shot/tree_1/splats")
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    np.testing.assert_allclose(to_world[:3, :3].T, 100 * RDF_TO["Z"], atol=1e-12)
    assert stage.GetRootLayer().anonymous


def test_importing_again_replaces_the_field_and_keeps_its_place(tmp_path: Path) -> None:
    """Oracle: the artist's op stays outermost, the axes op is there once, the cloud is new."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    import_capture(capture(tmp_path, n=4), stage, options=ImportOptions(prim_path="/Tree"))
    xformable = UsdGeom.Xformable(stage.GetPrimAtPath("/Tree"))
    axes_op = xformable.GetOrderedXformOps()[0]
    move = xformable.AddTranslateOp()
    move.Set((1, 2, 3))
    xformable.SetXformOpOrder([move, axes_op])
    import_capture(capture(tmp_path, n=7), stage, options=ImportOptions(prim_path="/Tree"))
    names = [op.GetOpName() for op in xformable.GetOrderedXformOps()]
    assert names == ["xformOp:translate", "xformOp:transform:axes"]
    assert len(schema.fetch(stage.GetPrimAtPath("/Tree"))) == 7
    import_capture(
        capture(tmp_path, n=7), stage, options=ImportOptions(prim_path="/Tree", bake_axes=True)
    )
    assert [op.GetOpName() for op in xformable.GetOrderedXformOps()] == ["xformOp:translate"]


def test_the_default_prim_of_another_layer_is_not_touched(tmp_path: Path) -> None:
    """Oracle: an edit target that is not the root layer says nothing about the stage."""
    stage = Usd.Stage.CreateInMemory()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        report = import_capture(capture(tmp_path), stage)
    assert stage.GetPrimAtPath(report.prim_path)
    assert not stage.HasDefaultPrim()
    assert stage.GetRootLayer().empty


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"up_axis": "X"}, UsageError, "up_axis"),
        ({"meters_per_unit": 0.0}, UsageError, "meters_per_unit"),
        ({"meters_per_unit": float("nan")}, UsageError, "meters_per_unit"),
        ({"axes": "xyz"}, UsageError, "axes"),
        ({"prim_path": "no path"}, UsageError, "prim_path"),
        ({"prim_path": "/"}, UsageError, "prim_path"),
        ({"prim_path": "relative/path"}, UsageError, "prim_path"),
        ({"form": "double"}, UsageError, "form"),
    ],
)
def test_options_that_cannot_be_write_nothing(tmp_path, options, error, text) -> None:
    """Oracle: the documented error, and the folder afterwards."""
    source = capture(tmp_path)
    with pytest.raises(error, match=text):
        import_capture(source, tmp_path / "a.usdc", options=ImportOptions(**options))
    assert [p.name for p in tmp_path.iterdir()] == ["tree.ply"]


def test_a_stage_keeps_its_up_axis(tmp_path: Path) -> None:
    """Oracle: the documented error."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Z")
    with pytest.raises(UsageError, match="Z, which the stage has"):
        import_capture(capture(tmp_path), stage, options=ImportOptions(up_axis="Y"))


def test_another_prim_is_not_overwritten(tmp_path: Path) -> None:
    """Oracle: the documented error, which names the type."""
    stage = Usd.Stage.CreateInMemory()
    stage.DefinePrim("/Mesh", "Mesh")
    with pytest.raises(StageError, match="a Mesh"):
        import_capture(capture(tmp_path), stage, options=ImportOptions(prim_path="/Mesh"))
