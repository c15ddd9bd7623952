"""Tests of one long job on every engine: the same pictures as one process draws without tiles."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Gf, Usd, UsdGeom

from tests.cli.test_job_failures import begun, cluster, ended, pictures

__all__ = ["cluster"]

pytestmark = [
    pytest.mark.usefixtures("compiled"),
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]
FRAMES = 24
FLAGS = ("--frames", f"1-{FRAMES}", "--resolution", "32x20", "--device", "cpu")
KINDS = {
    "flat": ("--aovs", "all", "--float", "--multipart", "--samples", "2"),
    "deep": ("--deep", "--aovs", "id,cryptoObject", "--float", "--overscan", "2"),
}


@pytest.fixture
def long_shot(shot):
    """The stage with a motion that goes on to the last frame."""
    stage = Usd.Stage.Open(str(shot))
    (move,) = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Ball")).GetOrderedXformOps()
    for frame in range(1, FRAMES + 1):
        move.Set(Gf.Vec3d(0.03 * frame, 0.01 * frame, 0), frame)
    stage.SetEndTimeCode(FRAMES)
    stage.Save()
    return shot


@pytest.fixture
def alone(run_json, long_shot, tmp_path):
    """The pictures of one process, by kind and name."""
    for kind, flags in KINDS.items():
        name = tmp_path / "alone" / kind / "a.####.exr"
        run_json("render", long_shot, "-o", name, *FLAGS, *flags, "-q")
    found = {kind: pictures(tmp_path / "alone" / kind) for kind in KINDS}
    assert [len(each) for each in found.values()] == [FRAMES] * 2
    return found


def check(folder, alone):
    """Check pixels and headers, and that nothing else is there."""
    for kind, expected in alone.items():
        assert pictures(folder / kind) == expected
        assert sorted(each.name for each in (folder / kind).iterdir()) == sorted(expected)


@pytest.mark.parametrize("how", ["--jobs 2", "--dask local", "--dask ADDRESS"])
def test_tiles_of_a_job_are_the_pictures_of_one_process(cluster, long_shot, tmp_path, alone, how):
    """Oracle: one process, without tiles: pixels and headers of all AOVs, deep samples and
    Cryptomattes, but the date. ADDRESS has two workers that share nothing but the folder."""
    flag, engine = how.split()
    if engine == "ADDRESS":
        for _ in range(2):
            cluster.start()
        engine = cluster.address()
    for kind, flags in KINDS.items():
        words = (
            "render",
            long_shot,
            "-o",
            tmp_path / "job" / kind / "a.####.exr",
            *FLAGS,
            *flags,
            "-q",
        )
        with begun(*words, "--tiles", "2x2", flag, engine, env=two_cores()) as client:
            assert ended(client) == (0, [])
    check(tmp_path / "job", alone)


def two_cores():
    """The environment without a number of threads: an engine of this machine has more than one
    worker then."""
    return {name: text for name, text in os.environ.items() if name != "USDSPLAT_THREADS"}


def test_openjd_runs_tiles_to_the_pictures_of_one_process(run_json, long_shot, tmp_path, alone):
    """Oracle: as above; the stage is the copy in the bundle."""
    pytest.importorskip("openjd.cli")
    openjd = Path(sys.executable).with_name("openjd")
    environment = {**os.environ, "PATH": f"{openjd.parent}{os.pathsep}{os.environ['PATH']}"}
    for kind, flags in KINDS.items():
        bundle = tmp_path / f"bundle of {kind}"
        words = ("render", long_shot, "-o", "a.####.exr", *FLAGS, *flags, "--tiles", "2x2", "-q")
        template = run_json(*words, "--openjd", bundle)["template"]
        done = subprocess.run(
            [openjd, "run", template, "--extensions", "TASK_CHUNKING"],
            capture_output=True, env=environment, timeout=600, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
        (tmp_path / "job").mkdir(exist_ok=True)
        (bundle / "out").rename(tmp_path / "job" / kind)
    check(tmp_path / "job", alone)
