"""Opaque surfaces."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.prim import SceneDelegate
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.rprim import Rprim


class Mesh(Rprim):
    """A mesh, or one of UsdGeom's parametric shapes."""

    ARRAYS = DirtyBits.SURFACE
    INITIAL_DIRTY_BITS = DirtyBits.PLACING | DirtyBits.INSTANCER | ARRAYS

    def _pull(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> bool:
        spec = scene.mesh(self.path, bits)
        if spec is None:
            return False
        param.edit().set_mesh(self.path, spec)
        return True
