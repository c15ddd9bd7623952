"""Tests of bundles for farms: jobs that `openjd run` carries out, with all that they read."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdUtils, Vt

from tests.cli.conftest import ball
from tests.cli.test_lod_jobs import files
from tests.delegate.surface_stages import (
    add_light,
    add_material,
    add_mesh,
    add_texture,
    bind,
    write_picture,
)
from tests.products.test_tiles import content
from usdsplat import formats, schema
from usdsplat.sim.stage.authoring import author

pytestmark = pytest.mark.usefixtures("compiled")
CPU = ("--device", "cpu")
EXTENSIONS = ("--extensions", "TASK_CHUNKING")


def openjd(verb, template, *words):
    """Run `openjd`, and return what it printed."""
    program = Path(sys.executable).with_name("openjd")
    path = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [program, verb, template, *EXTENSIONS, *map(str, words)],
        capture_output=True, text=True, env={**os.environ, "PATH": path}, timeout=600,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def checked(folder):
    """The template of a bundle, which the parser of Open Job Description accepts."""
    model = pytest.importorskip("openjd.model")
    text = (folder / "template.yaml").read_text()
    template = json.loads(text)
    model.decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    return template


def run_words(step):
    """The words of the tasks of a step."""
    return step["script"]["actions"]["onRun"]["args"]


# --- pictures ------------------------------------------------------------------------------


def added(root, path, make):
    """Write a layer with a default prim /Part that `make` fills, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Part").GetPrim())
    make(stage)
    stage.Save()
    return os.path.relpath(path, root)


@pytest.fixture
def needy(tmp_path):
    """A stage in a folder `show/shot` that reads 13 other files in other folders."""
    shot, lib = tmp_path / "show" / "shot", tmp_path / "show" / "lib"
    rng = np.random.default_rng(1)
    for name in ("wood.png", "tile.1001.png", "tile.1002.png"):
        (lib / "tex").mkdir(parents=True, exist_ok=True)
        write_picture(lib / "tex" / name, rng.integers(0, 255, (8, 8, 3), np.uint8))
    scan = added(shot, lib / "scan.usdc", lambda stage: schema.author(stage, "/Part/F", ball()))
    leaf = added(lib, lib / "set" / "leaf.usda", lambda s: schema.author(s, "/Part/F", ball(40)))

    def textured(stage):
        mesh = add_mesh(stage, "/Part/Strip")
        coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex"
        )
        coordinates.Set([Gf.Vec2f(x, y) for x in (0, 0.5, 1) for y in (0, 1)])
        for name, file in (("Wood", "wood.png"), ("Tiles", "tile.<UDIM>.png")):
            material = add_material(stage, f"/Part/{name}")
            add_texture(stage, f"/Part/{name}", f"../tex/{file}")
            if name == "Wood":
                bind(mesh, material)
        part = stage.DefinePrim("/Part/Leaf")
        part.GetReferences().AddReference(f"./{Path(leaf).name}")
        UsdGeom.XformCommonAPI(part).SetTranslate((0.5, 0.5, 0))

    parts = added(shot, lib / "set" / "parts.usda", textured)
    clips = []
    for frame in (1, 2):

        def moved(stage, frame=frame):
            schema.author(stage, "/Part", ball(100, seed=frame), time=frame)

        clips.append(added(shot, lib / "clips" / f"field.{frame}.usda", moved))
    manifest = added(
        shot, lib / "clips" / "manifest.usda", lambda s: schema.author(s, "/Part", ball(100))
    )
    rest = added(shot, lib / "clips" / "rest.usda", lambda s: schema.author(s, "/Part", ball(100)))
    look = added(shot, shot / "look.usda", lambda s: s.OverridePrim("/World/Scan"))
    layout = added(shot, shot / "layout.usda", lambda s: s.DefinePrim("/World", "Xform"))
    layer = Sdf.Layer.FindOrOpen(str(shot / layout))
    layer.subLayerPaths.append(f"./{look}")
    layer.Save()
    stage = Usd.Stage.CreateNew(str(shot / "shot #1 ü.usda"))
    stage.GetRootLayer().subLayerPaths.append(f"./{layout}")
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(2)
    UsdGeom.Xform.Define(stage, "/World")
    stage.DefinePrim("/World/Scan", "Xform").GetReferences().AddReference(scan)
    stage.DefinePrim("/World/Parts", "Xform").GetPayloads().AddPayload(parts)
    clipped = stage.DefinePrim("/World/Clipped")
    clipped.GetReferences().AddReference(rest)
    api = Usd.ClipsAPI(clipped)
    api.SetClipAssetPaths(Sdf.AssetPathArray([Sdf.AssetPath(each) for each in clips]))
    api.SetClipManifestAssetPath(Sdf.AssetPath(manifest))
    api.SetClipPrimPath("/Part")
    api.SetClipActive(Vt.Vec2dArray([Gf.Vec2d(1, 0), Gf.Vec2d(2, 1)]))
    api.SetClipTimes(Vt.Vec2dArray([Gf.Vec2d(1, 1), Gf.Vec2d(2, 2)]))
    add_light(stage, "/World/Light")
    camera = UsdGeom.Camera.Define(stage, "/World/Cam")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.5, 0.3, 4))
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.1, 100))
    stage.Save()
    return shot / "shot #1 ü.usda"


PICTURE = ("--resolution", "80x50", *CPU)


@pytest.fixture
def bundle(run, needy, tmp_path):
    """A bundle of the pictures of a stage, whose stage and its files are gone afterwards; and the
    pictures of one process, by name."""
    run("render", needy, "-o", tmp_path / "alone" / "a.##.exr", *PICTURE)
    alone = {each.name: content(each)[0][3] for each in (tmp_path / "alone").iterdir()}
    assert len(set(alone.values())) == 2
    words = ("render", needy, "-o", "a.##.exr", *PICTURE, "--openjd", tmp_path / "bundle")
    status, out, err = run(*words)
    assert (status, err) == (0, "") and out == f"{tmp_path / 'bundle' / 'template.yaml'}\n"
    (tmp_path / "show").rename(tmp_path / "gone")
    return tmp_path / "bundle", alone


def drawn(folder):
    return {each.name: content(each)[0][3] for each in folder.iterdir()}


def test_a_bundle_has_all_files_of_its_stage(bundle, run, tmp_path):
    """Oracle: `UsdUtils` and the engine: the files of the stage, all in the bundle, and the pixels
    of the stage that was copied, from another folder."""
    folder, alone = bundle
    checked(folder)
    moved = tmp_path / "elsewhere 2"
    folder.rename(moved)
    (stage,) = moved.glob("assets/*#1*")
    layers, assets, missing = UsdUtils.ComputeAllDependencies(str(stage))
    found = {Path(each.realPath) for each in layers} | {Path(each) for each in assets}
    assert len(found) == 13 and not missing
    assert found == {each for each in (moved / "assets").rglob("*") if each.is_file()}
    assert run("render", stage, "-o", tmp_path / "b" / "a.##.exr", *PICTURE)[0] == 0
    assert drawn(tmp_path / "b") == alone
    # a layer elsewhere that has the stage as a sublayer, as a bake has
    (tmp_path / "c").mkdir()
    above = Sdf.Layer.CreateNew(str(tmp_path / "c" / "above.usda"))
    above.subLayerPaths.append(os.path.relpath(stage, tmp_path / "c"))
    above.startTimeCode, above.endTimeCode = 1, 2
    above.Save()
    assert run("render", above.realPath, "-o", tmp_path / "d" / "a.##.exr", *PICTURE)[0] == 0
    assert drawn(tmp_path / "d") == alone


@pytest.mark.slow
def test_a_moved_bundle_is_drawn_with_path_mapping(bundle, tmp_path):
    """Oracle: pixels of one process, by `openjd run` in the folder to which the bundle was moved,
    and with parameters that name the old folder and rules that map it to the new one."""
    folder, alone = bundle
    moved = tmp_path / "far" / "b ü"
    moved.parent.mkdir()
    folder.rename(moved)
    openjd("run", moved / "template.yaml")
    assert drawn(moved / "out") == alone
    (stage,) = moved.glob("assets/*#1*")
    rule = {
        "source_path_format": "POSIX", "source_path": str(folder), "destination_path": str(moved),
    }  # fmt: skip
    rules = tmp_path / "rules.json"
    rules.write_text(json.dumps({"version": "pathmapping-1.0", "path_mapping_rules": [rule]}))
    openjd(
        "run", moved / "template.yaml", "--path-mapping-rules", f"file://{rules}",
        "-p", f"Stage={folder / 'assets' / stage.name}", "-p", f"OutputFolder={folder / 'again'}",
    )  # fmt: skip
    assert drawn(moved / "again") == alone and not folder.exists()


@pytest.mark.parametrize(
    ("there", "found"),
    [
        ((), "a file"),
        (("a",), "a in it"),
        (("a", "b", "c", "d", "e"), "a, b, c and 2 more in it"),
    ],
    ids=["file", "one", "many"],
)
def test_what_is_in_the_way_of_a_bundle_is_named(run, shot, tmp_path, there, found):
    """Oracle: the sentence, and that the folder is as it was."""
    folder = tmp_path / "bundle"
    if there:
        folder.mkdir()
    else:
        folder.touch()
    for name in there:
        (folder / name).touch()
    status, out, err = run("render", shot, "-o", "a.####.exr", *PICTURE, "--openjd", folder)
    expected = "expected a new folder, or an empty one"
    assert (status, out, err) == (2, "", f"usdsplat: {folder}: found {found}, {expected}\n")
    assert not there or sorted(each.name for each in folder.iterdir()) == list(there)


def test_a_bundle_that_cannot_be_written_leaves_nothing(run, capture, tmp_path, monkeypatch):
    """Oracle: the sentence with the name of the input, and the file system; then the corrected
    command. A file that is there for its check and gone for the copy is one that never copies."""
    missing, folder = tmp_path / "missing.ply", tmp_path / "new" / "bundle"
    status, out, err = run("lod", capture, missing, "-o", "c.usda", "--openjd", folder)
    assert (status, out) == (2, "") and err.startswith(f"usdsplat: {missing}: found no such file")
    assert not folder.parent.exists()
    other = tmp_path / "other.ply"
    formats.write(ball(seed=1), other)
    words = ("lod", capture, other, "-o", "c.usda", "--openjd", folder)
    copy = shutil.copyfile

    def fails(source, target):
        if source == other:
            raise PermissionError(13, "Permission denied", str(source))
        copy(source, target)

    for place in (folder.parent, folder):  # neither is there, then an empty folder
        monkeypatch.setattr(shutil, "copyfile", fails)
        status, out, err = run(*words)
        expected = f"expected what can be copied to {folder / 'assets' / '2'}"
        assert (status, out) == (2, "")
        assert err == f"usdsplat: {other}: found permission denied, {expected}\n"
        assert folder.exists() == (place == folder) and not list(place.glob("*"))
        folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.undo()
    assert run(*words)[0] == 0


@pytest.mark.parametrize("command", ["render", "simulate", "lod"])
def test_inputs_that_are_missing_are_said_before_a_bundle_is_written(run, sim, tmp_path, command):
    """Oracle: by hand: a finding for a sublayer and for a reference; --strict writes nothing."""
    stage = Usd.Stage.Open(str(sim))
    stage.GetRootLayer().subLayerPaths.append("./gone.usda")
    stage.DefinePrim("/World/Gone").GetReferences().AddReference("./lost.usda")
    stage.Save()
    flags = () if command == "lod" else CPU
    output = "a.##.exr" if command == "render" else "b.usda"
    words = (command, sim, "-o", output, *flags, "--openjd", tmp_path / "bundle")
    status, out, err = run(*words, "--strict")
    assert (status, out) == (1, "") and not (tmp_path / "bundle").exists()
    for text in ("[missing-asset] /: found no sublayer", "[missing-asset] /World/Gone: found no"):
        assert err.count(text) == 1
    status, _, again = run(*words)
    assert status == 0 and again.count("[missing-asset]") == 2


def test_a_stage_without_a_simulation_has_no_bundle_of_bakes(run, shot, tmp_path):
    """Oracle: the sentence."""
    status, _, err = run("simulate", shot, "-o", "b.usda", "--openjd", tmp_path / "bundle")
    assert status == 2 and "shot.usda: found no SplatSim prim, expected one" in err
    assert not (tmp_path / "bundle").exists()


# --- bakes and trees -----------------------------------------------------------------------


@pytest.fixture
def simulated(sim):
    """A stage of 4 frames to simulate, with a checkpoint at each frame."""
    stage = Usd.Stage.Open(str(sim))
    author(stage.GetPrimAtPath("/World/Sim"), {"bake:checkpointEvery": 1})
    stage.SetEndTimeCode(4)
    stage.Save()
    return sim


def test_bakes_are_steps_and_a_wedge_is_a_space(run, simulated, tmp_path):
    """Oracle: by hand: a step for each chunk, in order, with a task for each combination, then the
    contact sheet; the parser of Open Job Description."""
    words = ("simulate", simulated, "-o", "b.usda", "--wedge", "settle:omega=4,8", *CPU)
    more = ("--chunk", "2", "--openjd", tmp_path / "bundle", "--sheet-frame", "3")
    assert run(*words, *more)[0] == 0
    template = checked(tmp_path / "bundle")
    steps = {each["name"]: each for each in template["steps"]}
    assert list(steps) == ["part 1", "part 2", "sheet"]
    assert "dependencies" not in steps["part 1"]
    assert steps["part 2"]["dependencies"] == [{"dependsOn": "part 1"}]
    assert steps["sheet"]["dependencies"] == [{"dependsOn": "part 2"}]
    space = {"name": "Bake", "type": "STRING", "range": ["1", "2"]}
    assert steps["part 1"]["parameterSpace"]["taskParameterDefinitions"] == [space]
    first, second, sheet = map(run_words, steps.values())
    assert "--until=2.0" in first and not any(each.startswith("--until") for each in second)
    assert "--combination={{Task.Param.Bake}}" in second and "--resume" in second
    assert "--sheet-frame=3.0" in sheet and "parameterSpace" not in steps["sheet"]
    assert "{{Param.Stage}}" in sheet and "--output={{Param.OutputFolder}}/b.usda" in sheet


def test_a_building_is_four_steps(run, capture, tmp_path):
    """Oracle: by hand, and the parser of Open Job Description. Inputs with one name have folders
    of their own."""
    other = tmp_path / "other" / capture.name
    other.parent.mkdir()
    formats.write(ball(seed=1), other)
    words = ("lod", capture, other, "-o", "city.usda", "--memory-limit", "2G")
    assert run(*words, "--openjd", tmp_path / "bundle")[0] == 0
    template = checked(tmp_path / "bundle")
    steps = {each["name"]: each for each in template["steps"]}
    assert list(steps) == ["begin", "sort", "build", "finish"]
    assert [each.get("dependencies") for each in steps.values()] == [
        None, *([{"dependsOn": name}] for name in ("begin", "sort", "build")),
    ]  # fmt: skip
    assert "--part={{Task.Param.Part}}" in run_words(steps["sort"])
    assert run_words(steps["finish"])[:3] == [
        "lod", "{{Param.Inputs}}/1/ball.ply", "{{Param.Inputs}}/2/ball.ply",
    ]  # fmt: skip
    memory = {"amounts": [{"name": "amount.worker.memory", "min": 2048}]}
    assert all(each["hostRequirements"] == memory for each in steps.values())
    copies = sorted((tmp_path / "bundle" / "assets").rglob("*.ply"))
    assert [each.read_bytes() for each in copies] == [capture.read_bytes(), other.read_bytes()]


@pytest.mark.parametrize(
    ("command", "flags", "sentence"),
    [
        ("simulate", ("--force",), "--force: found --force with a job, expected --resume, or a"),
        ("simulate", ("--set", "sim:seed={{1}}"), "expected "),
        ("lod", ("--chunk", "2"), "--chunk: found --chunk with lod, expected no such flag: its"),
        ("lod", ("--step", "begin"), "--step: found it with --jobs, --dask or --openjd"),
    ],
    ids=lambda each: str(each)[:24],
)
def test_bundles_that_no_farm_can_run_are_refused(run, sim, tmp_path, command, flags, sentence):
    """Oracle: the sentence, and that no bundle is written."""
    words = (command, sim, "-o", "b.usda", *flags, "--openjd", tmp_path / "bundle")
    status, _, err = run(*words)
    assert status == 2 and sentence in err and err.count("\n") == 1
    assert not (tmp_path / "bundle").exists()


@pytest.mark.slow
def test_a_farm_bakes_what_one_process_bakes(run, simulated, tmp_path):
    """Oracle: the bakes of the stage of the bundle by one process, beside it, byte for byte, and
    the same contact sheet."""
    words = ("--wedge", "settle:omega=4,8", *CPU, "--threads", "1")
    bundle = tmp_path / "bundle"
    assert (
        run("simulate", simulated, "-o", "b.usda", *words, "--openjd", bundle, "--chunk", 2)[0] == 0
    )
    openjd("run", bundle / "template.yaml")
    stage = bundle / "assets" / simulated.name
    assert run("simulate", stage, "-o", bundle / "once" / "b.usda", *words)[0] == 0
    assert files(bundle / "out") == files(bundle / "once")


@pytest.mark.slow
def test_a_farm_builds_the_tree_of_one_process(run, tmp_path):
    """Oracle: the files of one process, byte for byte."""
    scans = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for seed, path in enumerate(scans):
        formats.write(ball(3000, seed), path)
    words = ("--leaf-splats", "256", "-q")
    assert run("lod", *scans, "-o", tmp_path / "alone" / "city.usda", *words)[0] == 0
    assert run("lod", *scans, "-o", "city.usda", *words, "--openjd", tmp_path / "bundle")[0] == 0
    openjd("run", tmp_path / "bundle" / "template.yaml")
    assert files(tmp_path / "bundle" / "out") == files(tmp_path / "alone")
