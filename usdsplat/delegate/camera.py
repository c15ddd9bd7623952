"""A camera of the stage, as views take it."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.prim import SceneDelegate, Sprim
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.specs import CameraSpec


class Camera(Sprim):
    """One UsdGeomCamera at the engine's time."""

    INITIAL_DIRTY_BITS = DirtyBits.TRANSFORM | DirtyBits.PARAMS

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.spec: CameraSpec | None = None
        """None when the prim cannot be used as a camera."""

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull the camera whole: it is one small value. `bits` is as in `Prim.sync`."""
        if bits & self.INITIAL_DIRTY_BITS:
            self.spec = scene.camera(self.path)
        return DirtyBits.CLEAN
