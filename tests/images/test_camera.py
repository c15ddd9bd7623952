"""Tests of the header entries of a camera."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf

from usdsplat.images.camera import camera_metadata


def camera(projection):
    """A camera somewhere, with offsets and an aperture that is not square, in Gf's words."""
    turn = Gf.Rotation(Gf.Vec3d(1, 2, 3), 70)
    return Gf.Camera(
        transform=Gf.Matrix4d().SetTransform(turn, Gf.Vec3d(3, -4, 5)),
        projection=projection,
        horizontalAperture=30,
        verticalAperture=17,
        horizontalApertureOffset=4,
        verticalApertureOffset=-3,
        focalLength=35,
        clippingRange=Gf.Range1f(0.5, 900),
    )


@pytest.mark.parametrize("kind", ["Perspective", "Orthographic"])
def test_matrices_map_points_as_gf_does(kind):
    """Oracle: GfFrustum's view and projection; EXR flips z of the first and y of the second."""
    frustum = camera(getattr(Gf.Camera, kind)).frustum
    view, project = frustum.ComputeViewMatrix(), frustum.ComputeProjectionMatrix()
    window = frustum.GetWindow()
    entries = camera_metadata(
        world_to_camera=np.array(view).T.ravel(),
        window=(*window.GetMin(), *window.GetMax()),
        orthographic=kind == "Orthographic",
    )
    to_camera, to_ndc = (np.reshape(entries[k], (4, 4)) for k in ("worldToCamera", "worldToNDC"))
    corners = np.array(frustum.ComputeCornersAtDistance(20.0))
    for point in [*corners, *(corners[0] * t + corners[3] * (1 - t) for t in (0.2, 0.7))]:
        x, y, z = view.Transform(Gf.Vec3d(*point))
        np.testing.assert_allclose([*point, 1] @ to_camera, [x, y, -z, 1], atol=1e-9)
        u, v, _ = (view * project).Transform(Gf.Vec3d(*point))
        *ndc, _, w = [*point, 1] @ to_ndc
        np.testing.assert_allclose(np.divide(ndc, w), [(u + 1) / 2, (1 - v) / 2], atol=1e-9)


def test_the_screen_window_is_the_aperture_at_distance_one():
    """Oracle: similar triangles; OpenEXR defines it for perspective pictures only."""
    identity = np.eye(4).ravel()
    entries = camera_metadata(world_to_camera=identity, window=(-1, -2, 3, 4), orthographic=False)
    assert entries["screenWindowCenter"] == (1, 1)
    assert entries["screenWindowWidth"] == 4
    flat = camera_metadata(world_to_camera=identity, window=(-1, -2, 3, 4), orthographic=True)
    assert set(flat) == {"worldToCamera", "worldToNDC", "usdsplat:projection"}
