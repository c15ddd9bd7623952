"""Lights of the stage."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.prim import SceneDelegate, Sprim
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.lights.specs import LightSpec


class Light(Sprim):
    """A UsdLux light at the engine's time."""

    INITIAL_DIRTY_BITS = DirtyBits.TRANSFORM | DirtyBits.PARAMS | DirtyBits.VISIBILITY

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self._spec: LightSpec | None = None

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull the whole light, which is one small value. `bits` is as in `Prim.sync`."""
        if bits & self.INITIAL_DIRTY_BITS:
            self._shine(param, scene.light(self.path))
        return DirtyBits.CLEAN

    def finalize(self, param: RenderParam) -> None:
        """Remove the light from the render scene."""
        self._shine(param, None)

    def _shine(self, param: RenderParam, spec: LightSpec | None) -> None:
        if spec != self._spec:
            param.edit().set_light(self.path, spec)
            self._spec = spec
