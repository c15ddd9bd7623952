"""Tests of `usdsplat lod`."""

from __future__ import annotations

import shlex

import pytest
from pxr import Usd, UsdGeom

from usdsplat import schema


def test_a_capture_becomes_a_tree(run, capture, tmp_path):
    """Oracle: the splats of the capture, and the files that the report names."""
    status, out, err = run("lod", capture, "-o", tmp_path / "new" / "t.usda", "-q")
    assert (status, err) == (0, "")
    assert out.startswith(f"{tmp_path}/new/t.usda: 300 splats, degree 1\n  prim   /t/splats\n")
    assert "  tree   1 node in 1 level, 1 leaf, 1 chunk\n" in out
    names = sorted(path.name for path in (tmp_path / "new").rglob("*"))
    assert names == ["0000.usdc", "coarse.usdc", "t.usda", "t_chunks"]
    stage = Usd.Stage.Open(str(tmp_path / "new" / "t.usda"))
    assert stage.GetPrimAtPath("/t/splats").GetTypeName() == "ParticleFieldSplatTree"


def test_the_report_is_json(run_json, capture, shot, tmp_path):
    """Oracle: closed form: 300 splats of each input, the stage at frame 3 and in its own unit."""
    flags = ("--frame", "3", "--sh-degree", "0", "--pixel", "0.5", "--leaf-splats", "256", "-q")
    report = run_json("lod", shot, capture, "-o", tmp_path / "t.usdc", *flags)
    assert (report["splats"], report["degree"], report["pixel"]) == (600, 0, 0.5)
    assert (report["frame"], report["meters_per_unit"]) == ("rub", 1.0)
    assert report["leaves"] >= 3 and report["nodes"] > report["leaves"]
    assert report["errors"][0] > 0


def test_axes_and_units_reach_the_stage(run_json, capture, tmp_path):
    """Oracle: the report and the stage."""
    flags = ("--axes", "rub", "--up-axis", "Z", "--meters-per-unit", "0.01", "-q")
    report = run_json("lod", capture, "-o", tmp_path / "t.usda", *flags)
    assert (report["frame"], report["axes"]) == ("rub", "rub to rfu by xformOp:transform:axes")
    stage = Usd.Stage.Open(str(tmp_path / "t.usda"))
    assert stage.GetMetadata("metersPerUnit") == report["meters_per_unit"] == 0.01
    assert stage.GetMetadata("upAxis") == "Z"


def test_a_grade_is_a_finding_and_strict_writes_nothing(run, run_json, shot, tmp_path):
    """Oracle: the finding of `convert`; status 1, and no file, with --strict."""
    stage = Usd.Stage.Open(str(shot))
    schema.author_grade(stage.GetPrimAtPath("/World/Ball"), exposure=1.0)
    stage.GetRootLayer().Save()
    before = sorted(tmp_path.iterdir())
    status, out, err = run("lod", shot, "-o", tmp_path / "new" / "t.usda", "--strict")
    assert (status, out) == (1, "")
    assert "a grade" in err
    assert sorted(tmp_path.iterdir()) == before
    status, out, err = run("lod", shot, "-o", tmp_path / "t.usda", "--json")
    assert status == 0
    assert '"not-applied"' in out


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        ((), "lod: found no -o OUT, expected one"),
        (("-o", "{}/t.ply"), "found suffix '.ply', expected one of .usd .usda .usdc\n"),
        (("-o", "{}/t.usdz"), "a package, expected a .usd, .usda or .usdc file"),
        (("-o", "{}/t.usda", "--memory-limit", "9"), "--memory-limit: found 0.0 MiB, expected 768"),
        (("-o", "{}/t.usda", "--memory-limit", "x"), "--memory-limit: found 'x', expected bytes"),
        (("-o", "{}/t.usda", "--leaf-splats", "1"), "--leaf-splats: found 1, expected 256 to"),
        (("-o", "{}/t.usda", "--sh-degree", "9"), "--sh-degree: found 9, expected 0 to 4"),
        (("-o", "{}/t.usda", "--pixel", "nan"), "--pixel: found nan, expected a size"),
        (("-o", "{}/t.usda", "--pixel", "1e30"), "--pixel: found 1e+30, expected 0 to "),
        (("-o", "{}/t.usda", "--axes", "xyz"), "axes: found 'xyz', expected the directions"),
        (("-o", "{}/t.usda", "--up-axis", "X"), "--up-axis: found 'X', expected one of Y, Z"),
        (("-o", "{}/t.usda", "--frame", "3"), "--frame: found it with captures only, expected a"),
    ],
)
def test_wrong_options_are_one_line(run, capture, tmp_path, argv, said):
    """Oracle: status 2, where: found X, expected Y; nothing is written."""
    before = sorted(tmp_path.iterdir())
    status, out, err = run("lod", capture, *(word.format(tmp_path) for word in argv))
    assert (status, out) == (2, "")
    assert said in err and err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--axes", "rdf"), "--axes: found it with stages only, expected a capture"),
        (("--frame", "inf"), "--frame: found inf, expected the number of a frame"),
    ],
)
def test_wrong_options_with_a_stage_are_one_line(run, shot, tmp_path, flags, said):
    """Oracle: status 2, where: found X, expected Y; nothing is written."""
    before = sorted(tmp_path.iterdir())
    status, out, err = run("lod", shot, "-o", tmp_path / "t.usda", *flags)
    assert (status, out) == (2, "")
    assert said in err and err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_unit_of_zero_is_an_error_of_the_flag_and_a_finding_of_a_stage(run, capture, shot):
    """Oracle: the sentence, and the fallback of USD, 0.01."""
    tree = capture.with_name("tree.usda")
    status, _, err = run("lod", capture, "-o", tree, "--meters-per-unit", "0")
    assert (status, err) == (
        2,
        "usdsplat: --meters-per-unit: found 0, expected a positive number [m]\n",
    )
    assert not tree.exists()
    stage = Usd.Stage.Open(str(shot))
    stage.SetMetadata("metersPerUnit", 0.0)
    stage.Save()
    assert run("lod", shot, "-o", tree, "-q")[0] == 0
    assert UsdGeom.GetStageMetersPerUnit(Usd.Stage.Open(str(tree))) == 0.01
    assert "bad-meters-per-unit" in "".join(run("validate", shot)[1:])


def test_an_interruption_says_how_to_go_on(run, capture, tmp_path, monkeypatch):
    """Oracle: the command, which builds the tree; after another error nothing is said of it."""
    import usdsplat.interchange.lod as lod

    words = ("lod", capture, "-o", tmp_path / "a b.usda", "-q")
    with monkeypatch.context() as patch:
        for error in (KeyboardInterrupt(), OSError("full")):

            def stop(*_, error=error, **__):
                raise error

            patch.setattr(lod, "build_tree", stop)
            status, _, err = run(*words)
            told = f"usdsplat: interrupted; go on with: usdsplat {shlex.join(map(str, words))}\n"
            assert (status, err) == (130, told) if error.args == () else "go on" not in err
    assert run(*words)[0] == 0
