"""Splat trees."""

from __future__ import annotations

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.prim import SceneDelegate
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.splat_field import SplatField


class SplatTree(SplatField):
    """A prim with a tree of splats and all its instances. Its chunks are read when drawn."""

    ARRAYS = DirtyBits.PRIMVAR | DirtyBits.TOPOLOGY
    INITIAL_DIRTY_BITS = SplatField.INITIAL_DIRTY_BITS | ARRAYS

    def _pull(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> bool:
        spec = scene.tree(self.path, bits)
        if spec is None:
            return False
        param.edit().set_tree(self.path, spec)
        self._hint = spec.sorting_mode
        return True
