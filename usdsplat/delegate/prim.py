"""What a prim of the render index is, and whom it asks.

Hydra's contract: `sync` pulls only what `bits` marks, edits the render scene through
`RenderParam.edit()`, and returns what is still dirty; `finalize` takes back what it put there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from usdsplat.core.cloud import F64
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import InstancerSpec, Placement
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.specs import CameraSpec, CropSpec, FieldSpec, LightSpec, MeshSpec


class SceneDelegate(Protocol):
    """Answers for the prims of a scene; need not be able to answer for what is not dirty."""

    def field(self, path: str) -> FieldSpec | None:
        """The splats of a field; None when it cannot be drawn."""

    def mesh(self, path: str, bits: DirtyBits) -> MeshSpec | None:
        """A mesh, of which only what `bits` marks is read again; None when it cannot be drawn."""

    def crops(self, path: str) -> tuple[CropSpec, ...]:
        """The volumes that a field is cropped by, in the world."""

    def placements(self, path: str) -> tuple[Placement, ...]:
        """Every way by which a field or a mesh is seen."""

    def transforms(self, path: str) -> tuple[tuple[F64, ...], ...]:
        """For each placement the matrices of its levels, outermost first."""

    def visible(self, path: str) -> tuple[bool, ...]:
        """For each placement whether it is visible and of a wanted purpose."""

    def instancer(self, path: str) -> InstancerSpec:
        """The arrays of a point instancer."""

    def camera(self, path: str) -> CameraSpec | None:
        """A camera; None when it cannot be used."""

    def light(self, path: str) -> LightSpec | None:
        """A light; None when it is hidden or cannot be used."""


class Prim(ABC):
    """One prim of the render index."""

    INITIAL_DIRTY_BITS: DirtyBits
    """What a new prim of this kind must pull."""

    def __init__(self, path: str) -> None:
        self.path = path

    @abstractmethod
    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull what `bits` says changed and return what is still dirty."""

    def finalize(self, param: RenderParam) -> None:  # noqa: B027 - most prims put nothing there
        """Take back what `sync` put into the render scene."""


class Sprim(Prim):
    """State that pictures need, such as a camera or a light."""
