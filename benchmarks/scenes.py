"""Scenes of the measurements: the captures and the garden of the test data, as render scenes."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from usdsplat import formats
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.sh import rgb_to_dc
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CameraSpec, FieldSpec, Framing, InstanceSpec, View

SHARED = Path(__file__).resolve().parents[2] / "shared"
DATA = Path(os.environ.get("USDSPLAT_TEST_DATA") or SHARED / "data")
CAPTURES = ("statue_angel.sog", "playbot_lod2.sog", "flowers_lod2_0.sog", "pod.spz")
OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def scene_of(cloud: SplatCloud) -> RenderScene:
    """Return a scene with one field, at the origin."""
    scene = RenderScene()
    scene.set_field("/field", FieldSpec(cloud=cloud))
    scene.set_instances("/field", (InstanceSpec(path="/field"),))
    return scene


def view_of(view: F64, k: F64, size: tuple[int, int]) -> View:
    """Return a view from an OpenCV world-to-camera matrix and intrinsics [pixel]."""
    fx, fy, cx, cy = k[0, 0], k[1, 1], k[0, 2], k[1, 2]
    camera = CameraSpec(
        world_to_camera=tuple((OPENCV @ view.astype(np.float64)).ravel()),
        window=(-cx / fx, -(size[1] - cy) / fy, (size[0] - cx) / fx, cy / fy),
        clipping_range=(0.01, 1e10),
    )
    return View(camera=camera, framing=Framing(resolution=size, conform="adjustPixelAspectRatio"))


def looking_at(center: F64, turn: float, away: float, size: tuple[int, int]) -> tuple[F64, F64]:
    """Return the view matrix and the intrinsics [pixel] of a camera that looks down at a centre.

    Args:
        center: In the coordinates of a capture, with y down.
        turn: Azimuth of the camera [radian].
        away: Its distance.
        size: Width and height of the picture [pixel]; its height is 1 / 1.2 of the focal length.
    """
    focal = 1.2 * size[1]
    k = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    back = np.array([np.sin(turn), -0.25, np.cos(turn)])
    back /= np.linalg.norm(back)
    right = np.cross([0, -1.0, 0], back)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(-back, right), -back])
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = -axes @ (center + back * away)
    return matrix, k


def afresh(view: View, number: int) -> View:
    """Return the view with a slightly different camera for each number, so that no results of the
    last picture are reused."""
    near, far = view.camera.clipping_range
    return replace(
        view, camera=replace(view.camera, clipping_range=(near * (1 + 1e-6 * number), far))
    )


def capture(name: str) -> tuple[RenderScene, F64, F64]:
    """Return one of CAPTURES, with the view matrix of its first reference picture and K at
    640x480."""
    oracle = np.load(DATA / "oracle" / "images" / f"{Path(name).stem}.npz")
    cloud = formats.read(DATA / "splats" / name).cloud
    return scene_of(cloud), oracle["viewmats"][0], oracle["K"].astype(np.float64)


def garden(grid: int = 1, *, degree: int = 0) -> tuple[SplatCloud, F64, F64]:
    """Return the garden tiled grid x grid with period 4, its camera 0 and K at 1920x1080.

    Harmonics above degree 0 are small random numbers with a fixed seed. Their cost is that of real
    ones.
    """
    scene = np.load(DATA / "garden" / "scene.npz")
    reach = grid // 2
    shifts = 4.0 * np.array(
        [(i, j, 0) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)], np.float32
    )
    positions = (scene["means"][None] + shifts[:, None]).reshape(-1, 3)
    n, copies = len(positions), len(shifts)
    sh: F32 = np.zeros((n, (degree + 1) ** 2, 3), np.float32)
    if degree:
        sh[:] = np.random.default_rng(0).normal(0, 0.05, sh.shape)
    sh[:, 0] = rgb_to_dc(np.tile(scene["rgb"], (copies, 1)))
    cloud = SplatCloud(
        positions=positions,
        scales=np.tile(scene["scales"], (copies, 1)),
        rotations=np.tile(scene["quats"], (copies, 1)),
        opacities=np.tile(scene["opacities"], copies),
        sh=sh,
    )
    return cloud, scene["viewmats"][0], scene["K_1080"].astype(np.float64)


def scaled(k: F64, factor: float) -> F64:
    """Return the intrinsics of the same lens at `factor` times the resolution."""
    k = k * factor
    k[2, 2] = 1.0
    return k


def lens_of(k: F64, size: tuple[int, int]) -> F64:
    """Return the garden's lens at another size, with its axis in the middle, as in the
    yardstick."""
    k = scaled(k, size[0] / 1920)
    k[:2, 2] = size[0] / 2, size[1] / 2
    return k
