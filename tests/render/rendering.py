"""A renderer, a lens and random splats without USD, for tests against the reference."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import reference
from usdsplat.kernels.devices import open_device
from usdsplat.render.band import BAND_PIXELS
from usdsplat.render.renderer import AOVS, Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, FieldSpec, Framing, InstanceSpec, View

SIZE = (150, 110)
FOCAL, CENTER = (120.0, 130.0), (70.0, 60.0)
OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def random_cloud(seed, n=250, degree=3):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    return SplatCloud(
        positions=rng.normal(size=(n, 3)).astype(np.float32),
        scales=rng.uniform(0.002, 0.12, (n, 3)).astype(np.float32),
        rotations=(q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32),
        opacities=rng.uniform(0, 1, n).astype(np.float32),
        sh=(0.4 * rng.normal(size=(n, (degree + 1) ** 2, 3))).astype(np.float32),
    )


def random_transform(seed):
    """Sheared, mirrored or not, never singular."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3)) + np.diag(rng.choice([-1.0, 1.0], 3))
    matrix[:3, 3] = rng.normal(size=3)
    return matrix


def lens(model="perspective"):
    view = np.eye(4)
    view[2, 3] = 4.0
    focal = FOCAL if model != "orthographic" else (20.0, 22.0)
    return reference.Lens(world_to_camera=view, focal=focal, center=CENTER, size=SIZE, model=model)


def view_of(eye, data_window=None):
    """The same lens, said in USD's words."""
    (fx, fy), (cx, cy), (width, height) = eye.focal, eye.center, eye.size
    camera = CameraSpec(
        world_to_camera=tuple((OPENCV @ eye.world_to_camera).ravel()),
        orthographic=eye.model == "orthographic",
        window=(-cx / fx, -(height - cy) / fy, (width - cx) / fx, cy / fy),
        clipping_range=(eye.near, eye.far),
    )
    framing = Framing(
        resolution=eye.size, data_window=data_window, conform="adjustPixelAspectRatio"
    )
    return View(camera=camera, framing=framing)


def scene_of(*parts, **options):
    scene = RenderScene()
    for i, (cloud, matrix) in enumerate(parts):
        scene.set_field(f"/field{i}", FieldSpec(cloud=cloud, **options))
        instance = InstanceSpec(path=f"/field{i}", transform=tuple(matrix.ravel()))
        scene.set_instances(f"/field{i}", (instance,))
    return scene


def settings_of(**settings):
    """Render settings with nothing left on auto."""
    return RenderSettings(**({"sorting": "zDepth", "color_mode": "display"} | settings))


def picture(
    scene, view, *, aovs=AOVS, threads=None, band_pixels=BAND_PIXELS, holdout=None, sampler=None,
    **settings,
):  # fmt: skip
    """All bands of a picture, joined."""
    renderer = Renderer(open_device(threads=threads))
    drawn = renderer.render(
        scene, view, settings_of(**settings), aovs,
        band_pixels=band_pixels, holdout=holdout, sampler=sampler,
    )  # fmt: skip
    bands = [{name: array.copy() for name, array in band.arrays.items()} for band in drawn]
    return {name: np.concatenate([band[name] for band in bands]) for name in aovs}
