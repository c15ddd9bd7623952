"""Tests of the files in which a stage that is lit at one time waits for others."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdLux

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.findings import finding
from usdsplat.products.lit_times import LitField, LitFolder, LitTime, folder_of, stamp_of


def cloud(count):
    rng = np.random.default_rng(count)
    shapes = {"positions": (3,), "scales": (3,), "rotations": (4,), "opacities": (), "sh": (4, 3)}
    return SplatCloud(
        **{each: rng.random((count, *shape), np.float32) for each, shape in shapes.items()}
    )


@pytest.fixture
def lit():
    """A field with splats, and one without, at a time with a finding."""
    found = finding("bad-light", "/Sun.inputs:intensity", "inf", "a finite number")
    many = LitField(cloud=cloud(7), error=0.1, worst=1 / 3, residual=None)
    none = LitField(cloud=cloud(0), error=0.0, worst=0.0, residual=float("nan"))
    return LitTime(findings=(found,), has_lights=True, fields={"/B": many, "/A": none})


def test_what_is_stored_is_read_bit_for_bit(lit, tmp_path):
    """Oracle: the values, and the order of the fields."""
    folder = LitFolder(tmp_path / "r.usdc", "stamp")
    folder.path.mkdir()
    folder.save(3, lit)
    found = folder.load(3)
    assert (found.findings, found.has_lights) == (lit.findings, True)
    assert list(found.fields) == ["/B", "/A"]
    for path, each in lit.fields.items():
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            a, b = getattr(found.fields[path].cloud, name), getattr(each.cloud, name)
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes()
        assert repr(found.fields[path].residual) == repr(each.residual)
        assert (found.fields[path].error, found.fields[path].worst) == (each.error, each.worst)
    assert folder.load(2) is None and LitFolder(tmp_path / "r.usdc", "other").load(3) is None


@pytest.mark.parametrize("at", [4, 100, -1])
def test_a_damaged_file_does_not_count(lit, tmp_path, at):
    """Oracle: nothing is read of a file with one other byte, or of a part of it."""
    folder = LitFolder(tmp_path / "r.usdc", "stamp")
    folder.path.mkdir()
    folder.save(0, lit)
    (path,) = folder.path.iterdir()
    whole = path.read_bytes()
    other = bytearray(whole)
    other[at if at > 0 else whole.rindex(lit.fields["/B"].cloud.sh.tobytes())] ^= 1
    for data in (bytes(other), whole[: len(whole) // 2]):
        path.write_bytes(data)
        assert folder.load(0) is None


def test_the_folder_is_removed_unless_it_has_something_of_others(lit, tmp_path):
    """Oracle: the names; without a folder there is nothing to remove."""
    folder = LitFolder(tmp_path / "r.usdc", "stamp")
    folder.remove()
    folder.path.mkdir()
    folder.save(0, lit)
    (folder.path / "notes.txt").write_text("mine")
    folder.remove()
    assert [each.name for each in folder_of(tmp_path / "r.usdc").iterdir()] == ["notes.txt"]
    (folder.path / "notes.txt").unlink()
    folder.remove()
    assert not list(tmp_path.iterdir())


# --- stamps --------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    """A stage over another one, with a clip and a picture."""
    under = Usd.Stage.CreateNew(str(tmp_path / "under.usda"))
    schema.author(under, "/Field", cloud(3))
    under.Save()
    clip = Usd.Stage.CreateNew(str(tmp_path / "clip.usda"))
    clip.OverridePrim("/Field")
    clip.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    stage.GetRootLayer().subLayerPaths.append("under.usda")
    clips = Usd.ClipsAPI(stage.OverridePrim("/Field"))
    clips.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
    clips.SetClipManifestAssetPath(Sdf.AssetPath("./clip.usda"))
    clips.SetClipPrimPath("/Field")
    clips.SetClipActive([(0, 0)])
    clips.SetClipTimes([(0, 0)])
    dome = UsdLux.DomeLight.Define(stage, "/Dome")
    dome.CreateTextureFileAttr("sky.exr")
    stage.Save()
    (tmp_path / "sky.exr").write_bytes(b"sky")
    (tmp_path / "set.exr").write_bytes(b"set")
    return tmp_path


def stamp(files):
    stage = Usd.Stage.Open(str(files / "stage.usda"))
    return stamp_of(stage, "cpu", (1,), files / "set.exr")


def rewritten(name, text):
    def change(files):
        path = files / name
        data = path.read_bytes()
        path.write_bytes(text if text is not None else data + b"# more\n")

    return change


def touched(files):
    status = (files / "clip.usda").stat()
    os.utime(files / "clip.usda", ns=(status.st_atime_ns, status.st_mtime_ns + 10**9))


@pytest.mark.parametrize(
    "change",
    [
        rewritten("stage.usda", None), rewritten("under.usda", None),
        rewritten("sky.exr", b"sun"), rewritten("set.exr", b"SET"), touched,
    ],
    ids=["stage", "sublayer", "picture", "set", "clip"],
)  # fmt: skip
def test_a_file_that_changes_changes_the_stamp(files, change):
    """Oracle: inequality; a stage that was opened twice has one stamp."""
    before = stamp(files)
    assert before == stamp(files)
    change(files)
    assert stamp(files) != before


def test_device_options_and_opinions_of_the_session_change_the_stamp(files):
    """Oracle: inequality."""
    stage = Usd.Stage.Open(str(files / "stage.usda"))
    masked = Usd.Stage.OpenMasked(
        str(files / "stage.usda"), Usd.StagePopulationMask([Sdf.Path("/Field")])
    )
    session = Usd.Stage.Open(str(files / "stage.usda"))
    with Usd.EditContext(session, session.GetSessionLayer()):
        session.GetPrimAtPath("/Dome").SetActive(False)
    muted = Usd.Stage.Open(str(files / "stage.usda"))
    muted.MuteLayer(str(files / "under.usda"))
    kinds = [(stage, "cpu", (1,)), (stage, "cuda", (1,)), (stage, "cpu", (2,))]
    kinds += [(each, "cpu", (1,)) for each in (masked, session, muted)]
    found = [stamp_of(each, device, values, None) for each, device, values in kinds]
    assert len(set(found)) == len(kinds)


def test_a_copy_elsewhere_has_the_same_stamp(files, tmp_path_factory):
    """Oracle: the stamp of the original."""
    copy = tmp_path_factory.mktemp("copy") / "files"
    shutil.copytree(files, copy)
    assert stamp(copy) == stamp(files)
