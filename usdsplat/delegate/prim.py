"""Base classes of prims of the render index, and the interface that they pull data from.

Hydra's contract: `sync` pulls only what `bits` marks, edits the render scene through
`RenderParam.edit()`, and returns the bits that are still dirty; `finalize` removes the prim's data
from the render scene.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from usdsplat.core.cloud import F64
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import InstancerSpec, Placement
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.lights.specs import LightSpec
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.specs import CameraSpec, CropSpec, FieldSpec, MeshSpec


class SceneDelegate(Protocol):
    """Source of the data of prims; only dirty data may be requested."""

    def field(self, path: str) -> FieldSpec | None:
        """Return the splats of a field, or None if it cannot be drawn."""

    def tree(self, path: str, bits: DirtyBits) -> TreeSpec | None:
        """Return a splat tree, reading only what `bits` marks, or None if it cannot be drawn."""

    def mesh(self, path: str, bits: DirtyBits) -> MeshSpec | None:
        """Return a mesh, reading only what `bits` marks, or None if it cannot be drawn."""

    def crops(self, path: str) -> tuple[CropSpec, ...]:
        """Return the crop volumes of a field, in the world."""

    def placements(self, path: str) -> tuple[Placement, ...]:
        """Return the placements of a field or a mesh."""

    def transforms(self, path: str) -> tuple[tuple[F64, ...], ...]:
        """Return the matrices of the levels of each placement, outermost first."""

    def visible(self, path: str) -> tuple[bool, ...]:
        """Return whether each placement is visible and of a drawn purpose."""

    def instancer(self, path: str) -> InstancerSpec:
        """Return the arrays of a point instancer."""

    def camera(self, path: str) -> CameraSpec | None:
        """Return a camera, or None if it is not usable."""

    def light(self, path: str) -> LightSpec | None:
        """Return a light, or None if it is invisible or not usable."""


class Prim(ABC):
    """A prim of the render index."""

    INITIAL_DIRTY_BITS: DirtyBits
    """Dirty bits of a new prim of this kind."""

    def __init__(self, path: str) -> None:
        self.path = path

    @abstractmethod
    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull the data that `bits` marks and return the bits that are still dirty."""

    def finalize(self, param: RenderParam) -> None:  # noqa: B027 - most prims put nothing there
        """Remove the prim's data from the render scene."""


class Sprim(Prim):
    """A prim that holds state, such as a camera or a light."""
