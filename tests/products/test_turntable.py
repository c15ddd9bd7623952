"""Tests of a stage with a turntable around a capture."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.products.turntable import CAMERA, author_turntable


def camera_at(stage, frame):
    return UsdGeom.Camera(stage.GetPrimAtPath(CAMERA)).GetCamera(frame).frustum


@pytest.fixture
def turntable(run, capture, tmp_path):
    """A stage with a camera around the ball, open."""
    run("convert", capture, tmp_path / "capture.usdc")
    author_turntable(tmp_path / "stage.usda", tmp_path / "capture.usdc", frames=8)
    return Usd.Stage.Open(str(tmp_path / "stage.usda"))


def test_the_subject_is_in_the_picture_all_the_way_around(turntable):
    """Oracle: GfFrustum; every centre is inside at every frame, and the ball fills the height."""
    prim = turntable.GetPrimAtPath("/World/Subject/splats")
    to_world = UsdGeom.XformCache().GetLocalToWorldTransform(prim)
    points = [to_world.Transform(Gf.Vec3d(*map(float, p))) for p in schema.fetch(prim).positions]
    for frame in range(1, 9):
        frustum = camera_at(turntable, frame)
        matrix = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        seen = np.array([matrix.Transform(point) for point in points])
        assert np.abs(seen).max() < 1
        assert np.abs(seen[:, 1]).max() > 0.8


def test_the_camera_goes_around_once_and_looks_at_the_middle(turntable):
    """Oracle: eight frames of a circle around the upright axis; the ball is its centre."""
    eyes = np.array([camera_at(turntable, frame).position for frame in range(1, 10)])
    angles = np.unwrap(np.arctan2(eyes[:, 0], eyes[:, 2]))
    np.testing.assert_allclose(np.diff(angles), np.full(8, np.pi / 4), atol=0.05)
    np.testing.assert_allclose(eyes[8], eyes[0], atol=1e-6)
    np.testing.assert_allclose(eyes[:, 1], eyes[0, 1], atol=1e-6)
    ray = camera_at(turntable, 1).ComputeViewDirection()
    to_middle = -eyes[0] / np.linalg.norm(eyes[0])
    assert np.dot(ray, to_middle) > 0.97


def test_an_empty_capture_gets_a_camera_all_the_same(tmp_path):
    """Oracle: a stage that opens; there is nothing to look at."""
    empty = Usd.Stage.CreateNew(str(tmp_path / "empty.usda"))
    empty.SetDefaultPrim(empty.DefinePrim("/World"))
    empty.GetRootLayer().Save()
    author_turntable(tmp_path / "stage.usda", tmp_path / "empty.usda", frames=1)
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    assert camera_at(stage, 1).GetNearFar().GetSize() > 0
