"""Tests of transforms as numbers: what is shown, and what a typed number does."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.preview.stage_model.stages import rich, spinning, world
from usdsplat.core.errors import StageError, UsageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.poses import Pose, matrix_of, pose_at, pose_of, set_number


def test_numbers_are_those_of_the_usual_ops():
    """Oracle: translate, rotateXYZ and scale ops of a prim below a moving and scaled group."""
    stage = spinning()
    stage.GetAttributeAtPath("/Group/Ball.xformOp:rotateXYZ").Set(Gf.Vec3f(10, -20, 130), 4)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Group/Ball")).AddScaleOp().Set(Gf.Vec3f(2, 3, 0.5))
    pose = pose_at(stage, "/Group/Ball", time=4.0)
    assert pose.translate == pytest.approx((0, 4, 0), abs=1e-12)
    assert pose.translate[0] == 0.0, "no rest of rounding"
    assert pose.rotate == pytest.approx((10, -20, 130))
    assert pose.scale == pytest.approx((2, 3, 0.5))


@pytest.mark.parametrize("seed", range(20))
def test_every_matrix_has_a_pose_and_the_pose_has_the_matrix(seed):
    """Oracle: the matrix itself, sheared and mirrored ones and such of 90 degrees about y too."""
    random = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3] = random.normal(size=(3, 4))
    if seed % 4 == 0:
        angles = (random.uniform(-90, 90), random.choice((-90.0, 90.0)), random.uniform(-90, 90))
        matrix = matrix_of(Pose(rotate=angles, scale=(1.0, 2.0, -3.0)))
    for near in (None, Pose(rotate=tuple(random.uniform(-900, 900, 3)), scale=(1, -1, -1))):
        np.testing.assert_allclose(matrix_of(pose_of(matrix, near=near)), matrix, atol=1e-9)


@pytest.mark.parametrize(
    "pose",
    [
        Pose(rotate=(0, 100, 0)),
        Pose(rotate=(30, 450, -200), scale=(1, -2, 1)),
        Pose(rotate=(15, 90, 40)),
        Pose(scale=(-1, -1, 1), shear=(0.5, 0, 0)),
    ],
)
def test_typed_numbers_stay_as_they_were_typed(pose):
    """Oracle: the pose itself, of the many that have its matrix."""
    found = pose_of(matrix_of(pose), near=pose)
    for part in ("translate", "rotate", "scale", "shear"):
        assert getattr(found, part) == pytest.approx(getattr(pose, part), abs=1e-9), part


def test_a_typed_number_moves_turns_and_scales_in_the_parents_space_with_undo():
    """Oracle: USD's composition of ops that have these numbers, under the same group; the prim's
    own ops are as before, and each number is one step."""
    stage, expected = spinning(), spinning()
    edits = Edits(stage)
    set_number(edits, "/Group/Ball", "translate", 0, 7.5, time=4.0)
    set_number(edits, "/Group/Ball", "rotate", 1, 35.0, time=4.0)
    set_number(edits, "/Group/Ball", "scale", 2, 3.0, time=4.0)
    ball = UsdGeom.Xformable(expected.GetPrimAtPath("/Group/Ball"))
    ball.ClearXformOpOrder()
    ball.AddTranslateOp(opSuffix="t").Set(Gf.Vec3d(7.5, 4, 0))
    ball.AddRotateXYZOp(opSuffix="t").Set(Gf.Vec3f(0, 35, 36))
    ball.AddScaleOp().Set(Gf.Vec3f(1, 1, 3))
    path = "/Group/Ball"
    np.testing.assert_allclose(world(stage, path, 4.0), world(expected, path, 4.0), atol=1e-6)
    assert edits.undoable == "Scale Ball"
    assert [edits.undo() for _ in range(3)] == ["Scale Ball", "Turn Ball", "Move Ball"]
    np.testing.assert_allclose(world(stage, path, 4.0), world(spinning(), path, 4.0))


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [("scale", 0.0, "scale Y: found 0, expected a finite number other than 0"),
     ("translate", float("inf"), "translate Y: found inf, expected a finite number")],
)  # fmt: skip
def test_numbers_that_no_transform_has_are_refused(part, value, words):
    """Oracle: the sentence, and a stage without edits."""
    stage = spinning()
    edits = Edits(stage)
    with pytest.raises(UsageError, match=words):
        set_number(edits, "/Group/Ball", part, 1, value, time=1.0)
    assert edits.undoable is None


def test_what_cannot_be_moved_has_no_pose():
    """Oracle: a scope, a prim in an instance, a parent that flattens, a path of nothing."""
    stage = rich()
    assert pose_at(stage, "/World/Guides") is None
    assert pose_at(stage, "/World/Instance/Cube") is None
    assert pose_at(stage, "/Nothing") is None
    with pytest.raises(StageError, match="a prim that cannot be moved"):
        set_number(Edits(stage), "/World/Guides", "translate", 0, 1.0)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddScaleOp().Set(Gf.Vec3f(1, 0, 1))
    assert pose_at(stage, "/World/Ball") is None


def test_a_prim_that_ignores_its_parent_is_in_the_world():
    """Oracle: USD's own reading of the matrix, with a reset of the stack."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/A").AddTranslateOp().Set(Gf.Vec3d(5, 0, 0))
    ball = UsdGeom.Sphere.Define(stage, "/A/Ball")
    ball.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    ball.SetResetXformStack(True)
    assert pose_at(stage, "/A/Ball").translate == (1, 2, 3)
    set_number(Edits(stage), "/A/Ball", "translate", 2, -4.0)
    np.testing.assert_allclose(world(stage, "/A/Ball")[:3, 3], (1, 2, -4))
