"""Tests that saved cameras have the same view, below any parent."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.preview.stage_model.stages import rich, spinning
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.preview.stage_model.cameras import cameras, save_camera
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.render.specs import CameraSpec

FIELDS = ("world_to_camera", "window", "clipping_range", "exposure", "lens_radius", "shutter")


def view(chance: random.Random, *, orthographic: bool) -> CameraSpec:
    """Any camera: off its axis, exposed, with a lens and a shutter."""
    axis = Gf.Vec3d(*(chance.gauss(0, 1) for _ in range(3)))
    rotation = Gf.Matrix4d(1.0).SetRotate(Gf.Rotation(axis, chance.uniform(0, 360)))
    place = Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*(chance.uniform(-50, 50) for _ in range(3))))
    left, bottom = chance.uniform(-2, -0.1), chance.uniform(-2, -0.1)
    has_lens = not orthographic and chance.random() < 0.5
    return CameraSpec(
        world_to_camera=tuple(np.array((rotation * place).GetInverse()).T.ravel().tolist()),
        orthographic=orthographic,
        window=(left, bottom, left + chance.uniform(0.2, 4), bottom + chance.uniform(0.2, 4)),
        clipping_range=(chance.uniform(0.01, 1), chance.uniform(10, 1e5)),
        exposure=2 ** chance.uniform(-4, 4),
        lens_radius=chance.uniform(0.001, 0.5) if has_lens else 0.0,
        focus_distance=chance.uniform(1, 50) if has_lens else 0.0,
        shutter=(-0.25, 0.25),
    )


def assert_sees(found: CameraSpec, spec: CameraSpec) -> None:
    assert found.orthographic == spec.orthographic
    for name in FIELDS:
        np.testing.assert_allclose(getattr(found, name), getattr(spec, name), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_saved_camera_sees_the_same(seed, orthographic):
    """Oracle: the camera as the engine reads it back from the stage."""
    stage = rich()
    spec = view(random.Random(seed), orthographic=orthographic)
    path = save_camera(Edits(stage), spec, name="Shot")
    assert path == "/Shot"
    with Engine(stage, threads=1) as engine:
        assert_sees(engine.view(path).camera, spec)


def test_a_camera_in_a_moving_group_sees_the_same_at_its_time():
    """Oracle: the engine's camera at the time, below a group that is scaled and moves."""
    stage = spinning()
    spec = view(random.Random(9), orthographic=False)
    path = save_camera(Edits(stage), spec, name="/Group/Shot", time=4.0)
    with Engine(stage, threads=1, time=4.0) as engine:
        assert_sees(engine.view(path).camera, spec)


def test_a_framing_camera_can_be_saved_on_a_stage_that_points_z_up():
    """Oracle: the engine's own camera."""
    stage = rich()
    UsdGeom.SetStageUpAxis(stage, "Z")
    edits = Edits(stage)
    with Engine(stage, threads=1) as engine:
        spec = engine.view().camera
        assert_sees(engine.view(save_camera(edits, spec)).camera, spec)


def test_names_that_are_taken_get_numbers_and_saving_is_one_step():
    """Oracle: the paths, and the session layer's text before."""
    stage = rich()
    before = stage.GetSessionLayer().ExportToString()
    edits = Edits(stage)
    paths = [save_camera(edits, CameraSpec(), name="/World/Camera") for _ in range(2)]
    assert paths == ["/World/Camera1", "/World/Camera2"]
    assert cameras(stage) == ("/World/Camera", *paths)
    assert edits.undo() == "Save Camera2"
    edits.undo()
    assert stage.GetSessionLayer().ExportToString() == before
    assert not stage.GetRootLayer().GetPrimAtPath("/World/Camera1")


@pytest.mark.parametrize(
    "name", ["", "/", "1", "a b", "a/b", "/World/", "/World/..", "/A.b", "/A{b=c}", "\0", "/" * 9]
)
def test_what_is_no_name_is_refused(name):
    """Oracle: nothing is authored."""
    edits = Edits(rich())
    with pytest.raises(UsageError, match="found"):
        save_camera(edits, CameraSpec(), name=name)
    assert edits.undoable is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"window": (0.0, 0.0, 0.0, 1.0)},
        {"clipping_range": (5.0, 1.0)},
        {"exposure": 0.0},
        {"world_to_camera": (math.nan,) * 16},
        {"world_to_camera": (1.0,)},
    ],
)
def test_what_sees_nothing_is_refused(wrong):
    """Oracle: nothing is authored."""
    edits = Edits(rich())
    with pytest.raises(UsageError, match="found"):
        save_camera(edits, CameraSpec(**wrong))
    assert edits.undoable is None


def test_a_camera_cannot_go_into_an_instance():
    """Oracle: nothing is authored."""
    stage = rich()
    before = stage.GetSessionLayer().ExportToString()
    with pytest.raises(StageError):
        save_camera(Edits(stage), CameraSpec(), name="/World/Instance/Shot")
    assert stage.GetSessionLayer().ExportToString() == before


def test_a_stage_without_cameras_has_none():
    """Oracle: an empty stage."""
    assert cameras(Usd.Stage.CreateInMemory()) == ()
