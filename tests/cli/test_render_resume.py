"""Tests of `usdsplat render --resume`: which existing files are kept."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.cli.conftest import ball
from tests.cli.test_render import SMALL, read
from usdsplat import formats
from usdsplat.products import preparing, stamp

pytestmark = pytest.mark.usefixtures("compiled")


def test_resume_draws_what_is_missing(run_json, shot, tmp_path):
    """Oracle: the file that was there is not touched, the others come."""
    output = tmp_path / "a.%d.png"
    run_json("render", shot, "-o", output, "--frames", "2", *SMALL)
    os.utime(tmp_path / "a.2.png", (1, 1))
    report = run_json("render", shot, "-o", output, "--frames", "1-3", "--resume", *SMALL)
    assert [item["frame"] for item in report["pictures"]] == [1, 3]
    assert report["skipped"] == [str(tmp_path / "a.2.png")]
    assert (tmp_path / "a.2.png").stat().st_mtime == 1


def test_resume_knows_frames_between_whole_ones(run, run_json, shot, tmp_path):
    """Oracle: a header has 1.1 in single precision, which is no other frame."""
    words = ("render", shot, "-o", tmp_path / "a.####.#.exr", "--frames", "1-1.2x0.1", *SMALL)
    assert len(run_json(*words)["pictures"]) == 3
    status, out, err = run(*words, "--resume", "--json")
    assert status == 0 and "every file exists already" in err
    assert json.loads(out)["pictures"] == []


def test_resume_draws_again_what_is_no_whole_picture_or_another_one(run, shot, tmp_path):
    """Oracle: the names that are printed, the reason on stderr, and files of the same run without
    --resume, bit for bit."""
    render = ("render", shot, "-o", tmp_path / "a.%d.exr", "--frames", "1-4", *SMALL)
    assert run(*render)[0] == 0
    expected = {path.name: read(path) for path in tmp_path.glob("a.*.exr")}
    assert len(expected) == 4
    (tmp_path / "a.1.exr").write_bytes(b"")
    whole = (tmp_path / "a.2.exr").read_bytes()
    (tmp_path / "a.2.exr").write_bytes(whole[:-1])
    other = ("render", shot, "-o", tmp_path / "a.3.exr", "--frames", "3")
    for flags, why in (
        (("--resolution", "20x10"), "a picture of 20x10"),
        ((*SMALL, "--aovs", "color,Z"), "a picture with other channels"),
        ((*SMALL, "--samples", "2"), "a picture with another samples in its header"),
        ((*SMALL, "--deep"), "a deep picture"),
        ((*SMALL, "--frames", "1"), "a picture with another frame in its header"),
    ):
        assert run(*other, *flags)[0] == 0, flags
        status, out, err = run(*render, "--resume")
        assert status == 0, err
        again = ["a.1.exr", "a.2.exr"] if "20x10" in why else []
        assert [Path(line).name for line in out.splitlines()] == [*again, "a.3.exr"]
        assert f"a.3.exr: found {why}; it is drawn again" in err
        assert all(f"{name}: found a truncated file; it is drawn again" in err for name in again)
        for name, picture in expected.items():
            np.testing.assert_array_equal(read(tmp_path / name), picture)


def test_resume_with_nothing_to_do_says_so(run, shot, tmp_path):
    """Oracle: one remark, no result, status 0."""
    assert run("render", shot, "-o", tmp_path / "a.png", *SMALL)[0] == 0
    found = run("render", shot, "-o", tmp_path / "a.png", "--resume", *SMALL)
    assert found == (0, "", "usdsplat: nothing to do: every file exists already\n")


def test_resume_keeps_deep_pictures_with_the_same_samples_and_channels(run, shot, tmp_path):
    """Oracle: the names that are printed, and the reason on stderr."""
    deep = ("render", shot, "-o", tmp_path / "d.exr", "--deep", "--frames", 1, *SMALL)
    deep = (*deep, "--no-compare", "--samples", "4", "--resume")
    first, again, other = run(*deep), run(*deep), run(*deep, "--aovs", "color,Z,id")
    assert [status for status, _, _ in (first, again, other)] == [0, 0, 0]
    assert "d.exr" in first[1] and again[1] == ""
    assert "d.exr" in other[1]
    assert "d.exr: found a picture with other channels; it is drawn again" in other[2]


@pytest.mark.parametrize(("first", "then"), [(2, 6), (6, 2), (8, 4)])
def test_resume_compares_the_ranks_of_cryptomattes(run, shot, tmp_path, first, then):
    """Oracle: the names that are printed, and the reason on stderr; an odd number of ranks has the
    channels of the next even one."""
    render = ("render", shot, "-o", tmp_path / "a.exr", "--aovs", "color,cryptoObject", *SMALL)
    render = (*render, "--frames", 1, "--resume", "--crypto-rank")
    assert "a.exr" in run(*render, first)[1]
    for same in (first, max(2, first - 1)):
        assert run(*render, same)[:2] == (0, "")
    status, out, err = run(*render, then)
    assert status == 0 and "a.exr" in out
    assert "found a picture with other channels; it is drawn again" in err
    assert run(*render, then)[:2] == (0, "")


def test_resume_draws_again_after_an_edit_of_the_stage(run, shot, tmp_path):
    """Oracle: the names that are printed; a comment changes the bytes of the stage, no value."""
    render = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *SMALL, "--resume")
    assert run(*render)[1] != "" and run(*render)[1] == ""
    layer = Sdf.Layer.FindOrOpen(str(shot))
    layer.comment = "edited"
    layer.Save()
    status, out, err = run(*render)
    assert status == 0 and "a.exr" in out
    assert "found a picture of another version of the stage's files" in err


MADE = "found a picture made with another setting, file or version of usdsplat"


@pytest.mark.parametrize(
    "flags",
    [
        ("--camera", "/World/Other"), ("--color-mode", "display"), ("--float",),
        ("--sorting", "cameraDistance"), ("--purposes", "default"), ("--metadata", "take=2"),
        ("--variant", "/World:look=b"), ("--mask", "/World"), ("--holdout", "held.exr"),
    ],
    ids=" ".join,
)  # fmt: skip
def test_resume_draws_again_with_another_flag(run, shot, tmp_path, monkeypatch, flags):
    """Oracle: the names that are printed, and the sentence; the second time there is nothing to
    do."""
    stage = Usd.Stage.Open(str(shot))
    UsdGeom.Camera.Define(stage, "/World/Other").AddTranslateOp().Set((0, 0, 6))
    looks = stage.GetPrimAtPath("/World").GetVariantSets().AddVariantSet("look")
    looks.AddVariant("a")
    looks.AddVariant("b")
    looks.SetVariantSelection("a")
    stage.Save()
    monkeypatch.chdir(tmp_path)
    held = ("--aovs", "Z", "--camera", "/World/Cam", *SMALL)
    assert run("render", shot, "-o", "held.exr", "--frames", 1, *held)[0] == 0
    render = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *SMALL, "--resume")
    assert "a.exr" in run(*render)[1] and run(*render)[1] == ""
    status, out, err = run(*render, *flags)
    assert status == 0 and "a.exr" in out
    assert f"a.exr: {MADE}; it is drawn again" in err
    assert run(*render, *flags)[:2] == (0, "")


@pytest.mark.parametrize("suffix", ["exr", "png", "jpg", "webp"])
def test_resume_keeps_what_other_machines_and_folders_made(run, shot, tmp_path, suffix):
    """Oracle: nothing is printed, by hand: names of files, threads, memory and devices that are
    chosen decide no pixel."""
    (tmp_path / "moved").mkdir()
    other = shot.rename(tmp_path / "moved" / "other.usda")
    render = ("--frames", "1-2", *SMALL, "--resume")
    pictures = tmp_path / f"a.%d.{suffix}"
    assert run("render", other, "-o", pictures, *render)[1].count("\n") == 2
    other.rename(shot)
    more = ("--threads", 2, "--memory-limit", "4G", "--node-memory", 100, "--device", "cpu")
    assert run("render", shot, "-o", pictures, *render, *more)[:2] == (0, "")
    for path in tmp_path.glob(f"a.*.{suffix}"):
        path.rename(path.with_name(f"b{path.name[1:]}"))
    assert run("render", shot, "-o", tmp_path / f"b.%d.{suffix}", *render)[:2] == (0, "")


def test_resume_draws_again_with_another_config_of_the_environment(
    run, shot, tmp_path, monkeypatch
):
    """Oracle: the sentence, where a view is used, and only there; by hand."""
    view = ("--color-mode", "display", "--display", "sRGB - Display")
    for flags, told in ((view, MADE), ((), "nothing to do")):
        name = tmp_path / f"{len(flags)}.png"
        render = ("render", shot, "-o", name, "--frames", 1, *SMALL, "--resume", *flags)
        monkeypatch.delenv("OCIO", raising=False)
        assert name.name in run(*render)[1]
        monkeypatch.setenv("OCIO", "ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3")
        status, _, err = run(*render)
        assert status == 0 and told in err


def test_resume_draws_again_if_a_holdout_was_written_again(run, shot, tmp_path):
    """Oracle: the names that are printed. Another name of the holdout is none of the picture's."""
    held, moved = tmp_path / "held.exr", tmp_path / "moved.exr"
    render = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *SMALL, "--resume")
    for frame in (1, 3):
        assert run("render", shot, "-o", held, "--frames", frame, "--aovs", "Z", *SMALL)[0] == 0
        assert "a.exr" in run(*render, "--holdout", held)[1]
        held.rename(moved)
        assert run(*render, "--holdout", moved)[:2] == (0, "")


def test_resume_draws_again_if_the_capture_or_its_axes_differ(run, tmp_path):
    """Oracle: the names that are printed, and the sentence."""
    capture = tmp_path / "a.ply"
    formats.write(ball(), capture)
    render = ("render", capture, "-o", tmp_path / "a.png", *SMALL, "--resume")
    assert "a.png" in run(*render)[1] and run(*render)[1] == ""
    formats.write(ball(seed=1), capture)
    for words in (render, (*render, "--axes", "luf")):
        status, out, err = run(*words)
        assert status == 0 and "a.png" in out and f"a.png: {MADE}; it is drawn again" in err
        assert run(*words)[:2] == (0, "")


def test_resume_draws_again_if_the_fitted_frames_differ(run, shot, tmp_path):
    """Oracle: the pictures of the command without --resume, as its camera sees other frames."""
    stage = Usd.Stage.Open(str(shot))
    stage.RemovePrim("/World/Cam")
    stage.Save()
    render = ("render", shot, "-o", tmp_path / "a.%d.exr", *SMALL)
    assert run(*render, "--frames", "1-2")[0] == 0
    status, out, err = run(*render, "--frames", "1-4", "--resume")
    assert status == 0 and out.count("\n") == 4 and err.count(MADE) == 2
    again = {path.name: read(path) for path in tmp_path.glob("a.*.exr")}
    assert run(*render, "--frames", "1-4")[0] == 0
    for name, picture in again.items():
        np.testing.assert_array_equal(read(tmp_path / name), picture)


def test_resume_draws_again_what_another_version_drew(run, shot, tmp_path, monkeypatch):
    """Oracle: the names that are printed, and the sentence."""
    render = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *SMALL, "--resume")
    assert run(*render)[0] == 0
    monkeypatch.setattr(stamp, "__version__", "99.0")
    status, out, err = run(*render)
    assert status == 0 and "a.exr" in out and MADE in err


def test_resume_keeps_pictures_without_a_stamp(run, shot, tmp_path, monkeypatch):
    """Oracle: nothing is printed: earlier versions wrote none, and nobody knows their flags."""
    render = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *SMALL, "--resume")
    with monkeypatch.context() as earlier:
        earlier.setattr(preparing.Preparation, "lasting_stamp", lambda *known: "")
        assert run(*render)[0] == 0
    assert run(*render, "--sorting", "cameraDistance")[:2] == (0, "")
