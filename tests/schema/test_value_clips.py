"""Tests of the files of value clips."""

from __future__ import annotations

from pathlib import Path

from pxr import Gf, Sdf, Usd, Vt

from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.value_clips import clip_files, clipped_prims, stage_files


def clipped(folder: Path, *names: str) -> Usd.Stage:
    """A stage with clips of these names, of which it makes the first."""
    clip = Usd.Stage.CreateNew(str(folder / names[0]))
    schema.author(clip, "/F", cloud(n=2), time=1)
    clip.Save()
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    schema.author(stage, "/F", cloud(n=2))
    api = Usd.ClipsAPI(stage.GetPrimAtPath("/F"))
    api.SetClipAssetPaths(Sdf.AssetPathArray([Sdf.AssetPath(f"./{name}") for name in names]))
    api.SetClipPrimPath("/F")
    api.SetClipActive(Vt.Vec2dArray([Gf.Vec2d(i + 1, i) for i in range(len(names))]))
    api.SetClipTimes(Vt.Vec2dArray([Gf.Vec2d(1, 1), Gf.Vec2d(2, 1)]))
    stage.Save()
    return stage


def test_a_missing_clip_is_a_finding(tmp_path: Path) -> None:
    """Oracle: the files in the folder."""
    stage = clipped(tmp_path, "a.usdc", "lost.usdc")
    (found,) = composition_findings(stage)
    assert (found.code, found.path) == ("missing-asset", "/F")
    assert "lost.usdc" in found.found
    assert {Path(path).name for path in clip_files(clipped_prims(stage))} == {"a.usdc"}


def test_the_files_of_a_stage_do_not_depend_on_what_was_read(tmp_path: Path) -> None:
    """Oracle: the files of an engine before and after it reads values of the clips."""
    stage = clipped(tmp_path, "a.usdc")
    with Engine(stage, time=None) as engine:
        before = engine.stage_info()
        engine.set_time(1)
        engine.sync()
        assert engine.stage_info() == before
    assert [Path(path).name for path in before.files] == ["shot.usda"]
    assert [Path(path).name for path in before.clips] == ["a.usdc"]


def test_clips_that_are_authored_later_are_files_of_an_engine(tmp_path: Path) -> None:
    """Oracle: the names of the files on disk."""
    stage = clipped(tmp_path, "a.usdc")
    prim = stage.GetPrimAtPath("/F")
    clips = prim.GetMetadata("clips")
    prim.ClearMetadata("clips")
    with Engine(stage) as engine:
        assert engine.stage_info().clips == ()
        prim.SetMetadata("clips", clips)
        assert [Path(path).name for path in engine.stage_info().clips] == ["a.usdc"]


def test_a_manifest_that_is_a_layer_too_hides_no_clips(tmp_path: Path) -> None:
    """Oracle: the names on disk; with such a manifest, USD uses no layer that only clips need."""
    stage = clipped(tmp_path, "a.usdc")
    topology = Sdf.Layer.CreateNew(str(tmp_path / "topology.usda"))
    spec = Sdf.CreatePrimInLayer(topology, "/F")
    Sdf.AttributeSpec(spec, "positions", Sdf.ValueTypeNames.Point3fArray)
    topology.Save()
    stage.GetRootLayer().subLayerPaths.append("./topology.usda")
    api = Usd.ClipsAPI(stage.GetPrimAtPath("/F"))
    api.SetClipManifestAssetPath(Sdf.AssetPath("./topology.usda"))
    stage.Save()
    del api, stage  # which have opened the clip
    opened = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    assert opened.GetUsedLayers() == opened.GetUsedLayers(False)
    names = {Path(path).name for path in stage_files(opened)}
    assert names == {"shot.usda", "topology.usda", "a.usdc"}


def test_damaged_metadata_of_clips_has_no_files() -> None:
    """Oracle: no error is raised for a value of another type."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/F")
    prim.SetMetadata("clips", {"default": {"assetPaths": 3}})
    assert clip_files(clipped_prims(stage)) == set()


def test_the_files_of_a_stage_include_clips_that_were_not_read(tmp_path: Path) -> None:
    """Oracle: the names on disk, before and after a value of the clips is read, and in a folder
    whose name looks like a path in a package."""
    folder = tmp_path / "a[1]"
    folder.mkdir()
    stage = clipped(folder, "a.usdc", "lost.usdc")
    before = stage_files(stage)
    assert before == {str(folder / "a.usdc"), str(folder / "shot.usda")}
    stage.GetAttributeAtPath("/F.positions").Get(1)
    assert stage_files(stage) == before
