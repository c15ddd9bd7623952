"""Tests that `validate` finds what `render` stops at or complains of."""

from __future__ import annotations

import json

import pytest
from pxr import Gf, UsdGeom, UsdRender

from tests.products.mutated_stages import MUTATIONS, base, mutated
from usdsplat.core.findings import finding
from usdsplat.products.checking import MOST_TIMES

pytestmark = pytest.mark.usefixtures("compiled")

FLAGS = ("--device", "cpu", "--frames", "1-2", "--json")
COUNT = 200


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
    names = mutated(path, seed)
    status, out, err = run("render", path, "-o", tmp_path / "a.####.exr", *FLAGS)
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


def test_more_times_than_are_checked_are_said_and_the_last_is_checked(run, tmp_path):
    """Oracle: a mistake at the last of too many samples, and the number that is authored."""
    path = tmp_path / "long.usda"
    stage = base(path)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/W/Floor"))
    op = mesh.AddTranslateOp()
    for time in range(2 * MOST_TIMES):
        op.Set(Gf.Vec3d(0, 0, 0), time)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], 2 * MOST_TIMES - 2)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 99], 2 * MOST_TIMES - 1)
    stage.SetEndTimeCode(2 * MOST_TIMES - 1)
    stage.GetRootLayer().Save()
    _, out, _ = run("validate", path, "--json")
    findings = {each["code"]: each for each in json.loads(out)["findings"]}
    assert findings["not-all-checked"]["found"] == f"{2 * MOST_TIMES} times with a sample"
    assert findings["not-drawn"]["path"] == "/W/Floor"


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
