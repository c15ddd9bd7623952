"""Place, rasterize and shade the meshes of a scene for a view. Kernels are launched in this order:

place, boxes            once per view
count, fill, raster     once per band
shade                   the same
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.core.errors import UsageError
from usdsplat.kernels import bins, raster, shade, triangles
from usdsplat.kernels.device import Device
from usdsplat.render.fields import DrawnMesh, distinct_meshes
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.matte import is_matte
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.surface_cache import PackedMeshes, SurfaceCache


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceLight:
    """Light that the surfaces of a band receive, pixel after pixel."""

    sums: F32
    """Light of all lights, see `lighting.illuminate`, shape (h * w, SUMS)."""
    parts: Mapping[str, F32]
    """AOV of a light group -> light of this group that colours are made of, shape (h * w, 3)."""
    first: int
    """First column of `sums` with that: light with shadows, or without."""
    ambient: float
    """Ambient light as a part of the light without shadows."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceBand:
    """Nearest surface of each pixel of a band.

    Arrays belong to the device and are valid until the next band.
    """

    depth: F32
    """Planar camera depth [scene unit], +inf where nothing is, shape (h, w)."""
    color: F32
    """Shaded colour, linear Rec.709, 0 where there is no surface or a matte, shape (h, w, 3)."""
    normal: F32
    """Unit normal in USD's camera space: x right, y up, z towards the viewer. It is on the visible
    side of the triangle, and 0 where there is no surface. Shape (h, w, 3)."""
    albedo: F32
    """Diffuse colour, linear Rec.709, not shaded, mattes included, shape (h, w, 3)."""
    covered: npt.NDArray[np.uint8]
    """0 nothing, 1 drawn, 2 matte, shape (h, w)."""
    ids: I32
    """Number of the prim in `RenderScene.prims`, number of the instance, authored face; -1 where
    there is no surface, shape (3, h, w)."""
    hit: I32
    """Row of `RenderScene.drawn_meshes` and triangle of that mesh, -1 where there is no surface,
    shape (2, h, w)."""
    bary: F32
    """Weights of the triangle's corners 1 and 2 at the pixel's centre, shape (h, w, 2)."""
    light: SurfaceLight | None = None
    """Light of the surfaces; None if it is not needed."""
    received: tuple[F32, I32] | None = None
    """Ratio of the light with and without shadows, shape (h * w, 3), and number of the prim, -1
    where there is no surface, shape (h * w,); None if they are not needed."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surfaces:
    """Opaque prims of a scene, placed for one view."""

    device: Device
    window: tuple[int, int, int, int]
    """Data window [pixel], end exclusive."""
    view: npt.NDArray[Any]
    """One VIEW record."""
    shapes: tuple[npt.NDArray[Any], ...]
    """The argument `shapes` of `raster.raster`."""
    boxes: I32
    normal_matrices: F64
    looks: tuple[npt.NDArray[Any], ...]
    lights: F32

    @classmethod
    def of(
        cls,
        device: Device,
        scene: RenderScene,
        screen: Screen,
        matte: tuple[tuple[str, bool], ...] = (),
        *,
        cache: SurfaceCache | None = None,
        shows: Callable[[str], bool] | None = None,
        is_two_sided: bool = False,
    ) -> Surfaces | None:
        """Project all triangles of a scene to the screen. Return None if no mesh is drawn.

        Args:
            matte: See `View.matte`.
            cache: Keeps the layout of the meshes for the next picture.
            shows: Whether the mesh at a path is drawn; None if all are.
            is_two_sided: Whether all meshes are drawn from both sides.

        Raises:
            UsageError: If there are 2**31 triangles or more.
        """
        drawn = scene.drawn_meshes()
        if shows is not None:
            drawn = [each for each in drawn if shows(each[2].path)]
        cache = cache or SurfaceCache()
        if not drawn:
            cache.clear()
            return None
        specs, which = distinct_meshes(drawn)
        packed = cache.packed(device, specs)
        firsts = _running(packed.triangles_of[which])
        vertex_firsts = _running(packed.points_of[which])
        if firsts[-1] > np.iinfo(np.int32).max:
            raise UsageError("scene", f"{firsts[-1]} triangles in one view", "less than 2**31")
        transforms = np.array([instance.transform for _, _, instance in drawn], np.float64)
        matrices = screen.world_to_camera[:3] @ transforms.reshape(-1, 4, 4)
        records = _appearances(drawn, which, packed, matrices, scene.prims(), matte)
        if is_two_sided:
            records["double_sided"] = True
        vertices = device.resident((int(vertex_firsts[-1]), triangles.VERTEX), np.float64)
        boxes = device.resident((int(firsts[-1]), 4), np.int32)
        keep = device.keep
        view, appearances = keep(view_record(screen)), keep(records)
        ends, vertex_ends = keep(firsts), keep(vertex_firsts)
        device.run(
            triangles.place, view, appearances, vertex_ends, keep(matrices), packed.points, vertices
        )
        device.run(
            triangles.boxes, view, appearances, ends, vertex_ends, vertices, packed.triangles, boxes
        )
        return cls(
            device=device,
            window=screen.window,
            view=view,
            shapes=(appearances, ends, vertex_ends, packed.triangles, vertices),
            boxes=boxes,
            normal_matrices=keep(_normal_matrices(matrices[:, :, :3])),
            looks=packed.looks,
            lights=keep(_lights([each for each in scene.lights if each.is_plain], screen)),
        )

    @property
    def material_of(self) -> I32:
        """Number of each triangle's material within its mesh, see `shade.shade`."""
        return self.looks[4]

    def draw(self, y0: int, y1: int, buffers: FrameBuffers) -> SurfaceBand:
        """Rasterize and shade rows y0 to y1 - 1 of the data window.

        Raises:
            UsageError: If triangles touch 2**31 tiles or more.
        """
        x0, _, x1, _ = self.window
        shape = y1 - y0, x1 - x0
        made = buffers.surfaces
        winner = made.winner(*shape)
        band = SurfaceBand(
            depth=made.depth(*shape),
            color=made.color(*shape),
            normal=made.normal(*shape),
            albedo=made.albedo(*shape),
            covered=made.covered(*shape),
            ids=made.ids(*shape),
            hit=made.hit(*shape),
            bary=made.bary(*shape),
        )
        self._raster(y0, y1, buffers, band.depth, winner)
        self.device.run(
            shade.shade, self.view, self.shapes, self.normal_matrices, self.looks, self.lights,
            np.array([x0, y0], np.int64), winner,
            (band.color, band.normal, band.albedo, band.covered, band.ids, band.hit, band.bary),
        )  # fmt: skip
        return band

    def draw_depths(self, buffers: FrameBuffers) -> F32:
        """Return the depths of the whole data window, see `SurfaceBand`."""
        x0, y0, x1, y1 = self.window
        shape = y1 - y0, x1 - x0
        depths: F32 = buffers.surfaces.depth(*shape)
        self._raster(y0, y1, buffers, depths, buffers.surfaces.winner(*shape))
        return depths

    def _raster(self, y0: int, y1: int, buffers: FrameBuffers, depth: F32, winner: I32) -> None:
        """Find the nearest triangle of each pixel of some rows, and its depth."""
        x0, _, x1, _ = self.window
        run = self.device.run
        grid = bins.grid_of(x0, y0, x1, y1)
        scene = self.view, self.shapes, self.boxes, grid
        starts, lists, pairs = run(
            raster.tile_lists,
            *scene,
            bins.tiles_in(grid),
            4 * self.device.threads,
            buffers.triangles.get,
        )
        if pairs > bins.MOST_PAIRS:
            raise UsageError("band", f"{pairs} pairs of triangle and tile", "less than 2**31")
        run(raster.raster, *scene, starts, lists, depth, winner)


def view_record(screen: Screen) -> npt.NDArray[Any]:
    """Return the VIEW record of the kernels, shape (1,)."""
    (fx, fy), (cx, cy), (near, far) = screen.focal, screen.center, screen.clipping_range
    values = (fx, fy, cx, cy, near, far, *screen.window, screen.orthographic)
    return np.array([values], triangles.VIEW)


def _running(lengths: I64) -> I64:
    """Return the offset of each range of these lengths, and the end of the last one."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(lengths)])


def _appearances(
    drawn: Sequence[DrawnMesh],
    which: I64,
    packed: PackedMeshes,
    matrices: F64,
    prims: Sequence[str],
    matte: tuple[tuple[str, bool], ...],
) -> npt.NDArray[Any]:
    """Return the APPEARANCE records."""
    places = {path: number for number, path in enumerate(prims)}
    paths = [instance.path for _, _, instance in drawn]
    mattes = {path: is_matte(path, matte) for path in set(paths)}
    records = np.zeros(len(drawn), triangles.APPEARANCE)
    for name, firsts in packed.rows.items():
        records[name] = firsts[which]
    records["prim"] = [places[path] for path in paths]
    records["instance"] = [instance.index for _, _, instance in drawn]
    records["double_sided"] = [mesh.spec.double_sided for _, mesh, _ in drawn]
    records["mirrored"] = np.linalg.det(matrices[:, :, :3]) < 0
    records["matte"] = [mattes[path] for path in paths]
    return records


def _normal_matrices(linear: F64) -> F64:
    """Return the cofactor matrices: the inverse transposes times the determinants.

    They exist for singular matrices too. Their sign does not matter, because the side of a normal
    follows from the triangle.
    """
    a, b, c = linear[:, 0], linear[:, 1], linear[:, 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)


def _lights(lights: Sequence[LightSpec], screen: Screen) -> F32:
    """Return directions to the lights in camera space and their irradiances, shape (n, LIGHT)."""
    rows = np.zeros((len(lights), shade.LIGHT))
    for row, light in zip(rows, lights, strict=True):
        towards = -screen.world_to_camera[:3, :3] @ np.array(light.direction, np.float64)
        length = np.linalg.norm(towards)
        row[:3] = towards / length if length > 0 else 0.0
        row[3:] = light.irradiance
    return rows.astype(np.float32)
