"""Tests of moving prims, including animated ones."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from tests.preview.stage_model.stages import placed, said, spinning, world
from usdsplat.core.errors import StageError
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.placing import EDIT, transform

IDENTITY = tuple(np.eye(4).ravel())


def test_a_moved_prim_is_where_it_was_put_and_its_own_ops_are_as_before():
    """Oracle: USD's own composition of ops, at the time of the drag, under a moving group."""
    stage = spinning()
    edits = Edits(stage)
    goal = placed(move=(3, -2, 1), turn=1.0, size=2.0)
    edits.set_transform("/Group/Ball", tuple(goal.ravel()), time=4.0)
    np.testing.assert_allclose(world(stage, "/Group/Ball", 4.0), goal, atol=1e-6)
    again = placed(move=(0, 9, 0), turn=-2.0, size=0.5)
    edits.set_transform("/Group/Ball", tuple(again.ravel()), time=7.0)
    np.testing.assert_allclose(world(stage, "/Group/Ball", 7.0), again, atol=1e-6)
    order = stage.GetAttributeAtPath("/Group/Ball.xformOpOrder").Get()
    assert list(order) == [EDIT, "xformOp:translate", "xformOp:rotateXYZ"]
    assert stage.GetAttributeAtPath("/Group/Ball.xformOp:translate").GetTimeSamples() == [1, 10]


def test_what_is_animated_goes_on_from_where_it_was_put():
    """Oracle: closed form: a move in the parent's space moves the whole path by as much."""
    stage = spinning()
    edits = Edits(stage)
    times = (1.0, 4.0, 10.0)
    before = [world(stage, "/Group/Ball", time) for time in times]
    moved = before[1].copy()
    moved[:3, 3] += (6.0, 0.0, 0.0)
    edits.set_transform("/Group/Ball", tuple(moved.ravel()), time=4.0)
    for time, was in zip(times, before, strict=True):
        was[:3, 3] += (6.0, 0.0, 0.0)
        np.testing.assert_allclose(world(stage, "/Group/Ball", time), was, atol=1e-6)


def test_a_transform_that_is_put_back_is_no_move():
    """Oracle: every time's place before, for a prim with a reset stack too."""
    stage = spinning()
    UsdGeom.Xformable(stage.GetPrimAtPath("/Group/Ball")).SetResetXformStack(True)
    edits = Edits(stage)
    before = [world(stage, "/Group/Ball", time) for time in (1.0, 5.0)]
    edits.set_transform("/Group/Ball", transform(stage, "/Group/Ball", time=5.0), time=5.0)
    after = [world(stage, "/Group/Ball", time) for time in (1.0, 5.0)]
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert UsdGeom.Xformable(stage.GetPrimAtPath("/Group/Ball")).GetResetXformStack()


def test_a_prim_without_size_cannot_be_moved():
    """Oracle: no op can undo a scale of 0."""
    stage = spinning()
    UsdGeom.Xformable(stage.GetPrimAtPath("/Group")).GetOrderedXformOps()[0].Set(Gf.Vec3f(0.0))
    before = said(stage)
    with pytest.raises(StageError, match="without an inverse"):
        Edits(stage).set_transform("/Group/Ball", IDENTITY)
    assert said(stage) == before
