"""Tests of `usdsplat convert`."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.cli.conftest import ball
from tests.formats.samples import random_cloud
from usdsplat import formats, schema


def test_a_capture_becomes_a_stage(run, capture, tmp_path):
    """Oracle: the splats of the capture, on the prim that the report names."""
    status, out, err = run("convert", capture, tmp_path / "a.usdc", "--up-axis", "Z")
    assert (status, err) == (0, "")
    assert out.startswith(f"{tmp_path}/a.usdc: 300 splats, degree 1, float, from PLY")
    assert "\n  prim   /ball/splats\n" in out
    assert "\n  axes   rdf to rfu" in out
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    cloud = schema.fetch(stage.GetPrimAtPath("/ball/splats"))
    np.testing.assert_array_equal(cloud.positions, formats.read(capture).cloud.positions)
    assert UsdGeom.GetStageUpAxis(stage) == "Z"


def test_captures_become_others_without_what_draws(capture, tmp_path):
    """Oracle: sys.modules of a fresh interpreter."""
    words = ["convert", str(capture), str(tmp_path / "a.spz")]
    code = f"import sys; from usdsplat.cli.main import main; main({words}); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert (tmp_path / "a.spz").exists() and "usdsplat.formats" in loaded
    assert not loaded & {"numba", "scipy", "OpenImageIO", "usdsplat.delegate.engine"}


@pytest.mark.parametrize(
    ("flags", "form"), [((), "float"), (("--half",), "half"), (("--packed",), "packed")]
)
def test_the_form_is_the_one_asked_for(run_json, capture, tmp_path, flags, form):
    """Oracle: schema.form_of the written prim, and the report."""
    report = run_json("convert", capture, tmp_path / "a.usdc", *flags)
    assert report["form"] == form
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert schema.form_of(stage.GetPrimAtPath(report["prim_path"])) == form


def test_options_reach_the_stage(run_json, capture, tmp_path):
    """Oracle: the stage: unit, prim and, with baked axes, no transform; its frame is rub."""
    flags = ("--prim", "/Shot/Ball", "--bake-axes", "--meters-per-unit", "0.01", "--axes", "rub")
    report = run_json("convert", capture, tmp_path / "a.usdc", *flags)
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    prim = stage.GetPrimAtPath("/Shot/Ball")
    assert report["frame"] == "rub"
    assert not UsdGeom.Xformable(prim).GetOrderedXformOps()
    source = formats.read(capture).cloud.positions
    np.testing.assert_allclose(schema.fetch(prim).positions, source, rtol=1e-6)
    assert report["meters_per_unit"] == 0.01


def test_a_stage_becomes_a_capture_at_a_frame(run, shot, tmp_path):
    """Oracle: at frame 3 the ball stands 0.4 units to the right; rub is the stage's own frame."""
    status, out, _ = run("convert", shot, tmp_path / "a.ply", "--frame", "3", "--axes", "rub")
    assert status == 0
    assert "300 splats, degree 1\n  prim   /World/Ball\n  axes   rub" in out
    here = formats.read(tmp_path / "a.ply").cloud.positions
    stage = Usd.Stage.Open(str(shot))
    at_home = schema.fetch(stage.GetPrimAtPath("/World/Ball")).positions
    np.testing.assert_allclose(here, at_home + np.float32([0.4, 0, 0]), atol=1e-6)


def test_a_stage_is_repacked(run, shot, tmp_path):
    """Oracle: schema.form_of the written prim."""
    status, out, _ = run("convert", shot, tmp_path / "b.usdc", "--packed")
    assert (status, out) == (0, f"{tmp_path}/b.usdc: 1 field, 1 sample, 300 splats, now packed\n")
    stage = Usd.Stage.Open(str(tmp_path / "b.usdc"))
    assert schema.form_of(stage.GetPrimAtPath("/World/Ball")) == "packed"
    status, out, _ = run("convert", tmp_path / "b.usdc", tmp_path / "c.usda", "--packed")
    assert (status, out) == (0, f"{tmp_path}/c.usda: no field changed, all are packed\n")


def test_folders_are_made_and_removed_again_on_an_error(run, capture, tmp_path):
    """Oracle: the file system."""
    assert run("convert", capture, tmp_path / "a" / "b" / "c.usdc")[0] == 0
    assert (tmp_path / "a" / "b" / "c.usdc").is_file()
    assert run("convert", tmp_path / "missing.ply", tmp_path / "d" / "e" / "c.usdc")[0] == 2
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (["missing.ply", "a.usdc"], "missing.ply: found no such file or directory, expected a"),
        (["ball.ply", "a.doc"], "a.doc: found suffix '.doc', expected one of ."),
        (["ball.ply", "ball.ply/a.usdc"], "ball.ply/a.usdc: found no folder"),
        (["ball.ply", "a.usdc", "--axes", "xyz"], "--axes: found 'xyz', expected the directions"),
        (["ball.ply", "ball.ply"], "ball.ply: found a file that is being read, expected another"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(run, capture, monkeypatch, argv, sentence):
    """Oracle: where: found X, expected Y; status 2; nothing written."""
    monkeypatch.chdir(capture.parent)
    before = sorted(capture.parent.iterdir())
    status, out, err = run("convert", *argv)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert sorted(capture.parent.iterdir()) == before


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (
            ["ball.ply", "b.ply", "--packed"],
            "--packed: found it with a capture that becomes a capture",
        ),
        (
            ["ball.ply", "b.usda", "--frame", "1"],
            "--frame: found it with a capture that becomes a stage",
        ),
        (["shot.usda", "b.ply", "--half"], "--half: found it with a stage that becomes a capture"),
        (
            ["shot.usda", "b.ply", "--up-axis", "Z"],
            "--up-axis: found it with a stage that becomes a",
        ),
        (
            ["shot.usda", "b.usda", "--axes", "rub"],
            "--axes: found it with a stage that becomes a stage",
        ),
        (
            ["ball.ply", "b.usda", "--frames", "1"],
            "--frames: found it with a capture that becomes a stage",
        ),
        (
            ["shot.usda", "b.$F.ply", "--frame", "1"],
            "--frame: found it with a stage that becomes a capture, fra",
        ),
        (
            ["ball.ply", "b.ply", "--split"],
            "--split: found it with a capture that becomes a capture",
        ),
        (
            ["ball.ply", "b.ply", "--spz-version", "3"],
            "--spz-version: found b.ply, expected an .spz",
        ),
        (["ball.ply", "b.ply", "--lod", "-1"], "--lod: found -1, expected a level, 0 the finest"),
        (["ball.ply", "shot.usda", "b.usdc"], "shot.usda: found a stage among several inputs"),
        (
            ["ball.ply", "b.$F.ply"],
            "b.$F.ply: found a placeholder for the frame number but no frames",
        ),
        (
            ["b.$F.ply", "b.ply"],
            "b.ply: found one file for a sequence, expected a stage, or a name",
        ),
        (["b.$F.ply", "ball.ply", "b.usda"], "b.$F.ply: found a sequence among several inputs"),
        (
            ["b.$F.ply", "b.usda"],
            "b.$F.ply: found no file of that name, expected one for each frame",
        ),
        (["ball.ply"], "convert: found no OUT, expected one; see 'usdsplat convert --help'"),
        (["shot.usda", "b.usda/"], "b.usda/: found the name of a folder, expected one of a file"),
        (["shot.usda", "b.doc"], "b.doc: found suffix '.doc', expected one of ."),
        (["folder", "b.ply"], "folder: found a directory without meta.json, expected a capture"),
        (["ball.ply", "b.usda", "--up-axis", "X"], "--up-axis: found 'X', expected one of Y, Z"),
        (["ball.ply", "b.usda", "--meters-per-unit", "0"], "--meters-per-unit: found 0, expected"),
        (["ball.ply", "b.usda", "--prim", "x"], "--prim: found 'x', expected the path of a prim"),
    ],
)
def test_flags_without_an_effect_are_refused(run, capture, shot, monkeypatch, argv, sentence):
    """Oracle: where: found X, expected Y, flags spelled as they were typed; nothing is written."""
    monkeypatch.chdir(capture.parent)
    (capture.parent / "folder").mkdir()
    before = sorted(capture.parent.iterdir())
    status, out, err = run("convert", *argv)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert sorted(capture.parent.iterdir()) == before


def test_a_reader_is_told_that_the_axes_are_a_guess(run, capture, tmp_path):
    """Oracle: no .ply states its axes."""
    out = run("convert", capture, tmp_path / "a.usdc")[1]
    assert "note   the file does not say where its axes point: 'rdf' is assumed" in out


def test_several_captures_become_one(run, run_json, capture, tmp_path):
    """Oracle: the splats of each in turn; the second's frame is the first's, as none says one."""
    run("convert", capture, capture.with_name("far.ply"), "--translate", "9,0,0")
    pair = (capture, capture.with_name("far.ply"))
    report = run_json("convert", *pair, tmp_path / "both.ply")
    assert report["splats"] == 600
    sources = [formats.read(path).cloud.positions for path in pair]
    both = formats.read(tmp_path / "both.ply").cloud.positions
    np.testing.assert_array_equal(both, np.concatenate(sources))
    report = run_json("convert", *pair, tmp_path / "both.usdc", "--sh-degree", "0")
    assert (report["splats"], report["degree"]) == (600, 0)
    stage = Usd.Stage.Open(str(tmp_path / "both.usdc"))
    memory = stage.GetPrimAtPath("/ball/splats").GetCustomDataByKey("usdsplat")
    assert memory["source"] == "ball.ply + far.ply"
    assert list(memory["edits"]) == ["sh-degree 0"]


def test_a_stage_and_a_capture_become_one_capture(run, capture, shot, tmp_path):
    """Oracle: the same two, each converted alone."""
    run("convert", shot, tmp_path / "still.ply", "--frame", "2")
    assert run("convert", shot, capture, tmp_path / "both.ply", "--frame", "2")[0] == 0
    parts = [formats.read(p).cloud.positions for p in (tmp_path / "still.ply", capture)]
    both = formats.read(tmp_path / "both.ply").cloud.positions
    np.testing.assert_array_equal(both, np.concatenate(parts))


def test_a_stage_is_split_into_its_fields(run, shot, tmp_path):
    """Oracle: a file named after the only field."""
    status, out, _ = run("convert", shot, tmp_path / "a.ply", "--split")
    assert (status, out.splitlines()[0]) == (0, f"{tmp_path}/a_Ball.ply: 300 splats, degree 1")
    assert len(formats.read(tmp_path / "a_Ball.ply").cloud) == 300
    assert not (tmp_path / "a.ply").exists()


def test_a_sequence_goes_onto_a_stage_and_back(run, run_json, capture, tmp_path):
    """Oracle: the files, moved by the edit; frames that are asked for and no others."""
    for frame in (1, 2, 3):
        move = f"{frame},0,0"
        run("convert", capture, tmp_path / f"cap.{frame:04}.ply", "--translate", move)
    report = run_json(
        *("convert", tmp_path / "cap.####.ply", tmp_path / "a.usdc"),
        *("--frames", "1-2", "--rate", "25", "--scale", "2"),
    )
    assert (report["frames"], report["counts"]) == ([1, 2], [300, 300])
    assert Usd.Stage.Open(str(tmp_path / "a.usdc")).GetTimeCodesPerSecond() == 25
    out = run("convert", tmp_path / "a.usdc", tmp_path / "back.##.ply")[1]
    assert "600 splats, degree 1, 2 frames" in out
    source = formats.read(capture).cloud.positions
    for frame in (1, 2):
        found = formats.read(tmp_path / f"back.0{frame}.ply").cloud.positions
        np.testing.assert_allclose(found, 2 * (source + np.float32([frame, 0, 0])), atol=1e-5)
    run("convert", tmp_path / "back.##.ply", tmp_path / "c.##.ply", "--frames", "2")
    assert [path.name for path in sorted(tmp_path.glob("c.*"))] == ["c.02.ply"]


def test_cameras_come_along_with_edits_that_move(run, capture, tmp_path):
    """Oracle: a camera at (0, 0, -4) of the capture, moved and enlarged by hand; rdf to rub."""
    pose = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, -4], [0, 0, 0, 1]]  # its y up, z back
    frames = [{"file_path": "a.png", "transform_matrix": pose}]
    size = {"w": 64, "h": 48, "fl_x": 50.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0}
    (tmp_path / "transforms.json").write_text(json.dumps({**size, "frames": frames}))
    status, out, _ = run(
        *("convert", capture, tmp_path / "a.usdc", "--cameras", tmp_path / "transforms.json"),
        *("--translate", "1,0,0", "--scale", "2"),
    )
    assert status == 0
    assert "  seen   by 1 camera beside it" in out
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    camera = stage.GetPrimAtPath("/ball/cameras/a")
    place = UsdGeom.Xformable(camera).ComputeLocalToWorldTransform(0).ExtractTranslation()
    np.testing.assert_allclose(place, (2, 0, 8), atol=1e-6)


@pytest.mark.parametrize("target", ["out.ply", "out.##.ply"])
def test_an_unapplied_grade_is_a_finding_and_strict_writes_nothing(run, shot, tmp_path, target):
    """Oracle: the grade authored here, the code, and the files."""
    stage = Usd.Stage.Open(str(shot))
    schema.author_grade(stage.GetPrimAtPath("/World/Ball"), exposure=1.0)
    stage.GetRootLayer().Save()
    before = sorted(tmp_path.iterdir())
    status, _, err = run("convert", shot, tmp_path / target, "--strict")
    assert status == 1 and err.count("warning [not-applied] /World/Ball: found a grade") == 1
    assert sorted(tmp_path.iterdir()) == before
    status, _, err = run("convert", shot, tmp_path / target)
    assert status == 0 and err.count("[not-applied]") == 1
    assert len(list(tmp_path.glob("out*.ply"))) == (1 if target == "out.ply" else 4)


def test_strict_writes_no_stage_with_a_field_that_keeps_its_form(run, tmp_path):
    """Oracle: a field in instances of another file, which a conversion in place cannot change."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    schema.author(stage, "/Source/Ball", ball())
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/{name}", "Xform")
        prim.GetReferences().AddReference("other.usda", "/Source")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Export(str(tmp_path / "other.usda"))
    stage.RemovePrim("/Source")
    stage.GetRootLayer().Save()
    argv = ("convert", tmp_path / "in.usda", tmp_path / "out.usda", "--packed")
    status, _, err = run(*argv, "--strict")
    assert status == 1 and "[not-converted]" in err
    assert not (tmp_path / "out.usda").exists()
    assert run(*argv)[0] == 0 and (tmp_path / "out.usda").exists()


@pytest.mark.parametrize("count", [1, 2])
def test_variants_are_counted_if_a_field_depends_on_them(run, tmp_path, count):
    """Oracle: the number of variants with their own data."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    sets = stage.DefinePrim("/M", "Xform").GetVariantSets().AddVariantSet("lod")
    for name in ("few", "many")[:count]:
        sets.AddVariant(name)
        sets.SetVariantSelection(name)
        with sets.GetVariantEditContext():
            schema.author(stage, "/M/F", random_cloud(4, 0, seed=1))
    stage.Save()
    status, out, _ = run("convert", tmp_path / "a.usda", tmp_path / "b.usda", "--packed")
    expected = {1: "1 field, 1 sample, 4 splats", 2: "1 field in 2 variants, 2 samples, 8 splats"}
    assert (status, out) == (0, f"{tmp_path}/b.usda: {expected[count]}, now packed\n")


def test_a_page_is_made_of_a_stage_or_a_capture(run, run_json, shot, capture, tmp_path):
    """Oracle: the report, as text and as JSON, and the files; the camera of the shot."""
    status, out, _ = run("convert", shot, tmp_path / "a.html", "--frame", "2")
    lines = out.splitlines()
    assert (status, lines[0]) == (0, f"{tmp_path}/a.html: 300 splats, degree 1")
    assert any(line.startswith("  camera /World/Cam") for line in lines)
    assert any(line.startswith("  size   3.") and line.endswith("in 1 file") for line in lines)
    assert any("the page shows frame 2: the animation of 1 field" in line for line in lines)
    report = run_json(
        *("convert", capture, tmp_path / "b" / "index.html", "--axes", "rub"),
        *("--scale", "2", "--resolution", "640x480"),
    )
    assert (report["splats"], report["camera"], len(report["files"])) == (300, "", 5)
    assert (tmp_path / "b" / "scene.sog").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--packed",), "it with a stage that becomes a page, expected only --prim, --frame"),
        (("--lod-error", "2"), "it with a stage that becomes a page"),
        (("--camera", "Nope"), "--camera: found 'Nope', expected one of "),
        (("--lod", "-1"), "expected a level, 0 the finest"),
        (("--frames", "nonsense"), "--frames"),
    ],
)
def test_a_page_takes_only_flags_that_it_has(run, shot, tmp_path, words, message):
    """Oracle: one sentence, status 2, and no file."""
    status, _, err = run("convert", shot, tmp_path / "a.html", *words)
    assert (status, message in err, err.count("\n")) == (2, True, 1)
    assert not (tmp_path / "a.html").exists()


def test_a_strict_page_with_a_finding_is_not_written(run, shot, tmp_path):
    """Oracle: a grade, which a page does not apply, and the folder before and after."""
    stage = Usd.Stage.Open(str(shot))
    schema.author_grade(stage.GetPrimAtPath("/World/Ball"), exposure=1.0)
    stage.GetRootLayer().Save()
    for target in (tmp_path / "a.html", tmp_path / "web" / "index.html"):
        status, _, err = run("convert", shot, target, "--frame", "2", "--strict")
        assert (status, "not-applied" in err or "a grade" in err) == (1, True)
        assert not target.exists()
    assert not (tmp_path / "web").exists()
