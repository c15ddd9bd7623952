"""Tests of `usdsplat simulate`: parameters, presets, bakes and errors."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
from dataclasses import fields

import numpy as np
import pytest
from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.errors import OutputError
from usdsplat.core.lock import output_lock
from usdsplat.sim.parameters import GROUPS, INSTANCED, camel
from usdsplat.sim.stage.authoring import author

FRAMES = ("--frames", "1:3")


def positions(path, frame, prim="/World/Field"):
    """The centres on a stage, shape (n, 3)."""
    stage = Usd.Stage.Open(str(path))
    return np.array(schema.fetch(stage.GetPrimAtPath(prim), frame).positions)


# --- help -------------------------------------------------------------------------------------


def test_help_shows_every_flag_and_how_it_is_used(run):
    """Oracle: the flags of the options, and the commands of the README."""
    status, out, err = run("simulate", "--help")
    assert (status, err) == (0, "")
    for flag in ("--output", "--frames", "--preset", "--set", "--list-parameters", "--resume",
                 "--force", "--axes", "--device", "--threads", "--json", "--mute"):  # fmt: skip
        assert flag in out
    assert "usdsplat simulate --preset grow scan.ply -o grow.usda" in out


def test_every_parameter_is_listed_once(run, run_json):
    """Oracle: the fields of the dataclasses; the text shows what the JSON does."""
    lead = {"deform": "deform:<name>", "driver": "driver:<name>", "mask": "mask:<name>"}
    expected = [
        f"{lead.get(group, group)}:{camel(item.name)}"
        for group, cls in {**GROUPS, **INSTANCED}.items()
        for item in fields(cls)
    ]
    rows = run_json("simulate", "--list-parameters")
    values = [row["name"] for row in rows if row["type"] != "rel"]
    expected.append("primvars:splatSim:weight")
    assert sorted(values) == sorted(expected) and len(set(values)) == len(values) > 100
    assert all(row["text"] for row in rows)
    status, out, err = run("simulate", "--list-parameters")
    assert (status, err) == (0, "")
    listed = re.findall(r"^([a-z]+:[\w<>:]+) ", out, re.MULTILINE)
    assert listed == [row["name"] for row in rows]


def test_relationships_are_listed_where_their_parameters_are(run_json):
    """Oracle: the relationships that the reader of stages looks for."""
    rows = run_json("simulate", "--list-parameters")
    found = {row["name"] for row in rows if row["type"] == "rel"}
    assert found == {
        "relax:surface", "conform:target", "skin:skeleton", "skin:mesh", "deform:<name>:frame",
        "mask:<name>:region", "mask:<name>:frame",
        "collection:splats:includes", "collection:affectors:includes",
    }  # fmt: skip


# --- presets ----------------------------------------------------------------------------------


def test_help_names_every_preset_and_option(run):
    """Oracle: the table of presets."""
    from usdsplat.sim.stage.presets import PRESETS

    text = run("simulate", "--help")[1]
    assert f"--preset {'|'.join(PRESETS)}" in text
    assert f"presets: {', '.join(PRESETS)}" in " ".join(text.split())
    for each in PRESETS.values():
        assert each.option is None or f"--{each.option.name} " in text


def test_options_of_presets_are_checked_before_anything_is_read(run, capture, sim, tmp_path):
    """Oracle: the sentences, status 2, and the listing."""
    made = tmp_path / "out" / "push.usda"
    status, _, err = run("simulate", "--preset", "push", capture, "-o", made, "--style", "coral")
    assert status == 2 and "--style: found 'coral' and --preset push, expected none" in err
    status, _, err = run("simulate", "--preset", "grow", capture, "-o", made, "--style", "wool")
    assert status == 2 and "--style: found 'wool', expected one of cells, coral, " in err
    status, _, err = run("simulate", sim, "-o", made, "--material", "clay")
    assert status == 2 and "--material: found 'clay' without --preset, expected --preset" in err
    assert not made.parent.exists()


@pytest.mark.parametrize("name", ["grow", "push", "conform", "dissolve"])
def test_a_preset_of_a_capture_can_be_simulated(name, run, capture, tmp_path):
    """Oracle: the files that are named, and a bake of their first frames that moves splats."""
    made = tmp_path / f"{name}.usda"
    status, out, err = run("simulate", "--preset", name, capture, "-o", made)
    assert status == 0
    assert out.splitlines() == [str(tmp_path / f"{name}_capture.usdc"), str(made)]
    assert err == f"usdsplat: next: usdsplat simulate {made} -o {tmp_path / f'{name}_bake.usda'}\n"
    bake = tmp_path / "bake.usda"
    sets = ("--set", "rd:substeps=4") if name == "grow" else ()
    frames = ("--frames", "1:3")
    if name != "grow":  # by then the ball is there, and splats are on their way
        frames = ("--frames", "20:22")
        sets = ("--set", f"{name}:start=0") if name != "push" else ()
    assert run("simulate", made, "-o", bake, *frames, *sets)[0] == 0
    stage = Usd.Stage.Open(str(bake))
    (field,) = (str(each.GetPath()) for each in stage.Traverse() if schema.is_splat_field(each))
    first, last = (float(text) for text in frames[1].split(":"))
    at = positions(bake, last, field)
    assert len(at) >= 300  # large splats are divided where something grows or conforms
    before = positions(bake, first, field)
    assert len(at) != len(before) or not np.array_equal(at, before)


def test_a_preset_of_a_stage_refers_to_it(run_json, shot, tmp_path):
    """Oracle: the sublayer, and no copy of the capture."""
    made = tmp_path / "push.usda"
    assert run_json("simulate", "--preset", "push", shot, "-o", made) == {
        "files": [str(made)],
        "findings": [],
    }
    assert list(Sdf.Layer.FindOrOpen(str(made)).subLayerPaths) == ["./shot.usda"]


def test_what_is_there_is_not_replaced_by_a_preset(run, capture, tmp_path):
    """Oracle: one sentence, status 2; the file keeps its bytes."""
    made = tmp_path / "push.usda"
    made.write_text("mine")
    status, out, err = run("simulate", "--preset", "push", capture, "-o", made)
    assert (status, out) == (2, "")
    assert err == f"usdsplat: {made}: found a file, expected a new name\n"
    made.rename(tmp_path / "push_capture.usdc")
    status, _, err = run("simulate", "--preset", "push", capture, "-o", made)
    assert status == 2 and "push_capture.usdc: found a file" in err
    assert (tmp_path / "push_capture.usdc").read_text() == "mine" and not made.exists()


def test_a_preset_that_cannot_be_written_leaves_no_capture(run, capture, tmp_path, monkeypatch):
    """Oracle: the listing; writing the second file fails."""
    folder = tmp_path / "out"
    folder.mkdir()

    def refuse(*_, **__):
        raise OutputError("push.usda", "a full disk", "space")

    monkeypatch.setattr("usdsplat.products.presets.author_preset", refuse)
    assert run("simulate", "--preset", "push", capture, "-o", folder / "push.usda")[0] == 2
    assert list(folder.iterdir()) == []


# --- bakes ------------------------------------------------------------------------------------


def test_a_bake_moves_what_the_ball_meets_and_leaves_the_capture(run, sim, tmp_path):
    """Oracle: the ball's radius; the capture's own bytes."""
    before = sim.read_bytes()
    bake = tmp_path / "bake.usda"
    status, out, err = run("simulate", sim, "-o", bake)
    assert (status, out) == (0, f"{bake}\n")
    assert re.search(r"^usdsplat: 3 frames of 60 splats in .* at most [\d,]+ MB$", err, re.M)
    assert sim.read_bytes() == before
    at = positions(bake, 2)
    assert np.linalg.norm(at, axis=1).min() > 0.199
    assert np.linalg.norm(positions(sim, 2), axis=1).min() < 0.19
    assert np.array_equal(positions(bake, 1)[:, 0] > 0, positions(sim, 1)[:, 0] > 0)


def test_the_report_is_json(run, sim, tmp_path):
    """Oracle: the keys that a script would ask for."""
    status, out, _ = run("simulate", sim, "-o", tmp_path / "bake.usda", *FRAMES, "--json")
    report = json.loads(out)
    assert status == 0
    assert (report["frames"], report["splats"]) == (3, {"/World/Field": 60})
    assert report["target"] == str(tmp_path / "bake.usda")
    assert report["stages"]["contact"] >= 0 and report["seconds"] >= report["seconds_per_frame"]


def test_set_is_the_same_as_an_edit_of_the_stage(run, sim, tmp_path):
    """Oracle: the value, authored on a copy of the stage."""
    edited = tmp_path / "edited.usda"
    stage = Usd.Stage.Open(str(sim))
    author(stage.GetPrimAtPath("/World/Sphere"), {"affector:radiusScale": 1.5})
    author(stage.GetPrimAtPath("/World/Sim"), {"settle:omega": 2.0})
    stage.Export(str(edited))
    sets = ("--set", "affector:radiusScale=1.5", "--set", "/World/Sim.settle:omega=2")
    assert run("simulate", sim, "-o", tmp_path / "a.usda", *sets)[0] == 0
    assert run("simulate", edited, "-o", tmp_path / "b.usda")[0] == 0
    for frame in (1, 2, 3):
        a, b = (positions(tmp_path / name, frame) for name in ("a.usda", "b.usda"))
        assert np.array_equal(a, b)


def test_a_second_simulation_to_one_target_is_refused(run, sim, tmp_path):
    """Oracle: the number of the process that has the lock, and the listing."""
    bake = tmp_path / "bake.usda"
    with output_lock(bake):
        for flag in ((), ("--force",), ("--resume",)):
            status, out, err = run("simulate", sim, "-o", bake, *flag)
            assert (status, out) == (2, "")
            found = f"found an output that process {os.getpid()} is writing"
            assert err == f"usdsplat: {bake}: {found}, expected its end, or another name\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sim.usda"]
    assert run("simulate", sim, "-o", bake)[0] == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["bake.usda", "bake_data", "sim.usda"]


def test_a_bake_is_replaced_by_force_only(run, sim, tmp_path):
    """Oracle: the sentence, and the bake's bytes."""
    bake = tmp_path / "bake.usda"
    assert run("simulate", sim, "-o", bake)[0] == 0
    before = bake.read_bytes()
    status, out, err = run("simulate", sim, "-o", bake)
    assert (status, out) == (2, "")
    assert err == (f"usdsplat: {bake}: found a file, expected a new name, or --resume or --force\n")
    assert bake.read_bytes() == before
    assert run("simulate", sim, "-o", bake, "--frames", "1:2", "--force")[0] == 0
    assert Usd.Stage.Open(str(bake)).GetRootLayer().customLayerData != {}
    assert bake.read_bytes() != before


def test_resume_has_nothing_to_do_where_all_is_there(run, sim, tmp_path):
    """Oracle: the report, and the samples' bytes."""
    bake = tmp_path / "bake.usda"
    assert run("simulate", sim, "-o", bake)[0] == 0
    before = (tmp_path / "bake_data" / "samples.usdc").read_bytes()
    status, _, err = run("simulate", sim, "-o", bake, "--resume")
    assert (status, err) == (0, "usdsplat: nothing to do: all frames are baked already\n")
    assert (tmp_path / "bake_data" / "samples.usdc").read_bytes() == before


def test_resume_refuses_other_parameters(run, sim, tmp_path):
    """Oracle: one sentence; the bake is still there."""
    bake = tmp_path / "bake.usda"
    assert run("simulate", sim, "-o", bake)[0] == 0
    status, _, err = run("simulate", sim, "-o", bake, "--resume", "--set", "settle:omega=1")
    assert status == 2 and err.count("\n") == 1 and ": found " in err
    assert bake.exists()


def test_a_bake_that_fails_before_its_first_checkpoint_leaves_nothing(
    run, sim, tmp_path, monkeypatch
):
    """Oracle: the listing; the folder of the results was made by the command, too."""
    from usdsplat.sim.stage.simulation import Simulation

    def fail(self):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = sorted(os.listdir(tmp_path))
    monkeypatch.setattr(Simulation, "advance", fail)
    status, _, err = run("simulate", sim, "-o", tmp_path / "new" / "a.usda")
    assert (status, err.count("\n")) == (2, 1)
    assert sorted(os.listdir(tmp_path)) == before


def test_a_late_error_does_not_remove_a_complete_bake(run, sim, tmp_path, monkeypatch):
    """Oracle: `validate`; the error is that of synchronising the folder after all renames."""
    from usdsplat.sim.stage.bake_layers import BakeLayers

    show = BakeLayers.show_merged

    def late(self, *args):
        show(self, *args)
        raise OutputError(str(self.target), "no space", "a writable place")

    monkeypatch.setattr(BakeLayers, "show_merged", late)
    assert run("simulate", sim, "-o", tmp_path / "a.usda")[0] == 2
    assert run("validate", tmp_path / "a.usda")[0] == 0
    assert (tmp_path / "a_data" / "samples.usdc").exists()


def test_an_interrupted_bake_is_a_finding_until_it_is_resumed(run, sim, tmp_path, monkeypatch):
    """Oracle: the codes of `validate` and `render`; the frames on the disk are those that the
    checkpoint after the second of four frames needs: the first; and the checkpoint to add frames
    from."""
    from usdsplat.sim.stage.simulation import Simulation

    advance = Simulation.advance

    def stop(self):
        if all(solver.frame().time == 3 for solver in self.solvers.values()):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        advance(self)

    bake = tmp_path / "a.usda"
    simulate = ("simulate", sim, "-o", bake, "--frames", "1:4")
    with monkeypatch.context() as patch:
        patch.setattr(Simulation, "advance", stop)
        assert run(*simulate)[0] == 2
    needed = ["00.000000.frame", "checkpoint", "kept_checkpoint"]
    assert sorted(os.listdir(tmp_path / "a_data")) == needed
    picture = ("render", bake, "-o", tmp_path / "a.png", "--resolution", "16x12")
    for words in (("validate", bake), picture):
        status, out, _ = run(*words, "--json")
        found = [each for each in json.loads(out)["findings"] if each["code"] == "unfinished-bake"]
        assert [each["found"] for each in found] == [
            "a.usda, an interrupted bake, with 0 frames complete"
        ]
        assert status == (1 if words[0] == "validate" else 0)
    assert run(*simulate, "--resume")[0] == 0
    for words in (("validate", bake), picture):
        _, out, _ = run(*words, "--json")
        codes = [each["code"] for each in json.loads(out)["findings"]]
        assert "unfinished-bake" not in codes


def stopped_at(monkeypatch, frame, error=KeyboardInterrupt):
    """Make simulations end by an error instead of the step to a frame."""
    from usdsplat.sim.stage.simulation import Simulation

    advance = Simulation.advance

    def stop(self):
        if all(solver.time == frame - 1 for solver in self.solvers.values()):
            raise error
        advance(self)

    monkeypatch.setattr(Simulation, "advance", stop)


def test_an_interruption_says_how_to_go_on(run, sim, tmp_path, monkeypatch):
    """Oracle: the commands, which continue the bake: after its second frame, or from the start."""
    bake = tmp_path / "a b.usda"
    words = ("simulate", sim, "-o", bake, "--frames", "1:4", "--set", "settle:omega=3")
    go_on = f"usdsplat {shlex.join(map(str, words))} --resume"
    for frame, sentence in ((4, "go on after frame 2 with"), (2, "begin again with")):
        with monkeypatch.context() as patch:
            stopped_at(patch, frame)
            status, _, err = run(*words, "--force")
        assert status == 130
        assert err.splitlines()[-1] == f"usdsplat: interrupted; {sentence}: {go_on}"
    assert run(*shlex.split(go_on)[1:])[0] == 0
    assert run(*words, "--force")[0] == 0


def test_a_finished_bake_gets_more_frames(run, sim, tmp_path):
    """Oracle: the bytes of all frames at once; the frames that were simulated."""
    whole, other = tmp_path / "whole" / "a.usda", tmp_path / "other" / "a.usda"
    frames = ("--set", "settle:omega=3", "--frames")
    assert run("simulate", sim, "-o", whole, *frames, "1:5")[0] == 0
    assert run("simulate", sim, "-o", other, *frames, "1:3")[0] == 0
    status, out, _ = run("simulate", sim, "-o", other, *frames, "1:5", "--resume", "--json")
    assert status == 0 and json.loads(out)["frames"] == 4
    for name in ("a.usda", "a_data/samples.usdc", "a_data/kept_checkpoint"):
        assert (other.parent / name).read_bytes() == (whole.parent / name).read_bytes()
    drop = ("--resume", "--drop-checkpoint")
    assert run("simulate", sim, "-o", other, *frames, "1:5", *drop)[0] == 0
    assert os.listdir(other.parent / "a_data") == ["samples.usdc"]
    status, _, err = run("simulate", sim, "-o", other, *frames, "1:6", "--resume")
    assert status == 2 and "found a bake without a_data/kept_checkpoint" in err


def test_the_phases_of_the_preparation_are_in_the_report(run, sim, tmp_path):
    """Oracle: the names of what this simulation prepares."""
    _, out, _ = run("simulate", sim, "-o", tmp_path / "bake.usda", *FRAMES, "--json")
    phases = json.loads(out)["phases"]
    assert {"reading the captures", "reading the stage", "hashing the inputs", "beginning",
            "simulating", "merging the samples"} <= phases.keys()  # fmt: skip
    assert all(seconds >= 0 for seconds in phases.values())


def test_an_interrupted_bake_goes_on_bit_for_bit(run, sim, tmp_path, monkeypatch):
    """Oracle: the same bake, never interrupted."""
    from usdsplat.sim.stage.simulation import Simulation

    whole, broken = tmp_path / "whole.usda", tmp_path / "broken.usda"
    assert run("simulate", sim, "-o", whole)[0] == 0
    advance, count = Simulation.advance, 0

    def stop(self):
        nonlocal count
        count += 1
        if count == 2:
            raise KeyboardInterrupt
        advance(self)

    monkeypatch.setattr(Simulation, "advance", stop)
    try:
        status = run("simulate", sim, "-o", broken)[0]
    except KeyboardInterrupt:
        status = 130
    assert status != 0
    monkeypatch.undo()
    status, out, _ = run("simulate", sim, "-o", broken, "--resume", "--json")
    assert status == 0 and json.loads(out)["frames"] == 1
    for frame in (1, 2, 3):
        assert np.array_equal(positions(whole, frame), positions(broken, frame))


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("{sim}", "-o", "/"), "--output: found '/', expected a file"),
        ((), "simulate: found no STAGE, expected a stage or capture, and -o FILE"),
        (("{sim}",), "simulate: found no --output, expected a stage or capture, and -o FILE"),
        (("{ply}", "-o", "{out}"), "which is a capture, expected a stage with a SplatSim prim"),
        (("{shot}", "-o", "{out}"), "found no SplatSim prim, expected one; usdsplat simulate --pr"),
        (("{sim}", "-o", "{sim}"), "sim.usda: found "),
        (("{sim}", "-o", "{out}c"), "found the suffix '.usdac', expected .usda"),
        (("{sim}", "-o", "{ply}/out.usda"), "No such file or directory, expected a folder"),
        (("{sim}", "-o", "{out}", "--frames", "3:1"), "frames: found "),
        (("{sim}", "-o", "{out}", "--frames", "1:9x2"), "expected every frame from one to another"),
        (("{sim}", "-o", "{out}", "--frames", "soon"), "expected a range such as"),
        (("{sim}", "-o", "{out}", "--set", "rd:feed"), "expected [/PRIM.]group:name=value"),
        (("{sim}", "-o", "{out}", "--set", "rd:fed=0.04"), "'rd:fed', expected such as rd:feed"),
        (("{sim}", "-o", "{out}", "--set", "rd:feed=7"), "rd:feed: found 7.0, expected 0 to 0.1"),
        (("{sim}", "-o", "{out}", "--set", "rd:feed=nan"), "rd:feed: found nan, expected 0 to"),
        (("{sim}", "-o", "{out}", "--set", "rd:feed=much"), "found 'much', expected 0 to 0.1"),
        (("{sim}", "-o", "{out}", "--set", "affector:blend=inf"), "affector:blend: found inf, exp"),
        (("{sim}", "-o", "{out}", "--set", "/No.rd:feed=0.04"), "found no SplatSim prim /No, exp"),
        (("{sim}", "-o", "{out}", "--set", "deform:a:angle=9"), "found no deform 'a', expected"),
        (("{sim}", "-o", "{out}", "--device", "abacus"), "found "),
        (("{sim}", "-o", "{out}", "--threads", "0"), "found "),
        (("--preset", "melt", "{ply}", "-o", "{out}"), "found 'melt', expected one of grow, push"),
        (("--preset", "push", "{ply}", "-o", "{out}", "--frames", "1:2"), "--frames: found --pres"),
        (("--preset", "push", "{sim}", "-o", "{out}", "--axes", "rdf"), "--axes: found a stage"),
        (("--preset", "push", "{ply}no", "-o", "{out}"), "found "),
    ],
)
def test_what_cannot_be_asked_for_is_one_sentence(words, sentence, run, sim, shot, capture):
    """Oracle: where: found X, expected Y; nothing is written."""
    names = {"sim": sim, "shot": shot, "ply": capture, "out": sim.with_name("out.usda")}
    before = sorted(sim.parent.iterdir())
    status, out, err = run("simulate", *(word.format(**names) for word in words))
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: ") and err.count("\n") == 1
    assert ": found " in err and ", expected " in err and sentence in err
    assert sorted(sim.parent.iterdir()) == before


def test_progress_is_lines_where_nobody_watches(run, sim, tmp_path, monkeypatch):
    """Oracle: the frames that are to be done, as plain lines on stderr."""
    monkeypatch.setattr("usdsplat.cli.progress.INTERVALS", ((float("inf"), 0.0),))
    err = run("simulate", sim, "-o", tmp_path / "bake.usda")[2]
    shown = re.findall(r"^usdsplat: simulating (\d)/3 ", err, re.MULTILINE)
    assert shown[-1] == "3" and sorted(shown) == shown
