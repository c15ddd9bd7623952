"""Small scenes of meshes, with their screens."""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.devices import open_device
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.specs import CameraSpec, Framing, InstanceSpec, MeshSpec, View
from usdsplat.render.surfaces import SurfaceBand, Surfaces

SIZE = (150, 110)
FIELDS = ("depth", "color", "normal", "albedo", "covered", "bary")
STACKED = ("ids", "hit")


def screen_of(
    size=SIZE, window=(-0.6, -0.4, 0.7, 0.5), *, matrix=None, clip=(0.1, 1e4), data=None,
    orthographic=False,
) -> Screen:  # fmt: skip
    """A camera at the origin that looks along −z unless `matrix`, world to camera, says so."""
    camera = CameraSpec(
        world_to_camera=tuple(np.eye(4).ravel() if matrix is None else np.asarray(matrix).ravel()),
        window=window,
        clipping_range=clip,
        orthographic=orthographic,
    )
    framing = Framing(resolution=size, data_window=data, conform="adjustPixelAspectRatio")
    return Screen.of(View(camera=camera, framing=framing))


def mesh(points, triangles=None, **options) -> MeshSpec:
    """A mesh; each three points are a triangle where nothing else is said."""
    points = np.asarray(points, np.float32).reshape(-1, 3)
    if triangles is None:
        triangles = np.arange(len(points)).reshape(-1, 3)
    triangles = np.asarray(triangles, np.int32).reshape(-1, 3)
    options.setdefault("faces", np.arange(len(triangles), dtype=np.int32))
    return MeshSpec(points=points, triangles=triangles, **options)


def add(scene, path, spec, *transforms) -> RenderScene:
    """Put a mesh into a scene, once for each 4x4 local-to-world."""
    scene.set_mesh(path, spec)
    transforms = transforms or (np.eye(4),)
    scene.set_instances(
        path,
        tuple(
            InstanceSpec(path=path, index=i, transform=tuple(np.asarray(each).ravel()))
            for i, each in enumerate(transforms)
        ),
    )
    return scene


def draw(scene, screen, *, bands=None, threads=None, **options) -> SurfaceBand:
    """The whole data window, band after band, joined."""
    device = open_device(threads=threads)
    surfaces = Surfaces.of(device, scene, screen, **options)
    assert surfaces is not None
    scratch = FrameBuffers(device.resident)
    _, y0, _, y1 = screen.window
    parts = []
    for top, bottom in bands or [(y0, y1)]:
        band = surfaces.draw(top, bottom, scratch)
        names = (*FIELDS, *STACKED)
        parts.append({name: device.fetch(getattr(band, name)).copy() for name in names})
    joined = {name: np.concatenate([part[name] for part in parts]) for name in FIELDS}
    stacked = {name: np.concatenate([part[name] for part in parts], axis=1) for name in STACKED}
    return SurfaceBand(**joined, **stacked)


def arrays_of(band) -> dict:
    """All arrays, rows and columns first."""
    stacked = {name: np.moveaxis(getattr(band, name), 0, -1) for name in STACKED}
    return {name: getattr(band, name) for name in FIELDS} | stacked


def assert_same(a, b) -> None:
    """Two bands are the same, bit for bit."""
    a, b = arrays_of(a), arrays_of(b)
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def sheet(columns, rows, place):
    """Points and triangles of a grid; `place` takes u and v in [0, 1] to points. Also u and v."""
    u, v = (
        each.ravel()
        for each in np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    )
    i = np.arange(len(u)).reshape(rows + 1, columns + 1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack(place(u, v), axis=1), triangles, np.stack([u, v], axis=1)


def sphere(columns=96, rows=48):
    """Points and triangles of the unit sphere, seen from outside."""
    points, triangles, _ = sheet(
        columns,
        rows,
        lambda u, v: (
            np.sin(np.pi * v) * np.cos(2 * np.pi * u),
            -np.cos(np.pi * v),
            -np.sin(np.pi * v) * np.sin(2 * np.pi * u),
        ),
    )
    return points, triangles


def to_camera(screen, points, transform=None):
    """Points in the kernels' camera space, float64."""
    matrix = screen.world_to_camera @ (np.eye(4) if transform is None else transform)
    return np.asarray(points, np.float32).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
