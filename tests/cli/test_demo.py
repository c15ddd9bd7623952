"""Tests of `usdsplat demo` and of the stage that it makes."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Usd, UsdGeom, UsdUtils

from usdsplat import formats, schema
from usdsplat.kernels import ahead, signatures
from usdsplat.products import demo
from usdsplat.products.turntable import CAMERA

Image = pytest.importorskip("PIL.Image")


def camera_at(stage, frame):
    return UsdGeom.Camera(stage.GetPrimAtPath(CAMERA)).GetCamera(frame).frustum


def test_the_demo_runs_from_end_to_end(run, tmp_path):
    """Oracle: the files, each read by the library it is for; validation finds nothing."""
    folder = tmp_path / "demo"
    status, out, err = run("demo", "-o", folder, "--splats", 3000, "--frames", 3)
    assert status == 0
    said = [line for line in err.splitlines() if "compiling" not in line]
    said = [line for line in said if "%" not in line]  # progress, where a machine is slow
    assert [line for line in said if "rd:patternScale" not in line] == []
    told = [line.split()[0].rsplit("/", 1)[1] for line in out.splitlines()[:-1]]
    assert told == [
        "capture.ply",
        "capture.usdc",
        "stage.usda",
        "still.png",
        "still.exr",
        "sequence.####.png",
        "sequence.webp",
        "coarse.ply",
        "coarse.usda",
        "growth.usda",
        "growth_bake.usda",
        "growth.####.png",
        "growth.webp",
    ]
    assert formats.read(folder / "capture.ply").cloud.sh_degree == 3
    still = oiio.ImageInput.open(str(folder / "still.exr"))
    assert still.spec().channelnames == ("R", "G", "B", "A", "Z")
    assert still.seek_subimage(1, 0)
    still.close()
    with Image.open(folder / "sequence.webp") as moving:
        assert (moving.n_frames, moving.size) == (3, (640, 360))
    with Image.open(folder / "growth.webp") as moving:
        assert (moving.n_frames, moving.size) == (3, (640, 360))
    with Image.open(folder / "still.png") as picture:  # over the window's grey
        differs = np.abs(np.asarray(picture).astype(int) - 56).max(axis=-1) > 8
    assert differs.shape == (1080, 1920) and 0.05 < differs.mean() < 0.9
    assert run("validate", folder / "stage.usda")[0] == 0
    flags = ("--splats", 1000, "--frames", 1, "--json")
    status, out, _ = run("demo", folder / "capture.ply", "-o", tmp_path / "again", *flags)
    assert status == 0
    again = [item["path"].rsplit("/", 1)[1] for item in json.loads(out)["files"]]
    assert again == [name for name in told[1:] if "coarse" not in name]
    layers, assets, missing = UsdUtils.ComputeAllDependencies(str(folder / "stage.usda"))
    assert (len(layers), list(assets), list(missing)) == (2, [], [])


def test_the_demo_bakes_a_growth(run, capture, tmp_path):
    """Oracle: the bake: the capture first, then more splats; nothing that validation finds."""
    folder = tmp_path / "demo"
    assert run("demo", capture, "-o", folder, "--frames", 4)[0] == 0
    stage = Usd.Stage.Open(str(folder / "growth_bake.usda"))
    field = stage.GetPrimAtPath("/World/Subject/splats")
    first, last = (schema.fetch(field, frame) for frame in (1, 4))
    assert (last.opacities > 0).sum() > (first.opacities > 0).sum() > 0
    assert run("validate", folder / "growth_bake.usda")[0] == 0


def test_nothing_grows_on_a_large_capture(run, capture, tmp_path, monkeypatch):
    """Oracle: the line that says so, and no bake."""
    monkeypatch.setattr("usdsplat.products.demo.GROWN", 299)
    status, out, _ = run("demo", capture, "-o", tmp_path / "demo", "--frames", 1)
    assert status == 0 and "no simulation: 300 splats are too many for the demo\n" in out
    assert not (tmp_path / "demo" / "growth.usda").exists()


def test_the_demo_takes_a_capture(run, capture, tmp_path):
    """Oracle: the prim is named after the file, which is not copied."""
    folder = tmp_path / "deep" / "er"
    status, out, _ = run("demo", capture, "-o", folder, "--frames", 1)
    assert status == 0
    assert f"300 splats as a prim, from {capture}\n" in out
    assert not (folder / "capture.ply").exists()
    assert out.endswith(f"next: usdsplat info {folder}/stage.usda\n")


def test_what_cannot_be_made_is_one_sentence(run, capture):
    """Oracle: where: found X, expected Y."""
    status, out, err = run("demo", capture, "-o", capture)
    assert (status, out) == (2, "")
    assert err == f"usdsplat: {capture}: found file exists, expected a folder that can be made\n"
    status, out, err = run("demo", "--frames", 0)
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: demo: found 200000 splats, 0 frames, expected 1000 to")


LAUNCHES = """
import json, sys
from usdsplat.cli.main import main
from usdsplat.kernels import jit, signatures

asked, load = set(), jit.KernelCache.load_overload

def noted(self, signature, context):
    types = signature.args if hasattr(signature, "args") else signature
    name = f"{self._function.__module__}.{self._function.__name__}"
    asked.add((name.removeprefix("usdsplat.kernels."), signatures.encode(types)))
    return load(self, signature, context)

jit.KernelCache.load_overload = noted
status = main(["demo", "-o", sys.argv[1], "--splats", "3000", "--frames", "2"])
print(json.dumps([status, sorted(asked)]))
"""
"""A process in which nothing is compiled yet, so that Numba asks for every kernel that it runs."""
OF_LARGE_FIELDS = {"blocks.boxes", "blocks.cull", "curve.codes", "sort.gather", "sort.settle"}


def as_compiled(pairs):
    """Kernels and the types that Numba compiles them for: a loop over items takes flat tuples."""
    return {(name, signatures.encode(ahead._cpu_form(name, types)[1])) for name, types in pairs}


def test_what_the_demo_compiles_ahead_is_what_it_launches(tmp_path):
    """Oracle: the kernels that Numba asks for meanwhile; those of large fields it has beyond."""
    words = [sys.executable, "-c", LAUNCHES, str(tmp_path / "demo")]
    said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    status, pairs = json.loads(said.splitlines()[-1])
    listed, known = signatures.read(demo.KERNELS), set(signatures.table("cpu"))
    assert status == 0
    assert len(listed) == len(set(listed)) and set(listed) <= known
    ahead_of_time = as_compiled(listed)
    asked = {(name, types) for name, types in pairs} & as_compiled(known)
    assert asked <= ahead_of_time
    assert {name for name, _ in ahead_of_time - asked} <= OF_LARGE_FIELDS
