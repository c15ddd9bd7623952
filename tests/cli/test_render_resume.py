"""Tests of `usdsplat render --resume`: which existing files are kept."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from tests.cli.test_render import SMALL, read

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
