"""`usdsplat convert`."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from usdsplat import formats, schema


def test_a_capture_becomes_a_stage(run, capture, tmp_path):
    """Oracle: the splats of the capture, on the prim that the report names."""
    status, out, err = run("convert", capture, tmp_path / "a.usdc", "--up-axis", "Z")
    assert (status, err) == (0, "")
    assert out.startswith(f"{tmp_path}/a.usdc: 300 splats, degree 1, float, from PLY")
    assert "\n  prim   /World/ball\n" in out
    assert "\n  axes   rdf to rfu" in out
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    cloud = schema.fetch(stage.GetPrimAtPath("/World/ball"))
    np.testing.assert_array_equal(cloud.positions, formats.read(capture).cloud.positions)
    assert UsdGeom.GetStageUpAxis(stage) == "Z"


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
    flags = ("--prim", "/Shot/Ball", "--bake-axes", "--meters-per-unit", "0.01", "--frame", "rub")
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
    status, out, _ = run("convert", shot, tmp_path / "a.ply", "--time", "3", "--frame", "rub")
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


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (["missing.ply", "a.usdc"], "missing.ply: found no such file or directory, expected a"),
        (["ball.ply", "a.doc"], "a.doc: found suffix '.doc', expected one of .ply"),
        (["ball.ply", "nowhere/a.usdc"], "nowhere/a.usdc: found no folder"),
        (["ball.ply", "a.usdc", "--frame", "xyz"], "--frame: found 'xyz', expected where x, y"),
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
        (["ball.ply", "b.ply", "--packed"], "--packed: found a capture that becomes a capture"),
        (["ball.ply", "b.usda", "--time", "1"], "--time: found a capture that becomes a stage"),
        (["shot.usda", "b.ply", "--half"], "--half: found a stage that becomes a capture"),
        (["shot.usda", "b.ply", "--up-axis", "Z"], "--up-axis: found a stage that becomes a"),
        (["shot.usda", "b.usda", "--frame", "rub"], "--frame: found a stage that becomes a stage"),
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
    """Oracle: no .ply says where its axes point."""
    out = run("convert", capture, tmp_path / "a.usdc")[1]
    assert "note   the file does not say where its axes point: 'rdf' is assumed" in out
