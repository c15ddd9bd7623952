"""Cameras of the stage."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.prim import SceneDelegate, Sprim
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.specs import CameraSpec


class Camera(Sprim):
    """A UsdGeomCamera at the engine's time."""

    INITIAL_DIRTY_BITS = DirtyBits.TRANSFORM | DirtyBits.PARAMS

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.spec: CameraSpec | None = None
        """None if the prim is not usable as a camera."""

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull the whole camera, which is one small value. `bits` is as in `Prim.sync`."""
        if bits & self.INITIAL_DIRTY_BITS:
            self.spec = scene.camera(self.path)
        return DirtyBits.CLEAN
