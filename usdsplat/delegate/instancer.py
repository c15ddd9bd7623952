"""Point instancers; the rprims they carry read their arrays."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import NO_INSTANCES
from usdsplat.delegate.prim import Prim, SceneDelegate
from usdsplat.delegate.render_param import RenderParam


class Instancer(Prim):
    """A UsdGeomPointInstancer. It has no representation of its own in the render scene."""

    INITIAL_DIRTY_BITS = DirtyBits.INSTANCER

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.spec = NO_INSTANCES

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull the arrays; `bits` is as in `Prim.sync`."""
        if bits & DirtyBits.INSTANCER:
            self.spec = scene.instancer(self.path)
        return DirtyBits.CLEAN
