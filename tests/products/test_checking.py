"""Tests that `validate` finds what `render` stops at or complains of."""

from __future__ import annotations

import json
import math

import pytest
from pxr import UsdRender

from tests.cli.tree_mutations import mutated_tree
from tests.products.mutated_stages import MUTATIONS, base, mutated
from usdsplat.core.findings import Findings, finding
from usdsplat.products import checking
from usdsplat.products.checking import check_stage

pytestmark = pytest.mark.usefixtures("compiled")

FLAGS = ("--device", "cpu", "--frames", "1-2", "--json")
COUNT, FEW = 200, 40


@pytest.mark.parametrize(
    "seed",
    [
        *range(COUNT),
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(COUNT, COUNT + 100)),
    ],
)
def test_whatever_render_says_validate_says(run, tmp_path, seed):
    """Oracle: the contract: code and path of each finding of `render` are among those of
    `validate`, and so is the sentence with which it stops. Every kind of mistake occurs alone or
    with others."""
    path = tmp_path / "shot.usda"
    check_contract(run, path, mutated(path, seed))


@pytest.mark.parametrize(
    "seed",
    [
        *range(FEW),
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(FEW, COUNT)),
    ],
)
def test_whatever_render_says_of_a_tree_validate_says(run, tmp_path, seed):
    """Oracle: as above, on splat trees with damaged tables and chunks."""
    check_contract(run, mutated_tree(seed, tmp_path), [str(seed)])


def check_contract(run, path, names):
    """Check that `validate` says what `render` says of a stage with the named mistakes."""
    status, out, err = run("render", path, "-o", path.with_name("a.####.exr"), *FLAGS)
    _, told, complaint = run("validate", path, "--json")
    assert complaint == "", names
    findings = json.loads(told)["findings"]
    known = {(each["code"], each["path"]) for each in findings}
    if status:
        assert status == 2, (names, err)
        sentence = err.splitlines()[-1].removeprefix("usdsplat: ").partition(", expected ")[0]
        where, _, found = sentence.partition(": found ")
        stop = finding("bad-product", where, found, "")
        wrong = {(each["path"], each["attribute"], each["found"]) for each in findings}
        assert (stop.path, stop.attribute, stop.found) in wrong, (names, sentence)
    else:
        said = {(each["code"], each["path"]) for each in json.loads(out)["findings"]}
        assert said <= known, (names, said - known)


def test_every_mistake_is_made():
    """Oracle: the seeds of the contract go through the table several times."""
    assert len(MUTATIONS) * 3 < COUNT


def checked(stage, **options):
    """The findings on a stage, by code."""
    findings = Findings()
    check_stage(stage, findings, **options)
    return {each.code: each for each in findings}


def test_two_frames_with_one_name_are_found(tmp_path):
    """Oracle: a productName whose two samples are equal in two of three frames."""
    stage = base(tmp_path / "shot.usda")
    assert "bad-product" not in checked(stage)
    stage.SetEndTimeCode(3)
    name = stage.GetPrimAtPath("/Render/Product").GetAttribute("productName")
    for time, value in ((1, "a.exr"), (2, "b.exr"), (3, "a.exr")):
        name.Set(value, time)
    assert checked(stage)["bad-product"].found


@pytest.mark.filterwarnings("ignore")
def test_too_many_times_are_said_and_the_last_is_checked(tmp_path, monkeypatch):
    """Oracle: a camera that is damaged in the last of six frames; four are checked."""
    monkeypatch.setattr(checking, "MOST_TIMES", 4)
    stage = base(tmp_path / "shot.usda")
    stage.SetEndTimeCode(6)
    focal = stage.GetPrimAtPath("/W/Cam").GetAttribute("focalLength")
    for time in range(1, 7):
        focal.Set(-1.0 if time == 6 else 50.0 + time, time)
    found = checked(stage)
    assert found["not-checked"].severity == "note"
    assert "6 times" in found["not-checked"].found
    assert found["bad-camera"].time == 6


@pytest.mark.parametrize("end", [1e30, -math.inf])
def test_a_range_without_end_is_a_finding(tmp_path, end):
    """Oracle: the code; the names of infinitely many frames cannot be checked."""
    stage = base(tmp_path / "shot.usda")
    stage.GetPrimAtPath("/Render/Product").GetAttribute("productName").Set("a.####.exr")
    stage.SetEndTimeCode(end)
    assert f"{end:g}" in checked(stage)["bad-product"].found


def test_two_products_with_one_file_are_found(run, tmp_path, monkeypatch):
    """Oracle: the sentence with which `render` stops."""
    path = tmp_path / "shot.usda"
    stage = base(path)
    other = UsdRender.Product.Define(stage, "/Render/Other")
    other.CreateProductNameAttr("picture.exr")
    settings = UsdRender.Settings(stage.GetPrimAtPath("/Render/Settings"))
    settings.GetProductsRel().AddTarget(other.GetPath())
    stage.GetRootLayer().Save()
    monkeypatch.chdir(tmp_path)
    status, _, err = run("render", path, "--device", "cpu")
    assert status == 2
    status, out, _ = run("validate", path, "--json")
    assert status == 1
    (found,) = (each["found"] for each in json.loads(out)["findings"])
    assert found in err
