"""Tests of `usdsplat simulate --wedge`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.sim.stage import simulating

AXES = ("--wedge", "settle:omega=0,40", "affector:friction=0,1")
NAMES = [
    "bake_settle-omega=0_affector-friction=0.usda",
    "bake_settle-omega=0_affector-friction=1.usda",
    "bake_settle-omega=40_affector-friction=0.usda",
    "bake_settle-omega=40_affector-friction=1.usda",
]


def opened(path):
    """A picture of Pillow."""
    from PIL import Image

    return Image.open(path)


def over(behind, picture):
    """Colours of a picture over another one, shape (height, width, 3)."""
    behind.alpha_composite(picture)
    return np.asarray(behind)[..., :3]


def files(folder):
    """The bytes of all files in a folder, by name."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def test_each_combination_has_the_bytes_of_a_bake_with_its_values(run, sim, tmp_path):
    """Oracle: bakes of the same names with --set."""
    wedge, alone = tmp_path / "wedge", tmp_path / "alone"
    status, out, _ = run("simulate", sim, "-o", wedge / "bake.usda", *AXES)
    assert status == 0
    assert out.splitlines() == [str(wedge / name) for name in (*NAMES, "bake.png")]
    for name, (omega, friction) in zip(NAMES, ((0, 0), (0, 1), (40, 0), (40, 1)), strict=True):
        sets = ("--set", f"settle:omega={omega}", "--set", f"affector:friction={friction}")
        assert run("simulate", sim, "-o", alone / name, *sets)[0] == 0
    found = files(wedge)
    assert found.pop("bake.png")[:4] == b"\x89PNG"
    assert found == files(alone)
    assert len(set(found.values())) > 4  # the values matter


def test_words_after_the_values_are_the_stage(run, sim, tmp_path):
    """Oracle: the names of the bakes."""
    sheet = tmp_path / "out" / "bake.png"
    words = ("simulate", *AXES, sim, "--frames", "1:2", "-o", sheet.with_suffix(".usda"))
    status, out, _ = run(*words)
    assert status == 0 and [line.rpartition("/")[2] for line in out.splitlines()[:-1]] == NAMES
    assert json.loads(run(*words, "--resume", "--json")[1])["sheet"] == str(sheet)


def test_the_sheet_has_the_pictures_of_the_bakes(run, sim, tmp_path):
    """Oracle: pictures of `render` with the stage's camera, in their cells."""
    stage = Usd.Stage.Open(str(sim))
    camera = UsdGeom.Camera.Define(stage, "/World/Cam")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 3))
    stage.Save()
    target = tmp_path / "bake.usda"
    axes = ("--wedge", "settle:omega=0,40")
    assert run("simulate", sim, "-o", target, *axes, "--sheet-frame", 2)[0] == 0
    page = np.asarray(opened(tmp_path / "bake.png"))
    assert page.shape == (270 + 20 + 24, 2 * 488 + 8, 3)
    for column, omega in enumerate((0, 40)):
        bake, file = tmp_path / f"bake_settle-omega={omega}.usda", tmp_path / f"{omega}.png"
        size = ("--resolution", "480x270", "--frames", 2)
        assert run("render", bake, "-o", file, *size)[0] == 0
        drawn = opened(file).convert("RGBA")
        behind = drawn.copy()
        behind.paste((32, 34, 38, 255), (0, 0, *drawn.size))
        cell = page[36 : 36 + 270, 8 + 488 * column :][:, :480]
        assert np.array_equal(cell, over(behind, drawn))


def test_all_cells_have_one_camera_without_one_on_the_stage(run, sim, tmp_path):
    """Oracle: cells of bakes that move nothing, and show something."""
    axes = ("--wedge", "sim:seed=1,2")
    args = ("--set", "settle:omega=0", "--frames", "1:2")
    assert run("simulate", sim, "-o", tmp_path / "bake.usda", *axes, *args)[0] == 0
    page = np.asarray(opened(tmp_path / "bake.png"))
    first, second = (page[36:306, left : left + 480] for left in (8, 496))
    assert np.array_equal(first, second) and np.ptp(first) > 100


def test_an_interrupted_wedge_goes_on_with_the_bake_that_it_lacks(run, sim, tmp_path, monkeypatch):
    """Oracle: the files of a wedge that was not interrupted; finished bakes are not run again."""
    whole, part = tmp_path / "whole" / "bake.usda", tmp_path / "part" / "bake.usda"
    assert run("simulate", sim, "-o", whole, *AXES)[0] == 0
    made = []
    solve = simulating._run

    def stop(simulation, bake, *rest):
        if len(made) == 2:
            raise StageError("simulate", "an end", "more")
        made.append(bake.target.name)
        return solve(simulation, bake, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(simulating, "_run", stop)
        assert run("simulate", sim, "-o", part, *AXES)[0] == 2
    assert made == NAMES[:2]
    status, out, _ = run("simulate", sim, "-o", part, *AXES, "--resume", "--json")
    assert status == 0
    assert [each["frames"] for each in json.loads(out)["reports"]] == [0, 0, 3, 3]
    assert files(whole.parent) == files(part.parent)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--wedge", "omega"], "--wedge: found 'omega', expected [/PRIM.]group:name=value,value"),
        (["--wedge", "rd:feed="], "--wedge rd:feed: found '', expected values separated by commas"),
        (["--wedge", "rd:feed=1,,2"], "expected values separated by commas"),
        (["--wedge", "rd:feed=.1,.1"], "found '.1,.1', a value twice, expected each value once"),
        (["--wedge", "rd:feed=.1", "rd:feed=.2"], "found rd:feed twice, expected each parameter"),
        (["--wedge", "rd:fed=.1"], "parameter: found 'rd:fed', expected such as rd:feed"),
        (["--wedge", "rd:feed=.03,oak"], "--wedge rd:feed=oak: found 'oak', expected "),
        (["--wedge", "rd:feed=.03,7"], "rd:feed: found 7"),
        (["--wedge", "dissolve:origin=1,2,3"], "found dissolve:origin, which is a list"),
        (["--wedge", "/Nowhere.rd:feed=.1,.2"], "--wedge: found no SplatSim prim /Nowhere"),
        (["--wedge", "rd:feed=" + ",".join(f".{i:03}" for i in range(10, 120))], "more than 100"),
        (["--wedge", "rd:feed=.1", "--sheet-frame", "9"], "--sheet-frame: found 9, expected one"),
        (["--sheet-frame", "2"], "--sheet-frame: found 2 without --wedge, expected both"),
        (["--combination", "1"], "--combination: found 1 without --wedge, expected both"),
        (["--wedge", "rd:feed=.1,.2", "--combination", "3"], "--combination: found 3, expected 1 "),
        (["--wedge", "rd:feed=.1,.2", "--combination", "0"], "--combination: found 0, expected 1 "),
        (
            ["--wedge", "rd:feed=.1", "--combination", "1", "--jobs", "1"],
            "--combination: found it with --jobs, --dask or --openjd, expected one of them",
        ),
        (["--wedge", "rd:feed=.1", "--until", "2"], "--until: found --wedge too, expected one of"),
        (["--wedge"], "found --wedge without a value, expected one"),
        (["--preset", "grow", "--wedge", "rd:feed=.1"], "--wedge: found --preset grow too"),
    ],
)
def test_a_wedge_that_cannot_be_made_writes_nothing(run, sim, tmp_path, words, sentence):
    """Oracle: one sentence, status 2, and the listing."""
    status, out, err = run("simulate", sim, "-o", tmp_path / "out" / "bake.usda", *words)
    assert (status, out) == (2, "") and sentence in err
    assert err.count("\n") == 1 and not (tmp_path / "out").exists()


def test_existing_files_are_not_replaced(run, sim, tmp_path):
    """Oracle: one sentence and the bytes of the last bake's namesake; --force replaces it."""
    there = tmp_path / NAMES[-1]
    there.write_text("mine")
    status, _, err = run("simulate", sim, "-o", tmp_path / "bake.usda", *AXES)
    assert status == 2 and err.startswith(f"usdsplat: {there}: found a file, expected a new name")
    assert there.read_text() == "mine" and not (tmp_path / NAMES[0]).exists()
    assert run("simulate", sim, "-o", tmp_path / "bake.usda", *AXES, "--force")[0] == 0
    assert there.read_text() != "mine"
