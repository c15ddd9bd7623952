"""Tests of `usdsplat relight` as a job, and in parts: the same layer by any number of workers."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux

from tests.cli.test_job_failures import LONG, begun, ended, gate, listening, until, waits
from tests.delegate.scene_delegate.test_lights import sky_picture
from tests.jobs.test_local import children
from tests.kernels.points.splat_shapes import sphere
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.products.lit_times import LitFolder

__all__ = ["gate"]

pytestmark = pytest.mark.usefixtures("compiled")
FAST = ("--dome-samples", "4", "--light-samples", "1", "--device", "cpu")
TIMES = (1.0, 2.0, 2.5, 4.0, 7.0)
ALL = [f"00000{number}.lit" for number in range(6)]


@pytest.fixture
def shot(tmp_path):
    """Return a function that makes a stage that is lit at 5 samples and at its first frame, 0.

    A ball of packed splats grows, and is hidden at the second sample; one that does not change
    casts shadows. The lamp's numbers are wrong from the third sample on, which is a finding.
    """

    def make(times=TIMES):
        path = tmp_path / "in" / "shot.usda"
        path.parent.mkdir(exist_ok=True)
        stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        UsdGeom.SetStageUpAxis(stage, "Y")
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(8)
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
        for name, samples, form in (("Grows", times, "packed"), ("Still", (None,), "half")):
            for number, time in enumerate(samples):
                author_ball(stage, f"/World/{name}", 100 + 20 * number, form, time)
        if times:
            grows = UsdGeom.Imageable(stage.GetPrimAtPath("/World/Grows"))
            grows.CreateVisibilityAttr()
            for time, seen in ((1.0, "inherited"), (2.0, "invisible"), (2.5, "inherited")):
                grows.GetVisibilityAttr().Set(seen, time)
        still = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Still"))
        still.AddTranslateOp().Set(Gf.Vec3d(0, 2.5, 0))
        sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
        sun.CreateIntensityAttr(4.0)
        turn = UsdGeom.Xformable(sun).AddRotateXOp()
        turn.Set(-80.0, 0.0)
        turn.Set(-20.0, 8.0)
        lamp = UsdLux.DistantLight.Define(stage, "/World/Lamp").CreateIntensityAttr()
        lamp.Set(1.0, 2.0)
        lamp.Set(float("inf"), 2.5)
        stage.Save()
        return path

    return make


def author_ball(stage, path, count, form, time):
    shape = sphere(count)
    rng = np.random.default_rng(count)
    names = ("positions", "rotations", "scales", "opacities")
    cloud = SplatCloud(
        **dict(zip(names, shape.splats, strict=True)),
        sh=rng.uniform(-0.3, 0.3, (count, 4, 3)).astype(np.float32),
    )
    schema.author(stage, path, cloud, form=form, time=time)
    schema.author_surface(
        stage.GetPrimAtPath(path), normals=shape.normals, confidence=np.ones(count),
        occlusion=np.zeros(count), time=time,
    )  # fmt: skip


def names(folder):
    return sorted(str(each.relative_to(folder)) for each in folder.rglob("*"))


def saying(told, folder):
    """What a command printed, whatever the folder of its output."""
    status, out, err = told
    return status, out.replace(f"/{folder}/", "/"), err


@pytest.fixture
def read(run):
    """A command, and the JSON object that it prints; its findings are on stderr."""

    def told(*argv):
        status, out, err = run(*argv, "--json")
        assert status == 0, err
        return json.loads(out)

    return told


@pytest.fixture
def alone(run, shot, tmp_path):
    """What one process writes and prints."""
    shot()
    told = run("relight", tmp_path / "in" / "shot.usda", "-o", tmp_path / "alone" / "r.usdc", *FAST)
    assert told[0] == 0 and "Lamp" in told[2], told
    assert names(tmp_path / "alone") == ["r.usdc"]
    return (tmp_path / "alone" / "r.usdc").read_bytes(), saying(told, "alone")


@pytest.fixture
def words(tmp_path):
    """A command that writes the layer into the folder `job`."""
    return ("relight", tmp_path / "in" / "shot.usda", "-o", tmp_path / "job" / "r.usdc", *FAST)


@pytest.mark.parametrize(
    "how",
    [("--jobs", "1"), ("--jobs", "2", "--chunk", "1"), ("--dask", "local", "--chunk", "4")],
    ids=" ".join,
)
def test_a_job_writes_the_layer_of_one_process(run, words, alone, tmp_path, how):
    """Oracle: one process: the bytes of the layer, the report, and the findings in their order."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    told = run(*words, *how)
    assert saying(told, "job") == alone[1]
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]
    assert names(tmp_path / "job") == ["r.usdc"]


def test_json_of_a_job_is_that_of_one_process(read, words, shot, tmp_path):
    """Oracle: one process, but for the name of the layer; the set's picture is the light of the
    photographs."""
    path = shot()
    picture = ("--captured-hdri", sky_picture(tmp_path))
    alone = read("relight", path, "-o", tmp_path / "alone" / "r.usdc", *FAST, *picture)
    made = read(*words, *picture, "--jobs", "2", "--chunk", "2")
    assert made == {**alone, "target": str(tmp_path / "job" / "r.usdc")}
    assert [each["samples"] for each in made["fields"]] == [4, 0] and made["findings"]
    layers = [tmp_path / each / "r.usdc" for each in ("alone", "job")]
    assert layers[0].read_bytes() == layers[1].read_bytes()


@pytest.mark.parametrize("count", [1, 4, 9])
def test_parts_in_any_order_make_the_same_layer(run, read, words, alone, tmp_path, count):
    """Oracle: one process. With 9 parts of 6 times, some are empty."""
    numbers = list(range(1, count + 1))
    random.Random(count).shuffle(numbers)
    lit = [read(*words, "--part", f"{number}/{count}")["times"] for number in numbers]
    assert sum(lit) == 6 and names(tmp_path / "job") == ["r.usdc.parts", *parts(ALL)]
    assert saying(run(*words), "job") == alone[1]
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]
    assert names(tmp_path / "job") == ["r.usdc"]


def parts(files):
    return [f"r.usdc.parts/{each}" for each in files]


def test_the_last_command_lights_what_is_missing_or_damaged(
    run, read, words, alone, tmp_path, monkeypatch
):
    """Oracle: one process; files of the parts that are whole are not written again, and the last
    command lights three times."""
    read(*words, "--part", "1/2")
    folder = tmp_path / "job" / "r.usdc.parts"
    assert names(folder) == ALL[:3]
    kept = (folder / ALL[2]).stat()
    (folder / ALL[0]).write_bytes((folder / ALL[0]).read_bytes()[:-100])
    (folder / ALL[1]).unlink()
    read(*words, "--part", "1/1")
    assert names(folder) == ALL and (folder / ALL[2]).stat().st_mtime_ns == kept.st_mtime_ns
    for number in (3, 4, 5):
        (folder / ALL[number]).unlink()
    found = []
    load = LitFolder.load
    monkeypatch.setattr(LitFolder, "load", lambda *key: found.append(load(*key)) or found[-1])
    assert saying(run(*words), "job") == alone[1]
    assert [each is None for each in found] == [False] * 3 + [True] * 3
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]


def brighter(path):
    stage = Usd.Stage.Open(str(path))
    UsdLux.LightAPI(stage.GetPrimAtPath("/World/Sun")).GetIntensityAttr().Set(2.0)
    stage.Save()
    return ()


@pytest.mark.parametrize("what", ["stage", "flag", "picture", "texture"])
def test_parts_of_something_else_do_not_count(run, read, words, shot, tmp_path, what):
    """Oracle: one process, after the stage, a flag, the picture of the set, or that of a dome was
    changed."""
    path = shot((1.0, 2.0))
    picture, sky = sky_picture(tmp_path, "set.exr"), sky_picture(tmp_path, "sky.exr")
    if what == "texture":
        stage = Usd.Stage.Open(str(path))
        UsdLux.DomeLight.Define(stage, "/World/Sky").CreateTextureFileAttr(sky)
        stage.Save()
    words = (*words, "--captured-hdri", picture)
    read(*words, "--part", "1/1")
    more = {
        "stage": lambda: brighter(path),
        "flag": lambda: ("--ambient", "0.9"),
        "picture": lambda: sky_picture(tmp_path, "set.exr", spot=(0.2, 0.3)) and (),
        "texture": lambda: sky_picture(tmp_path, "sky.exr", spot=(0.2, 0.3)) and (),
    }[what]()
    run(*words, *more)
    run("relight", path, "-o", tmp_path / "alone" / "r.usdc", *words[4:], *more)
    layers = [tmp_path / each / "r.usdc" for each in ("alone", "job")]
    assert layers[0].read_bytes() == layers[1].read_bytes()
    assert names(tmp_path / "job") == ["r.usdc"]


@pytest.mark.parametrize("how", [(), ("--jobs", "2", "--chunk", "1")], ids=["alone", "job"])
def test_a_strict_command_with_findings_writes_nothing(run, words, shot, tmp_path, how):
    """Oracle: status 1 with the findings up to the time of the first one that counts, as in the
    text; no layer and no folder."""
    shot()
    status, out, err = run(*words, *how, "--strict")
    assert (status, out) == (1, "") and not (tmp_path / "job").exists()
    assert [line.split("[")[1].split("]")[0] for line in err.splitlines() if "[" in line] == [
        "estimated-light", "bad-light",
    ]  # fmt: skip
    assert "Lamp.inputs:intensity at 2.5" in err and err.endswith("nothing is written\n")


def test_a_stage_that_is_lit_once_is_one_task(run, words, shot, tmp_path):
    """Oracle: one process: the bytes; the sentence."""
    path = shot(())
    run("relight", path, "-o", tmp_path / "alone" / "r.usdc", *FAST)
    status, _, err = run(*words, "--jobs", "2")
    assert status == 0 and "lit at one time only, so the job is one task" in err
    layers = [tmp_path / each / "r.usdc" for each in ("alone", "job")]
    assert layers[0].read_bytes() == layers[1].read_bytes()


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--part", "3/2"), "--part: found '3/2', expected K/N"),
        (("--part", "1/2", "--jobs", "2"), "--part: found it with --jobs, --dask or --openjd"),
        (("--chunk", "2"), "--chunk: found no --jobs, --dask or --openjd with --chunk"),
        (("--jobs", "2", "--chunk", "0"), "--chunk: found 0, expected 1 or more"),
        (("--jobs", "2", "--captured-hdri", "none.exr"), "--captured-hdri: found "),
        (("--jobs", "2", "--device", "tpu"), "tpu"),
        (("--openjd", "b", "--captured-hdri", "none.exr"), "--captured-hdri: found "),
    ],
    ids=lambda each: " ".join(each)[:30] if isinstance(each, tuple) else "",
)
def test_bad_jobs(run, words, shot, tmp_path, monkeypatch, flags, sentence):
    """Oracle: the sentences, and that nothing is written."""
    shot((1.0, 2.0))
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*words, *flags)
    assert (status, out) == (2, "") and sentence in err, err
    assert err.count("\n") == 1 and names(tmp_path) == ["in", "in/shot.usda"]


def test_a_stage_without_lights_leaves_no_parts(run, words, shot, tmp_path):
    """Oracle: the sentence of one process, and the folder."""
    stage = Usd.Stage.Open(str(shot((1.0, 2.0))))
    for name in ("Sun", "Lamp"):
        stage.GetPrimAtPath(f"/World/{name}").SetActive(False)
    stage.Save()
    status, _, err = run(*words, "--jobs", "1")
    assert status == 2 and "expected a light to relight by" in err
    assert names(tmp_path) == ["in", "in/shot.usda"]


# --- what dies -----------------------------------------------------------------------------

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


@linux
def test_a_worker_that_is_killed_is_replaced(words, alone, tmp_path, gate):
    """Oracle: one process, although the only worker is killed after its first task. It was forked:
    it has the command line of the command."""
    folder = tmp_path / "job" / "r.usdc.parts"
    with begun(*words, "--jobs", "1", "--chunk", "2", env=waits(gate)) as client:
        until(lambda: folder.is_dir() and names(folder)[:2] == ALL[:2])
        (worker,) = (pid for pid in children(client.pid) if not children(pid))
        lines = [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in (worker, client.pid)]
        assert lines[0] == lines[1]
        gate.touch()
        os.kill(worker, signal.SIGKILL)
        assert ended(client)[0] == 0
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]
    assert names(tmp_path / "job") == ["r.usdc"]


@linux
def test_a_job_that_is_interrupted_goes_on_with_the_same_command(words, alone, tmp_path, gate):
    """Oracle: one process; the first times are not lit again, and the command says what to do."""
    folder = tmp_path / "job" / "r.usdc.parts"
    as_in_a_shell = {"preexec_fn": listening, "env": waits(gate)}
    with begun(*words, "--jobs", "1", "--chunk", "2", **as_in_a_shell) as client:
        until(lambda: folder.is_dir() and names(folder)[:2] == ALL[:2])
        before = (folder / ALL[0]).stat()
        client.send_signal(signal.SIGINT)
        status, err = ended(client)
    assert status == 130 and "go on with: usdsplat relight" in "".join(err)
    assert (folder / ALL[0]).stat() == before
    done = [sys.executable, "-m", "usdsplat", *map(str, words), "--jobs", "2"]
    subprocess.run(done, check=True, timeout=LONG, capture_output=True)
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]
    assert names(tmp_path / "job") == ["r.usdc"]


@linux
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_job_that_is_killed_goes_on(words, alone, tmp_path, seed):
    """Oracle: one process, after the job was killed at a random moment."""
    command = [sys.executable, "-m", "usdsplat", *map(str, words), "--jobs", "2", "--chunk", "1"]
    client = subprocess.Popen(command, env={**os.environ, "USDSPLAT_SUPERVISE": "0"})
    try:
        client.wait(random.Random(seed).uniform(1, 6))
    except subprocess.TimeoutExpired:
        client.kill()
        client.wait()
    subprocess.run(command, check=True, timeout=300)
    assert (tmp_path / "job" / "r.usdc").read_bytes() == alone[0]
    assert names(tmp_path / "job") == ["r.usdc"]


# --- farms ---------------------------------------------------------------------------------


def test_a_bundle_has_a_step_that_lights_and_one_that_writes(read, words, shot, tmp_path):
    """Oracle: by hand, and the parser of Open Job Description. The picture of the set is copied."""
    model = pytest.importorskip("openjd.model")
    shot()
    picture = sky_picture(tmp_path, "set.exr")
    told = read(*words, "--captured-hdri", picture, "--openjd", tmp_path / "b", "--chunk", "4")
    template = json.loads(Path(told["template"]).read_text())
    model.decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    light, write = template["steps"]
    (space,) = light["parameterSpace"]["taskParameterDefinitions"]
    assert space["range"] == ["1/2", "2/2"] and write["dependencies"] == [{"dependsOn": "light"}]
    args = [step["script"]["actions"]["onRun"]["args"] for step in (light, write)]
    assert args[0] == [*args[1], "--part={{Task.Param.Part}}"]
    assert args[1][:3] == [
        "relight", "{{Param.Inputs}}/1/shot.usda", "--output={{Param.OutputFolder}}/r.usdc",
    ]  # fmt: skip
    assert "--captured-hdri={{Param.Inputs}}/2/set.exr" in args[1]
    copied = tmp_path / "b" / "assets" / "2" / "set.exr"
    assert copied.read_bytes() == Path(picture).read_bytes()
    assert not (tmp_path / "job").exists()


@pytest.mark.slow
@pytest.mark.parametrize("hdri", [False, True])
def test_openjd_writes_the_layer_of_one_process(read, words, shot, tmp_path, hdri):
    """Oracle: one process, on the stage in the bundle; it was moved, and the inputs are gone."""
    pytest.importorskip("openjd.cli")
    path, picture = shot(), Path(sky_picture(tmp_path, "set.exr"))
    more = ("--captured-hdri", picture) if hdri else ()
    read(*words, *more, "--openjd", tmp_path / "bundle", "--chunk", "2")
    moved = (tmp_path / "bundle").rename(tmp_path / "moved")
    path.unlink()
    picture.unlink()
    openjd = Path(sys.executable).with_name("openjd")
    environment = {**os.environ, "PATH": f"{openjd.parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [openjd, "run", moved / "template.yaml"],
        capture_output=True, env=environment, timeout=600, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
    assert names(moved / "out") == ["r.usdc"]
    stage = moved / "assets" / ("1/shot.usda" if hdri else "shot.usda")
    more = ("--captured-hdri", moved / "assets" / "2" / "set.exr") if hdri else ()
    read("relight", stage, "-o", moved / "alone" / "r.usdc", *FAST, *more)
    assert (moved / "out" / "r.usdc").read_bytes() == (moved / "alone" / "r.usdc").read_bytes()
