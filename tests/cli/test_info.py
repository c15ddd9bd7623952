"""Tests of `usdsplat info`."""

from __future__ import annotations

import dataclasses
import json
import shutil

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.cli.conftest import ball
from tests.renders import seen
from usdsplat import formats, schema


def test_a_captures_numbers_are_those_of_its_splats(run_json, capture):
    """Oracle: NumPy on the cloud that was written, and the size of the file."""
    cloud = ball()
    told = run_json("info", capture)
    assert told["file"] == str(capture)
    assert (told["splats"], told["sh_degree"], told["frame"]) == (300, 1, "rdf")
    np.testing.assert_array_equal(told["bounds"][0], cloud.positions.min(axis=0))
    np.testing.assert_array_equal(told["bounds"][1], cloud.positions.max(axis=0))
    median = np.median(np.prod(cloud.scales.astype(float), axis=1) ** (1 / 3))
    assert told["scale"]["p50"] == pytest.approx(median, rel=1e-5)
    assert told["opacity"]["p99"] == pytest.approx(np.percentile(cloud.opacities, 99), rel=1e-5)
    ratios = cloud.scales.max(axis=1) / cloud.scales.min(axis=1)
    assert told["anisotropy"]["p75"] == pytest.approx(np.percentile(ratios, 75), rel=1e-5)
    inner = np.percentile(cloud.positions, (1, 99), axis=0)
    np.testing.assert_allclose(told["bounds_robust"], inner, rtol=1e-5)
    assert told["bytes_per_splat"] == pytest.approx(capture.stat().st_size / 300)
    assert told["color_space"] == "srgb_rec709_scene"


def test_a_stages_fields_are_described_one_by_one(run_json, shot):
    """Oracle: what the fixture authored; 236 bytes are float32 centre, quaternion, scales, opacity
    and 4 x 3 coefficients: (3 + 4 + 3 + 1 + 12) x 4 = 92 at degree 1."""
    told = run_json("info", shot)
    assert (told["up_axis"], told["axes"], told["frames"]) == ("Y", "rub", [1.0, 4.0])
    assert told["cameras"] == ["/World/Cam"]
    (field,) = told["fields"]
    assert (field["path"], field["form"], field["splats"]) == ("/World/Ball", "float", 300)
    assert field["type"] == "ParticleField3DGaussianSplat"
    assert field["bytes_per_splat"] == 92
    assert (field["purpose"], field["samples"], field["sampled"]) == ("default", 0, None)


def test_time_samples_are_counted_and_chosen(run_json, tmp_path):
    """Oracle: two samples authored here, of which the second is 4 units up."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    cloud = ball()
    schema.author(stage, "/Ball", cloud, time=1)
    moved = dataclasses.replace(cloud, positions=cloud.positions + np.float32([0, 4, 0]))
    schema.author(stage, "/Ball", moved, time=2)
    stage.GetRootLayer().Save()
    (field,) = run_json("info", tmp_path / "a.usda", "--frame", 2)["fields"]
    assert (field["samples"], field["sampled"]) == (2, [1.0, 2.0])
    assert field["local_bounds"][0][1] == pytest.approx(moved.positions[:, 1].min())


def test_provenance_is_shown(run, run_json, capture, tmp_path):
    """Oracle: the capture's name and format, as import recorded them."""
    run("convert", capture, tmp_path / "a.usdc")
    (field,) = run_json("info", tmp_path / "a.usdc")["fields"]
    assert field["provenance"]["source"] == "ball.ply"
    assert field["provenance"]["format"].startswith("PLY")
    status, out, err = run("info", tmp_path / "a.usdc")
    assert (status, err) == (0, "")
    assert "    source             ball.ply\n" in out
    assert "  splats             300\n" in out


def test_a_bake_says_what_it_was_made_of(run, run_json, tmp_path):
    """Oracle: what the bake was opened with; edits of the capture have no sample long ago."""
    bake = seen(tmp_path, "edit", seed=5)
    (field,) = run_json("info", bake.target)["fields"]
    assert (field["samples"], field["sampled"]) == (14, [1.0, 14.0])
    told = field["bake"]
    assert (told["mode"], told["frames"], told["seed"]) == ("edit", [1.0, 14.0], 5)
    assert (told["completed"], told["inputs"]) == ("14 of 14", ["shot.usda"])
    assert "bake" not in field["provenance"]
    status, out, err = run("info", bake.target)
    assert (status, err) == (0, "")
    assert "    mode               edit\n    frames             1 14\n" in out


def test_text_leaves_out_what_says_nothing(run, capture):
    """Oracle: written out by hand; a ball without ids has no line for them."""
    status, out, _ = run("info", capture)
    assert status == 0
    assert "sh degree          1\n" in out
    assert "not finite         0\n" in out
    assert "ids" not in out


def test_a_capture_that_looks_upside_down_is_remarked_on(run, run_json, data, tmp_path):
    """Oracle: the data's README: one statue twice, half a turn about z apart."""
    wrong = tmp_path / "wrong.spz"
    cloud = formats.read(data / "splats" / "statue_angel.compressed.ply").cloud
    formats.write(cloud, wrong, how=formats.WriteOptions(frame="rdf"))
    told = run_json("info", wrong)
    assert (told["frame"], told["frame_source"]) == ("rdf", "file")
    assert (told["frame_guess"]["up"], told["frame_guess"]["agrees"]) == ("+y", False)
    _, out, _ = run("info", wrong)
    assert "+y looks like up, as in 'rub': set --axes if it is" in out
    for name, frame in (("statue_angel.compressed.ply", "rub"), ("statue_angel.sog", "rdf")):
        told = run_json("info", data / "splats" / name)
        assert (told["frame"], told["frame_source"]) == (frame, "evidence")
        assert (told["frame_guess"]["agrees"], told["frame_guess"]["remark"]) == (True, "")


def test_real_captures_are_described(run_json, data):
    """Oracle: the data's README: 101k splats of degree 3 in an SPZ 2."""
    told = run_json("info", data / "splats" / "pod.spz")
    assert told["format"] == "SPZ 2"
    assert told["splats"] == 101407
    assert told["sh_degree"] == 3
    assert run_json("info", data / "oracle" / "sogdir" / "meta.json")["splats"] == 1000


def test_a_field_that_cannot_be_read_is_named_with_its_problem(run, shot):
    """Oracle: a packed prim without its arrays, beside the ball of the fixture."""
    stage = Usd.Stage.Open(str(shot))
    bad = stage.DefinePrim("/World/Bad", "ParticleFieldPackedSplat")
    bad.CreateAttribute("positions", Sdf.ValueTypeNames.Point3fArray).Set([(0, 0, 0)])
    stage.GetRootLayer().Save()
    status, out, err = run("info", shot, "--json")
    assert status == 0 and err.startswith("usdsplat: error [not-drawn] /World/Bad.splat:packed")
    told = json.loads(out)
    assert told["splats"] == 300
    assert [field["path"] for field in told["fields"]] == ["/World/Ball", "/World/Bad"]
    assert told["fields"][1]["problem"].startswith("/World/Bad")


def test_an_unpacked_capture_is_as_large_as_the_files_that_are_read(run_json, data, tmp_path):
    """Oracle: the sizes on disk of the copied files; a stranger in the folder does not count."""
    folder = tmp_path / "scan"
    shutil.copytree(data / "oracle" / "sogdir", folder)
    size = sum(path.stat().st_size for path in folder.iterdir())
    (folder / "stranger.txt").write_text("x" * 1000)
    for named in (folder, folder / "meta.json"):
        assert run_json("info", named)["bytes"] == size


def test_instances_are_counted_as_a_render_counts_them(run_json, shot):
    """Oracle: the ball of 300 splats and two instances of an asset of 50 that is held once; a
    hidden ball is held and not drawn."""
    stage = Usd.Stage.Open(str(shot))
    schema.author(stage, "/Asset/Ball", ball(50))
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/World/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    UsdGeom.Imageable(schema.author(stage, "/World/Hidden", ball(7))).MakeInvisible()
    stage.GetRootLayer().Save()
    told = run_json("info", shot)
    assert (told["splats"], told["splats_drawn"]) == (357, 400)


def test_surfaces_and_the_bounds_of_a_picture_are_told(run_json, shot):
    """Oracle: a cube of edge 2 around (10, 0, 0), beside a ball around the origin; a hidden one
    counts for nothing."""
    before = run_json("info", shot)["world_bounds"]
    stage = Usd.Stage.Open(str(shot))
    for name, x in (("Box", 10.0), ("Hidden", 90.0)):
        cube = UsdGeom.Cube.Define(stage, f"/World/{name}")
        cube.AddTranslateOp().Set(Gf.Vec3d(x, 0, 0))
    cube.MakeInvisible()
    stage.GetRootLayer().Save()
    told = run_json("info", shot)
    assert told["surfaces_drawn"] == 1
    assert told["world_bounds"][0] == pytest.approx([before[0][0], -1, -1])
    assert told["world_bounds"][1] == pytest.approx([11, 1, 1])


def test_a_capture_has_no_time(run, capture):
    """Oracle: one sentence rather than an option that does nothing."""
    for flags in (("--frame", 1), ("--mute", "x"), ("--mask", "/World")):
        status, out, err = run("info", capture, *flags)
        expected = f"{flags[0]}: found a capture, {capture}, expected a stage"
        assert (status, out, err) == (2, "", f"usdsplat: {expected}\n")


def test_a_grade_and_a_crop_are_mentioned(run, run_json, shot):
    """Oracle: the inherited grade and the crop authored here; neither is mentioned before."""
    (field,) = run_json("info", shot)["fields"]
    assert (field["graded"], field["cropped"]) == (False, False)
    stage = Usd.Stage.Open(str(shot))
    schema.author_grade(stage.GetPrimAtPath("/World"), exposure=1.0)
    UsdGeom.Sphere.Define(stage, "/World/Matte")
    crops = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/World/Ball"), "cropExclude")
    crops.CreateIncludesRel().AddTarget("/World/Matte")
    stage.GetRootLayer().Save()
    (field,) = run_json("info", shot)["fields"]
    assert (field["graded"], field["cropped"]) == (True, True)
    lines = [line.split() for line in run("info", shot)[1].splitlines()]
    assert ["graded", "yes"] in lines and ["cropped", "yes"] in lines
