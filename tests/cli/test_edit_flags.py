"""Tests of edit flags, which are applied in the order of the command line."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat import formats
from usdsplat.cli.convert import arranged
from usdsplat.cli.convert_options import Options
from usdsplat.cli.edit_flags import edits_of
from usdsplat.cli.parsing import parse
from usdsplat.core.edits import KINDS


@pytest.mark.parametrize(
    "typed",
    [
        "a.ply b.ply --scale 2 --translate 1,0,0 --scale 3",
        "--scale 2 --translate 1,0,0 a.ply --scale 3 b.ply",
        "a.ply --scale=2 b.ply --translate=1,0,0 --json --scale=3",
        "a.ply --json --scale 2 --translate 1,0,0 --scale 3 --axes rub b.ply",
    ],
)
def test_files_and_flags_may_stand_in_any_order_but_edits_keep_theirs(typed) -> None:
    """Oracle: the words, sorted by hand."""
    options = parse(Options, "convert", "", arranged(typed.split()))
    assert (options.source, options.others) == ("a.ply", ("b.ply",))
    assert [str(item) for item in edits_of(options.edit)] == [
        "scale 2",
        "translate 1,0,0",
        "scale 3",
    ]


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("a --drop-outliers b", ["drop-outliers 20,2"]),
        ("a b --drop-outliers", ["drop-outliers 20,2"]),
        ("a b --drop-outliers 8,1.5 --morton", ["drop-outliers 8,1.5", "morton"]),
        ("a b --drop-outliers --drop-nan", ["drop-outliers 20,2", "drop-nan"]),
        ("a b --drop-outliers=8,3 --drop-outliers", ["drop-outliers 8,3", "drop-outliers 20,2"]),
        ("a --translate -1,-2,-3 b", ["translate -1,-2,-3"]),
        ("a b --min_opacity .5 --decimate 12.5%", ["min-opacity 0.5", "decimate 12.5%"]),
    ],
)
def test_values_may_be_left_out_where_there_is_a_usual_one(typed, said) -> None:
    """Oracle: the edits, written out by hand; a file is never taken for a value."""
    options = parse(Options, "convert", "", arranged(typed.split()))
    assert (options.source, options.others) == ("a", ("b",))
    assert [str(item) for item in edits_of(options.edit)] == said


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        ("--rotate", "convert: found --rotate without a value, expected one"),
        ("--rotate --morton", "convert: found --rotate without a value, expected one"),
        ("--rotat 1,2,3", "convert: found --rotat, expected --rotate"),
        ("--rotate 1,2", "--rotate: found 1,2, expected three angles X,Y,Z in degrees"),
        ("--translate a,b,c", "--translate: found 'a,b,c', expected three numbers X,Y,Z"),
        ("--drop-nan=3", "--drop-nan: found 3, expected no number"),
        ("--decimate 150%", "--decimate: found 150%, expected more than 0 % and less than 100 %"),
        ("--min-size 1e9", "--min-size: found no splat left, expected some of the 300 splats"),
        ("--sh-degree 7", "--sh-degree: found 7, expected a whole number from 0 to 4"),
    ],
)
def test_mistakes_are_one_sentence_and_nothing_is_written(run, capture, typed, sentence) -> None:
    """Oracle: where: found X, expected Y; status 2."""
    status, out, err = run("convert", capture, capture.with_name("out.usdc"), *typed.split())
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert list(capture.parent.iterdir()) == [capture]


def test_edits_are_done_in_the_order_in_which_they_are_typed(run, capture, tmp_path) -> None:
    """Oracle: both orders by hand, and the remark on what was dropped."""
    source = formats.read(capture).cloud.positions
    box, move = ("--crop-box", "0,-9,-9,9,9,9"), ("--translate", "0.25,0,0")
    out = run("convert", capture, *box, *move, tmp_path / "first.ply")[1]
    kept = source[source[:, 0] >= 0]
    assert f"  note   crop-box 0,-9,-9,9,9,9: {len(kept)} splats of 300 left" in out
    found = formats.read(tmp_path / "first.ply").cloud.positions
    np.testing.assert_allclose(found, kept + np.float32([0.25, 0, 0]), atol=1e-6)
    run("convert", capture, *move, *box, tmp_path / "then.ply")
    found = formats.read(tmp_path / "then.ply").cloud.positions
    kept = source[source[:, 0] >= -0.25]
    np.testing.assert_allclose(found, kept + np.float32([0.25, 0, 0]), atol=1e-6)


def test_edits_of_a_stage_act_on_the_capture_that_it_becomes(run, shot, tmp_path) -> None:
    """Oracle: y of rdf points down, so what is above is y < 0 there; at frame 4 x is 0.6 more."""
    flags = ("--frame", "4", "--crop-box", "0,-9,-9,9,0,9")
    assert run("convert", shot, tmp_path / "a.ply", *flags)[0] == 0
    run("convert", shot, tmp_path / "whole.ply", "--frame", "4")
    whole = formats.read(tmp_path / "whole.ply").cloud.positions
    kept = whole[(whole[:, 0] >= 0) & (whole[:, 1] <= 0)]
    assert 0 < len(kept) < 300
    np.testing.assert_array_equal(formats.read(tmp_path / "a.ply").cloud.positions, kept)


def test_every_edit_is_in_the_help(run) -> None:
    """Oracle: the table of edits."""
    out = run("convert", "--help")[1]
    assert all(f"--{name}" in out for name in KINDS)
