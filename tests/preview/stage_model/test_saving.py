"""Tests of saving a user's edits to files, never over the stage's own."""

from __future__ import annotations

import os

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.preview.stage_model.stages import rich
from usdsplat.core.errors import OutputError, StageError, UnknownFormatError, UsageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.saving import save_camera_layer, save_session
from usdsplat.render.specs import CameraSpec


@pytest.fixture
def opened(tmp_path):
    """A stage of two files, with an edit, and a simulation's layer below it."""
    made = rich()
    made.GetRootLayer().Export(str(tmp_path / "weak.usda"))
    root = Sdf.Layer.CreateNew(str(tmp_path / "shot.usda"))
    root.subLayerPaths = ["./weak.usda"]
    root.Save()
    stage = Usd.Stage.Open(root)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/World"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    root.Save()
    frames = Sdf.Layer.CreateAnonymous("frames.usda")
    stage.GetSessionLayer().subLayerPaths.append(frames.identifier)
    with Usd.EditContext(stage, frames):
        stage.GetAttributeAtPath("/World/Ball.radius").Set(77.0)
    Edits(stage).set_visible("/World/Cloud", False)
    yield stage, frames


def test_a_saved_session_holds_the_edits_and_no_simulation(opened, tmp_path):
    """Oracle: the file opened by USD, stacked over the stage."""
    stage, _ = opened
    target = tmp_path / "edits.usda"
    before = stage.GetSessionLayer().ExportToString()
    save_session(stage, target)
    layer = Sdf.Layer.FindOrOpen(str(target))
    assert list(layer.subLayerPaths) == []
    assert not layer.GetPropertyAtPath("/World/Ball.radius")
    assert layer.GetAttributeAtPath("/World/Cloud.visibility").default == "invisible"
    assert stage.GetSessionLayer().ExportToString() == before


def test_a_session_over_its_stage_opens_as_what_was_seen(opened, tmp_path):
    """Oracle: the stage that the file opens as, from another folder than the shot's."""
    stage, _ = opened
    (tmp_path / "user").mkdir()
    save_session(stage, tmp_path / "user" / "seen.usdc", over_stage=True)
    os.rename(tmp_path, tmp_path.with_name("moved"))
    seen = Usd.Stage.Open(str(tmp_path.with_name("moved") / "user" / "seen.usdc"))
    cloud = UsdGeom.Imageable(seen.GetPrimAtPath("/World/Cloud"))
    assert cloud.ComputeVisibility() == "invisible"
    assert seen.GetAttributeAtPath("/World/Ball.radius").Get() == 1.0
    assert str(seen.GetDefaultPrim().GetPath()) == "/World"
    assert UsdGeom.GetStageUpAxis(seen) == "Z"
    os.rename(tmp_path.with_name("moved"), tmp_path)


@pytest.mark.parametrize("name", ["shot.usda", "weak.usda", "./shot.usda"])
def test_a_file_of_the_stage_is_never_written(opened, tmp_path, name):
    """Oracle: the bytes of both files, through a link too."""
    stage, _ = opened
    before = [(tmp_path / each).read_bytes() for each in ("shot.usda", "weak.usda")]
    (tmp_path / "link.usda").symlink_to(tmp_path / "weak.usda")
    for target in (tmp_path / name, tmp_path / "link.usda"):
        with pytest.raises(OutputError, match="being read"):
            save_session(stage, target)
        with pytest.raises(OutputError, match="being read"):
            save_camera_layer(stage, CameraSpec(), target)
    assert [(tmp_path / each).read_bytes() for each in ("shot.usda", "weak.usda")] == before


def test_what_cannot_be_saved_is_a_sentence(opened, tmp_path):
    """Oracle: no file is there afterwards."""
    stage, _ = opened
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UnknownFormatError):
        save_session(stage, tmp_path / "edits.txt")
    with pytest.raises(OutputError):
        save_session(stage, tmp_path / "none" / "edits.usda")
    with pytest.raises(UsageError):
        save_camera_layer(stage, CameraSpec(), tmp_path / "camera.usda", name="a b")
    with pytest.raises(UsageError):
        save_camera_layer(stage, CameraSpec(exposure=-1.0), tmp_path / "camera.usda")
    with pytest.raises(StageError):
        save_session(rich(), tmp_path / "edits.usda", over_stage=True)
    assert sorted(tmp_path.iterdir()) == before


def test_a_camera_on_a_layer_of_its_own_is_all_that_it_holds(opened, tmp_path):
    """Oracle: the file opened by USD; the stage is as before."""
    stage, _ = opened
    before = stage.GetSessionLayer().ExportToString()
    path = save_camera_layer(stage, CameraSpec(), tmp_path / "camera.usda", name="Shot")
    alone = Usd.Stage.Open(str(tmp_path / "camera.usda"))
    assert [str(prim.GetPath()) for prim in alone.Traverse()] == [path] == ["/Shot"]
    assert UsdGeom.GetStageUpAxis(alone) == "Z"
    assert stage.GetSessionLayer().ExportToString() == before
