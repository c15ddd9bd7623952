"""Tests of exporting fields of a stage to capture files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.interchange.samples import assert_same, capture, covariances, read_ply
from tests.schema.clouds import cloud
from usdsplat import formats, schema
from usdsplat.core import sh
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError, UsageError
from usdsplat.interchange import export_capture, export_each, import_capture
from usdsplat.interchange.appearances import Appearance
from usdsplat.interchange.options import ImportOptions


@pytest.fixture
def stage() -> Usd.Stage:
    """An empty stage with y up."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, "Y")
    return stage


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("suffix", [".usdc", ".usdz"])
def test_there_and_back_is_the_same_capture(data, tmp_path, up_axis: str, suffix: str) -> None:
    """Oracle: plyfile on both files: the axes op and the export's turn cancel exactly."""
    source = data / "oracle" / "tiny.ply"
    import_capture(source, tmp_path / f"a{suffix}", options=ImportOptions(up_axis=up_axis))
    report = export_capture(tmp_path / f"a{suffix}", tmp_path / "back.ply")
    before, after = read_ply(source), read_ply(tmp_path / "back.ply")
    np.testing.assert_array_equal(after["positions"], before["positions"])
    for name in ("scales", "rotations", "opacities", "sh"):
        np.testing.assert_allclose(after[name], before[name], rtol=1e-5, atol=1e-6, err_msg=name)
    assert (report.splats, report.degree, report.frame) == (1000, 3, "rdf")
    assert report.prim_paths == ("/tiny/splats",)


def test_transforms_are_applied_to_centres_covariances_and_colours(stage, tmp_path) -> None:
    """Oracle: Gf's matrix on points, A S A^T, and the colour seen from a turned direction."""
    source = cloud(n=30, degree=3)
    prim = schema.author(stage, "/World/Splats", source)
    op = UsdGeom.Xformable(prim).AddTransformOp()
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 2, 3), 50))
    op.Set(turn * Gf.Matrix4d().SetScale(2) * Gf.Matrix4d().SetTranslate((5, 0, -1)))
    export_capture(stage, tmp_path / "out.ply", axes="rub")
    found = formats.read(tmp_path / "out.ply").cloud
    matrix = op.Get()
    expected = [matrix.Transform(Gf.Vec3d(*map(float, p))) for p in source.positions]
    np.testing.assert_allclose(found.positions, expected, atol=1e-5)
    a = np.array(matrix)[:3, :3].T
    np.testing.assert_allclose(
        covariances(found), a @ covariances(source) @ a.T, rtol=1e-3, atol=1e-6
    )
    direction = np.array([0.6, 0, 0.8])
    turned = (np.array(turn)[:3, :3].T @ direction)[None].astype(np.float32)
    seen = sh.evaluate(source.sh, np.repeat(direction[None].astype(np.float32), 30, axis=0))
    np.testing.assert_allclose(
        sh.evaluate(found.sh, np.repeat(turned, 30, axis=0)), seen, atol=1e-4
    )


def test_fields_and_instances_are_merged_each_in_its_place(stage, tmp_path: Path) -> None:
    """Oracle: the centres, moved by hand; degrees are padded to the highest."""
    schema.author(stage, "/Source/Splats", cloud(1, n=3, degree=0))
    for name, x in (("A", 10), ("B", 20)):
        instance = UsdGeom.Xform.Define(stage, f"/{name}")
        instance.AddTranslateOp().Set((x, 0, 0))
        instance.GetPrim().GetReferences().AddInternalReference("/Source")
        instance.GetPrim().SetInstanceable(True)
    schema.author(stage, "/Other", cloud(2, n=2, degree=1))
    report = export_capture(stage, tmp_path / "out.ply", axes="rub")
    assert report.prim_paths == ("/Source/Splats", "/A/Splats", "/B/Splats", "/Other")
    assert (report.splats, report.degree) == (11, 1)
    found = formats.read(tmp_path / "out.ply").cloud.positions
    first = cloud(1, n=3).positions
    np.testing.assert_allclose(found[3:6], first + np.array([10, 0, 0]), atol=1e-5)
    np.testing.assert_allclose(found[6:9], first + np.array([20, 0, 0]), atol=1e-5)


def test_hidden_fields_stay_out_unless_they_are_named(stage, tmp_path: Path) -> None:
    """Oracle: USD's visibility and purpose."""
    schema.author(stage, "/Seen", cloud(n=2))
    UsdGeom.Imageable(schema.author(stage, "/Hidden", cloud(n=3))).MakeInvisible()
    guide = schema.author(stage, "/Guide", cloud(n=4))
    UsdGeom.Imageable(guide).CreatePurposeAttr("guide")
    report = export_capture(stage, tmp_path / "out.ply")
    assert report.prim_paths == ("/Seen",)
    assert [note.split(":")[0] for note in report.notes] == ["/Hidden", "/Guide"]
    assert export_capture(stage, tmp_path / "out.ply", prim_path="/Hidden").splats == 3


def test_a_subtree_can_be_named(stage, tmp_path: Path) -> None:
    """Oracle: the fields beneath it."""
    schema.author(stage, "/A/One", cloud(n=2))
    schema.author(stage, "/B/Two", cloud(n=3))
    assert export_capture(stage, tmp_path / "o.ply", prim_path="/B").prim_paths == ("/B/Two",)


@pytest.mark.parametrize("sampled", [None, 1.0])
@pytest.mark.parametrize("time", [None, 1.0])
def test_point_instances_are_exported_where_they_are_seen(stage, tmp_path, time, sampled) -> None:
    """Oracle: centres moved by hand: prototype's place, instance's half turn and place, forest's;
    one is masked.
    """
    forest = UsdGeom.PointInstancer.Define(stage, "/Forest")
    forest.AddTranslateOp().Set((0, 0, 100))
    trees = {name: cloud(n, n=n) for name, n in (("Oak", 2), ("Fir", 3))}
    for name, own in trees.items():
        root = UsdGeom.Xform.Define(stage, f"/Forest/{name}")
        root.AddTranslateOp().Set((0, 5, 0))
        field = schema.author(stage, f"/Forest/{name}/Splats", own)
        UsdGeom.Xformable(field).AddScaleOp().Set((2, 2, 2))
        forest.GetPrototypesRel().AddTarget(root.GetPath())
    code = Usd.TimeCode.Default() if sampled is None else Usd.TimeCode(sampled)
    forest.GetProtoIndicesAttr().Set([1, 0, 1], code)
    forest.GetPositionsAttr().Set([(10, 0, 0), (20, 0, 0), (30, 0, 0)], code)
    forest.GetOrientationsAttr().Set([Gf.Quath(0, Gf.Vec3h(0, 0, 1)), *[Gf.Quath(1)] * 2], code)
    forest.GetInvisibleIdsAttr().Set([2])
    schema.author(stage, "/Rock", cloud(n=4))
    report = export_capture(stage, tmp_path / "out.ply", axes="rub", time=time)
    assert report.prim_paths == ("/Forest/Oak/Splats", "/Forest/Fir/Splats", "/Rock")
    found = formats.read(tmp_path / "out.ply").cloud
    assert len(found) == 2 + 3 + 4
    expected = [
        2 * trees["Oak"].positions + (20, 5, 100),
        2 * trees["Fir"].positions * (-1, -1, 1) + (10, -5, 100),
    ]
    np.testing.assert_allclose(found.positions[:5], np.concatenate(expected), atol=1e-4)
    np.testing.assert_allclose(found.scales[:2], 2 * trees["Oak"].scales, rtol=1e-5)


@pytest.mark.parametrize("specifier", [Sdf.SpecifierOver, Sdf.SpecifierClass])
def test_prototypes_that_do_not_show_by_themselves_are_exported_at_their_instances(
    stage, tmp_path: Path, specifier
) -> None:
    """Oracle: USD's ways to keep prototypes: under an `over` or a `class`, in a hidden scope."""
    tree = cloud(n=2)
    schema.author(stage, "/Library/Tree", tree)
    stage.GetRootLayer().GetPrimAtPath("/Library").specifier = specifier
    UsdGeom.Scope.Define(stage, "/Hidden").MakeInvisible()
    schema.author(stage, "/Hidden/Bush", cloud(n=3))
    forest = UsdGeom.PointInstancer.Define(stage, "/Forest")
    for path in ("/Library/Tree", "/Hidden/Bush"):
        forest.GetPrototypesRel().AddTarget(path)
    forest.GetProtoIndicesAttr().Set([0, 1, 0])
    forest.GetPositionsAttr().Set([(10, 0, 0), (20, 0, 0), (30, 0, 0)])
    export_capture(stage, tmp_path / "out.ply", axes="rub")
    found = formats.read(tmp_path / "out.ply").cloud
    assert len(found) == 2 + 3 + 2
    np.testing.assert_allclose(found.positions[:2], np.add(tree.positions, (10, 0, 0)), atol=1e-5)


def test_instances_that_are_not_seen_stay_out(stage, tmp_path: Path) -> None:
    """Oracle: USD's visibility, a prototype without an instance, and lists of unequal length."""
    forest = UsdGeom.PointInstancer.Define(stage, "/Forest")
    forest.GetPrototypesRel().AddTarget("/Forest/Tree")
    schema.author(stage, "/Forest/Tree", cloud(n=2))
    schema.author(stage, "/Rock", cloud(n=3))
    assert export_capture(stage, tmp_path / "out.ply").prim_paths == ("/Rock",)
    forest.GetProtoIndicesAttr().Set([0, 0])
    forest.GetPositionsAttr().Set([(1, 0, 0)])
    with pytest.raises(StageError, match=r"^/Forest: found "):
        export_capture(stage, tmp_path / "out.ply")
    forest.MakeInvisible()
    report = export_capture(stage, tmp_path / "out.ply")
    assert report.notes == ("/Forest: left out, it is not shown in renders",)


@pytest.mark.parametrize("factor", [1e39, np.inf])
def test_a_place_that_float32_cannot_hold_is_refused(stage, tmp_path: Path, factor) -> None:
    """Oracle: the largest float32, 3.4e38; nothing is written."""
    prim = schema.author(stage, "/Far", cloud(n=2))
    UsdGeom.Xformable(prim).AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set((factor,) * 3)
    with pytest.raises(StageError, match=r"^/Far: found "):
        export_capture(stage, tmp_path / "out.ply")
    assert not list(tmp_path.iterdir())


def test_more_splats_than_fit_are_refused_before_they_are_made(stage, tmp_path: Path) -> None:
    """Oracle: 40 million instances of 10 splats, a slip that would take 90 GB."""
    forest = UsdGeom.PointInstancer.Define(stage, "/Forest")
    forest.GetPrototypesRel().AddTarget("/Forest/Tree")
    prim = schema.author(stage, "/Forest/Tree", cloud(n=10))
    many = np.broadcast_to(np.eye(4), (40_000_000, 4, 4))
    with pytest.raises(StageError, match="found 400000000 splats, expected 268435456 at most"):
        Appearance(prim=prim, to_world=many).cloud(None, np.eye(3))


def test_each_field_becomes_a_file_of_its_own(stage, tmp_path: Path) -> None:
    """Oracle: names by hand, and the number of splats in each file."""
    for path, n in (("/A/Tree", 2), ("/B/Tree", 3), ("/B/Rock", 4)):
        schema.author(stage, path, cloud(n=n))
    UsdGeom.Imageable(schema.author(stage, "/Hidden", cloud(n=9))).MakeInvisible()
    report = export_each(stage, tmp_path / "out.PLY")
    files = {Path(part.target).name: part.splats for part in report.parts}
    assert files == {"out_A_Tree.PLY": 2, "out_B_Tree.PLY": 3, "out_B_Rock.PLY": 4}
    assert {p.name: len(formats.read(p).cloud) for p in tmp_path.iterdir()} == files
    assert report.notes == ("/Hidden: left out, it is not shown in renders",)
    export_each(stage, tmp_path / "b.ply", prim_path="/B")
    assert sorted(p.name for p in tmp_path.glob("b_*")) == ["b_Rock.ply", "b_Tree.ply"]


def test_a_split_that_fails_leaves_no_file(stage, tmp_path) -> None:
    """Oracle: the listing, and the earlier bytes; the second name is a folder's."""
    for name in "AB":
        schema.author(stage, f"/{name}", cloud(n=5))
    (tmp_path / "out_A.ply").write_bytes(b"old")
    (tmp_path / "out_B.ply").mkdir()
    with pytest.raises(OutputError, match=r"out_B\.ply: found something that is not a plain file"):
        export_each(stage, tmp_path / "out.ply")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out_A.ply", "out_B.ply"]
    assert (tmp_path / "out_A.ply").read_bytes() == b"old"


def test_a_time_chooses_the_frame(stage, tmp_path: Path) -> None:
    """Oracle: samples of centres and of the transform, half way by hand."""
    first = cloud(1, n=3)
    prim = schema.author(stage, "/Splats", first, time=1)
    schema.author(stage, "/Splats", replace(first, positions=first.positions + 2), time=3)
    op = UsdGeom.Xformable(prim).AddTranslateOp()
    op.Set((0, 0, 0), 1)
    op.Set((10, 0, 0), 3)
    export_capture(stage, tmp_path / "out.ply", time=2, axes="rub")
    found = formats.read(tmp_path / "out.ply").cloud.positions
    np.testing.assert_allclose(found, first.positions + np.array([6, 1, 1]), atol=1e-5)


@pytest.mark.parametrize("antialiased", [False, True])
def test_the_way_of_rasterising_is_kept(tmp_path: Path, antialiased: bool) -> None:
    """Oracle: the reader's word for the first and the last file."""
    source = capture(tmp_path, antialiased=antialiased)
    import_capture(source, tmp_path / "a.usdc")
    export_capture(tmp_path / "a.usdc", tmp_path / "back.ply")
    assert formats.read(tmp_path / "back.ply").antialiased == formats.read(source).antialiased


def test_what_the_file_cannot_say_is_noted(stage, tmp_path: Path) -> None:
    """Oracle: the facts of the stage."""
    moving = cloud(n=2, moving=True)
    schema.author(
        stage,
        "/A",
        moving,
        color_space="lin_rec709_scene",
        drawing=schema.DrawingHints(rasterize_mode="antialiased"),
    )
    notes = " / ".join(export_capture(stage, tmp_path / "a.ply").notes)
    assert "lin_rec709_scene" in notes
    assert "ids are not written" in notes
    assert "velocities are not written" in notes
    schema.author(stage, "/B", cloud(n=2))
    notes = " / ".join(export_capture(stage, tmp_path / "a.ply").notes)
    assert "lin_rec709_scene and srgb_rec709_scene" in notes
    assert "different rasterize modes" in notes


def test_a_field_in_its_own_axes_is_written_bit_for_bit(stage, tmp_path: Path) -> None:
    """Oracle: the writer given the same cloud."""
    source = cloud(n=20)
    schema.author(stage, "/Splats", source)
    export_capture(stage, tmp_path / "out.ply", axes="rub")
    formats.write(source, tmp_path / "expected.ply")
    assert_same(
        formats.read(tmp_path / "out.ply").cloud, formats.read(tmp_path / "expected.ply").cloud
    )


def test_a_stage_without_fields_is_refused(stage, tmp_path: Path) -> None:
    """Oracle: the documented errors."""
    with pytest.raises(StageError, match="no splat field"):
        export_capture(stage, tmp_path / "out.ply")
    UsdGeom.Imageable(schema.author(stage, "/Hidden", cloud(n=3))).MakeInvisible()
    with pytest.raises(StageError, match="not shown in renders"):
        export_capture(stage, tmp_path / "out.ply")
    with pytest.raises(StageError, match="/Nowhere: found no such prim"):
        export_capture(stage, tmp_path / "out.ply", prim_path="/Nowhere")
    with pytest.raises(UsageError, match="prim_path"):
        export_capture(stage, tmp_path / "out.ply", prim_path="not a path")
    assert list(tmp_path.iterdir()) == []


def test_targets_that_cannot_be_are_refused(stage, tmp_path: Path) -> None:
    """Oracle: the documented errors."""
    schema.author(stage, "/Splats", cloud(n=3))
    with pytest.raises(UnknownFormatError):
        export_capture(stage, tmp_path / "out.obj")
    with pytest.raises(UsageError, match="axes"):
        export_capture(stage, tmp_path / "out.ply", axes="up")
    import_capture(capture(tmp_path), tmp_path / "a.usdc")
    link = tmp_path / "link.ply"
    link.symlink_to(tmp_path / "a.usdc")
    with pytest.raises(OutputError, match="being read"):
        export_capture(tmp_path / "a.usdc", link)


@pytest.mark.parametrize("content", [None, b"", b"#usda 1.0\nnonsense", b"PXR-USDC garbage"])
def test_a_stage_that_cannot_be_opened_is_one_sentence(tmp_path: Path, content) -> None:
    """Oracle: the documented error; no traceback of USD's."""
    path = tmp_path / "bad.usd"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StageError, match="expected a USD file") as caught:
        export_capture(path, tmp_path / "out.ply")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("split", [False, True])
def test_a_glb_is_in_metres(stage, tmp_path: Path, split: bool) -> None:
    """Oracle: 1 cm is 0.01 m, of centres and covariances; and a .ply keeps the stage's numbers."""
    source = cloud(n=20, degree=1)
    schema.author(stage, "/World/Splats", source)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    export = export_each if split else export_capture
    report = export(stage, tmp_path / "out.glb")
    parts = report.parts if split else (report,)
    found = formats.read(parts[0].target).cloud
    np.testing.assert_allclose(found.positions, source.positions / 100, rtol=1e-6)
    np.testing.assert_allclose(covariances(found), covariances(source) / 1e4, rtol=1e-4, atol=1e-9)
    assert "from the stage's unit of 0.01 m to 1 m" in " ".join(parts[0].notes)
    plain = export_capture(stage, tmp_path / "out.ply", axes="rub")
    assert not any("unit" in note for note in plain.notes)
    np.testing.assert_array_equal(
        formats.read(tmp_path / "out.ply").cloud.positions, source.positions
    )


def test_an_unauthored_unit_is_named_as_usds_default(stage, tmp_path: Path) -> None:
    """Oracle: USD's fallback, 0.01."""
    schema.author(stage, "/World/Splats", cloud(n=2))
    notes = " ".join(export_capture(stage, tmp_path / "out.glb").notes)
    assert "unit of 0.01 m, USD's default, to 1 m" in notes
