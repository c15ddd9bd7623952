"""A scene with every feature, and all ways to draw it, for comparing devices. It needs no USD.

It has two fields, one of them with two instances, sheared and mirrored; a mesh with a texture,
another with colours at its corners, both lit; a crop; and, by case, a splat tree, matte prims,
holdouts, samples, and every setting that selects another kernel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.render.lod.trees import made
from tests.render.rendering import lens, random_cloud, settings_of, view_of
from tests.render.surface_scenes import add, mesh, sheet
from usdsplat.kernels.device import Device
from usdsplat.render.deep_samples import DeepSamples
from usdsplat.render.lights.dome import split
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.renderer import AOVS, Renderer
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import (
    CropSpec,
    FieldSpec,
    Framing,
    InstanceSpec,
    MaterialSpec,
    TextureSpec,
    View,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One way to draw the scene."""

    settings: dict[str, Any]
    surfaces: bool = True
    crops: bool = False
    lamp: bool = False
    """Whether there is a rect light besides the sun."""
    sky: bool = False
    """Whether there is a dome."""
    catchers: tuple[tuple[str, bool], ...] = ()
    tree: bool = False
    """Whether there is a splat tree, seen at several levels."""
    matte: tuple[tuple[str, bool], ...] = ()
    holdout: str = ""
    """"", "flat" or "deep"."""
    model: str = "perspective"
    aovs: tuple[str, ...] = AOVS


CASES: dict[str, Case] = {
    "splats alone": Case(settings={}, surfaces=False),
    "surfaces": Case(settings={}),
    "crops": Case(settings={"sh_degree": 1}, surfaces=False, crops=True),
    "distance": Case(settings={"sorting": "cameraDistance"}, surfaces=False),
    "rays": Case(settings={"sorting": "rayHitDistance"}, surfaces=False),
    "rays and surfaces": Case(settings={"sorting": "rayHitDistance"}),
    "orthographic": Case(settings={"sorting": "rayHitDistance"}, model="orthographic"),
    "tangential": Case(settings={"rasterize_mode": "antialiased"}, model="tangential"),
    "lamp": Case(settings={"light_samples": 4}, lamp=True),
    "shadows": Case(
        settings={"lighting": "shadowed", "light_samples": 3, "shadow_resolution": 64}, lamp=True
    ),
    "light groups": Case(
        settings={"lighting": "relit", "light_samples": 2, "shadow_resolution": 64},
        lamp=True,
        aovs=("color", "irradiance", "light_default", "light_lamp", "light_captured"),
    ),
    "light groups and samples": Case(
        settings={"lod_error": 4.0, "lod_samples": 2, "samples": 2, "lighting": "shadowed"},
        lamp=True,
        tree=True,
        aovs=("color", "light_default", "light_lamp", "light_captured"),
    ),
    "sky": Case(
        settings={"lighting": "shadowed", "dome_samples": 3, "shadow_resolution": 64}, sky=True
    ),
    "catchers": Case(settings={"light_samples": 1}, catchers=(("/second", True), ("/wall", True))),
    "matte splats": Case(settings={}, matte=(("/second", True),)),
    "matte mesh": Case(settings={}, matte=(("/wall", True),)),
    "flat holdout": Case(settings={}, holdout="flat"),
    "flat holdout alone": Case(settings={}, surfaces=False, holdout="flat"),
    "deep holdout": Case(settings={"sorting": "rayHitDistance"}, holdout="deep"),
    "points": Case(settings={"display_mode": "points"}),
    "ellipses": Case(settings={"display_mode": "ellipses"}, matte=(("/second", True),)),
    "normals": Case(settings={"display_mode": "normals"}, surfaces=False),
    "budget": Case(settings={"splat_budget": 150}),
    "linear": Case(settings={"blend_space": "linear", "color_mode": "scene"}),
    "inverse view": Case(settings={"color_mode": "inverseView"}),
    "samples": Case(settings={"samples": 3}),
    "tree": Case(settings={"lod_error": 4.0, "lod_samples": 2}, tree=True),
    "tree and samples": Case(
        settings={"lod_error": 4.0, "lod_samples": 2, "samples": 3}, surfaces=False, tree=True
    ),
    "tree in colour": Case(settings={"lod_error": 4.0}, surfaces=False, tree=True, aovs=("color",)),
}
DEEP = ("splats alone", "rays", "rays and surfaces", "matte splats", "flat holdout", "deep holdout")
"""Cases that are drawn as deep pictures, too."""


def scene_of(case: Case, splats: int) -> RenderScene:
    """The scene, with so many splats in each field."""
    rng = np.random.default_rng(5)
    scene = RenderScene()
    mode = "tangential" if case.model == "tangential" else "perspective"
    for k, degree in enumerate((3, 1)):
        path = ("/first", "/second")[k]
        cloud = random_cloud(k, splats, degree)
        spec = FieldSpec(cloud=cloud, projection_mode=mode)  # type: ignore[arg-type]
        scene.set_field(path, spec)
    sheared = np.eye(4)
    sheared[0, 1], sheared[1, 1], sheared[0, 3] = 0.4, -0.8, 0.9
    placed = [("/first", 0, np.eye(4)), ("/second", 0, sheared), ("/second", 1, np.eye(4))]
    for path in ("/first", "/second"):
        scene.set_instances(
            path,
            tuple(
                InstanceSpec(
                    path=path,
                    index=i,
                    transform=tuple(matrix.ravel()),
                    asset="/set",
                    material="/looks/moss" if path == "/second" else "",
                )
                for at, i, matrix in placed
                if at == path
            ),
        )
    if case.crops:
        moved = np.eye(4)
        moved[:3, 3] = 0.3
        keeps = CropSpec(shape="sphere", world_to_shape=tuple(0.6 * moved.ravel()), keeps=True)
        drops = CropSpec(shape="cube", world_to_shape=tuple(3 * np.eye(4).ravel()), keeps=False)
        scene.set_crops("/first", (keeps, drops))
    if case.tree:
        tree = made(3, n=2 * splats, leaf=max(4, splats // 8), error=0.06)
        scene.set_tree("/tree", tree.spec(projection_mode=mode))
        far = np.diag([0.6, 0.6, 0.6, 1.0])
        far[2, 3] = -3.0
        scene.set_instances(
            "/tree",
            tuple(
                InstanceSpec(path="/tree", index=i, transform=tuple(matrix.ravel()))
                for i, matrix in enumerate((sheared, far))
            ),
        )
    if case.surfaces:
        points, triangles, uvs = sheet(6, 5, lambda u, v: (3 * u - 1.5, 2 * v - 1, u - 0.6))
        picture = TextureSpec(pixels=rng.random((13, 22, 3), np.float32))
        material = MaterialSpec(diffuse=(0.9, 0.8, 0.7), texture=picture, path="/looks/moss")
        plain = replace(material, path="/looks/bark")
        wall = mesh(
            points, triangles, uvs=uvs[triangles].astype(np.float32), materials=(material, plain),
            material_of=np.arange(len(triangles), dtype=np.int32) % 2,
        )  # fmt: skip
        add(scene, "/wall", wall)
        corners = rng.random((2, 3, 3), np.float32)
        leaf = mesh(
            rng.normal(size=(6, 3)) * 0.8,
            colors=corners,
            normals=corners - np.float32(0.5),
            materials=(MaterialSpec(uses_colors=True),),
        )
        add(scene, "/leaf", leaf, np.eye(4), sheared)
        scene.set_light("/sun", LightSpec(direction=(0.0, -0.6, -0.8), irradiance=(1.0, 0.9, 0.8)))
    if case.lamp:
        matrix = np.diag([1.0, 1.0, 1.0, 1.0])
        matrix[:3, 3] = 0.3, 0.5, 2.0
        lamp = LightSpec(
            kind="rect", size=(1.0, 0.5), to_world=tuple(matrix.ravel()), radiance=(4.0, 3.0, 2.0),
            group="light_lamp",
        )  # fmt: skip
        scene.set_light("/lamp", lamp)
    if case.sky:
        sky, _ = split(rng.random((6, 12, 3), np.float32))
        whole = LightSpec(
            kind="dome", sky=sky, to_world=tuple(np.eye(4).ravel()), radiance=(0.5,) * 3
        )
        scene.set_light("/sky", whole)
    return scene


def view_on(case: Case, size: tuple[int, int]) -> View:
    """The case's camera, whose picture has that size."""
    view = view_of(lens("perspective" if case.model == "tangential" else case.model))
    framing = Framing(resolution=size, conform="adjustPixelAspectRatio")
    camera = replace(view.camera, lens_radius=0.02, focus_distance=4.0, shutter=(-0.5, 0.5))
    return replace(view, camera=camera, framing=framing, matte=case.matte, catchers=case.catchers)


def _moved(view: View, time: float) -> View:
    matrix = np.array(view.camera.world_to_camera).reshape(4, 4)
    matrix[0, 3] += 0.05 * time
    return replace(view, camera=replace(view.camera, world_to_camera=tuple(matrix.ravel())))


def holdout_of(case: Case) -> Any:
    """What the case's holdout has in some rows, or None."""

    def flat(x0: int, y0: int, x1: int, y1: int) -> Any:
        y, x = np.mgrid[y0:y1, x0:x1].astype(np.float32)
        return np.where((x + y) % 16 < 6, np.float32(3.5) + np.float32(0.02) * x, np.inf).astype(
            np.float32
        )

    def deep(x0: int, y0: int, x1: int, y1: int) -> Any:
        # in turn nothing, a step, and a step in front of a sample with an extent
        pixels = (y1 - y0) * (x1 - x0)
        counts = (2 * (np.arange(pixels) % 3)).astype(np.int64)
        offsets = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
        order = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
        depths = np.float32([3.0, 3.0, 3.4, 4.6])[order]
        return offsets, depths, np.float32([1.0, 0.8, 0.8, 0.3])[order]

    return {"": None, "flat": flat, "deep": deep}[case.holdout]


def drawn(device: Device, case: Case, *, size: tuple[int, int], splats: int) -> dict[str, Any]:
    """All AOVs of a case, in two bands that are joined, and what was counted as "stats"."""
    scene, view = scene_of(case, splats), view_on(case, size)
    renderer = Renderer(device)
    bands = renderer.render(
        scene, view, settings_of(**case.settings), case.aovs,
        sampler=lambda time: (scene, _moved(view, time)), holdout=holdout_of(case),
        band_pixels=size[0] * size[1] // 2 + size[0],
    )  # fmt: skip
    parts = [{name: array.copy() for name, array in band.arrays.items()} for band in bands]
    arrays: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts]) for name in case.aovs
    }
    stats = renderer.stats
    arrays["stats"] = np.array([stats.visible, stats.pairs], np.float64)
    return arrays


def drawn_deep(
    device: Device,
    case: Case,
    error: float,
    *,
    size: tuple[int, int],
    splats: int,
    aovs: tuple[str, ...] = (),
    samples: int = 1,
) -> list[DeepSamples]:
    """A case as a deep picture, band by band."""
    scene, view = scene_of(case, splats), view_on(case, size)
    settings = settings_of(**case.settings | {"samples": samples}, deep_error=error)
    bands = Renderer(device).render_deep(
        scene, view, settings, aovs,
        sampler=lambda time: (scene, _moved(view, time)), holdout=holdout_of(case),
    )  # fmt: skip
    names = ("counts", "depth", "depth_back", "color", "left", "ids")
    return [replace(s, **{name: getattr(s, name).copy() for name in names}) for _, _, s in bands]
