"""The render index: all prims of an engine, and the order of their sync."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TypeVar

from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.delegate.camera import Camera
from usdsplat.delegate.change_tracker import ChangeTracker
from usdsplat.delegate.instancer import Instancer
from usdsplat.delegate.light import Light
from usdsplat.delegate.mesh import Mesh
from usdsplat.delegate.prim import Prim, SceneDelegate
from usdsplat.delegate.render_buffer import RenderBuffer
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.splat_field import SplatField
from usdsplat.delegate.splat_tree import SplatTree
from usdsplat.render.specs import SortingMode

P = TypeVar("P", bound=Prim)


class RenderIndex:
    """Owner of rprims (fields, trees, meshes), instancers, sprims (cameras, lights), buffers."""

    def __init__(self, param: RenderParam) -> None:
        self.tracker = ChangeTracker()
        self._param = param
        self._fields: dict[str, SplatField] = {}
        self._meshes: dict[str, Mesh] = {}
        self._instancers: dict[str, Instancer] = {}
        self._cameras: dict[str, Camera] = {}
        self._lights: dict[str, Light] = {}
        self._buffers: dict[str, RenderBuffer] = {}
        self.fields: Mapping[str, SplatField] = MappingProxyType(self._fields)
        self.meshes: Mapping[str, Mesh] = MappingProxyType(self._meshes)
        self.instancers: Mapping[str, Instancer] = MappingProxyType(self._instancers)
        self.cameras: Mapping[str, Camera] = MappingProxyType(self._cameras)
        self.lights: Mapping[str, Light] = MappingProxyType(self._lights)

    def insert_field(self, path: str) -> None:
        """Add an rprim; it pulls everything at the next sync."""
        self._insert(self._fields, SplatField(path, self.instancers))

    def insert_tree(self, path: str) -> None:
        """Add an rprim; it pulls everything at the next sync."""
        self._insert(self._fields, SplatTree(path, self.instancers))

    def insert_mesh(self, path: str) -> None:
        """Add an rprim; it pulls everything at the next sync."""
        self._insert(self._meshes, Mesh(path, self.instancers))

    def insert_instancer(self, path: str) -> None:
        """Add an instancer; it pulls everything at the next sync."""
        self._insert(self._instancers, Instancer(path))

    def insert_camera(self, path: str) -> None:
        """Add a sprim; it pulls everything at the next sync."""
        self._insert(self._cameras, Camera(path))

    def insert_light(self, path: str) -> None:
        """Add a sprim; it pulls everything at the next sync."""
        self._insert(self._lights, Light(path))

    def remove_field(self, path: str) -> None:
        """Remove an rprim and what it put into the render scene."""
        self._remove(self._fields, path)

    def remove_mesh(self, path: str) -> None:
        """Remove an rprim and what it put into the render scene."""
        self._remove(self._meshes, path)

    def remove_instancer(self, path: str) -> None:
        """Remove an instancer; the rprims it carried must get new placements."""
        self._remove(self._instancers, path)

    def remove_camera(self, path: str) -> None:
        """Remove a sprim."""
        self._remove(self._cameras, path)

    def remove_light(self, path: str) -> None:
        """Remove a sprim and what it put into the render scene."""
        self._remove(self._lights, path)

    def buffer(self, aov: str) -> RenderBuffer:
        """Return the render buffer of an AOV, created on first use."""
        return self._buffers.setdefault(aov, RenderBuffer(aov))

    def find_camera(self, path: str) -> Camera:
        """Return the camera at `path`.

        Raises:
            StageError: If there is none.
        """
        if path not in self._cameras:
            known = ", ".join(sorted(self._cameras))
            expected = f"one of {known}" if known else "none: the stage has no cameras"
            raise StageError("camera", path, expected)
        return self._cameras[path]

    def sorting_hints(self) -> Iterator[tuple[str, SortingMode]]:
        """Yield (path, sorting hint) of the visible fields and splat trees."""
        for path, field in sorted(self._fields.items()):
            if field.sorting_hint is not None:
                yield path, field.sorting_hint
        for path, tree in self._param.scene.drawn_trees():
            yield path, tree.spec.sorting_mode

    def tree_problems(self) -> Iterator[tuple[str, Mapping[int, UsdSplatError]]]:
        """Yield (path, chunk -> why it could not be read) of the drawn trees."""
        for path, tree in self._param.scene.drawn_trees():
            yield path, tree.problems

    def sync_all(self, scene: SceneDelegate) -> None:
        """Sync dirty prims: sprims, then instancers, then the rprims that they carry.

        Render buffers have nothing to pull: the render pass allocates them.
        """
        kinds: tuple[Mapping[str, Prim], ...] = (
            self._cameras,
            self._lights,
            self._instancers,
            self._fields,
            self._meshes,
        )
        for kind in kinds:
            self._sync(kind, scene)

    def close(self) -> None:
        """Remove every prim."""
        for path in list(self._fields):
            self.remove_field(path)
        for path in list(self._meshes):
            self.remove_mesh(path)
        for path in list(self._instancers):
            self.remove_instancer(path)
        for path in list(self._cameras):
            self.remove_camera(path)
        for path in list(self._lights):
            self.remove_light(path)
        for buffer in self._buffers.values():
            buffer.deallocate()
        self._buffers.clear()

    def _sync(self, prims: Mapping[str, Prim], scene: SceneDelegate) -> None:
        for path, prim in prims.items():
            bits = self.tracker.bits(path)
            if bits:
                self.tracker.clean(path, prim.sync(scene, self._param, bits))

    def _insert(self, prims: dict[str, P], prim: P) -> None:
        prims[prim.path] = prim
        self.tracker.insert(prim.path, prim.INITIAL_DIRTY_BITS)

    def _remove(self, prims: dict[str, P], path: str) -> None:
        self.tracker.remove(path)
        prims.pop(path).finalize(self._param)
