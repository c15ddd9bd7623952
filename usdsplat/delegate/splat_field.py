"""Splat fields."""

from __future__ import annotations

from collections.abc import Mapping

from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import Scatter
from usdsplat.delegate.prim import SceneDelegate
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.rprim import Rprim
from usdsplat.render.specs import CropSpec, InstanceSpec, SortingMode


class SplatField(Rprim):
    """A splat prim with all its instances."""

    ARRAYS = DirtyBits.PRIMVAR
    INITIAL_DIRTY_BITS = DirtyBits.PLACING | DirtyBits.INSTANCER | DirtyBits.CATEGORIES | ARRAYS

    def __init__(self, path: str, instancers: Mapping[str, Scatter]) -> None:
        super().__init__(path, instancers)
        self._crops: tuple[CropSpec, ...] = ()
        self._cropped_by: tuple[CropSpec, ...] = ()
        self._hint: SortingMode = "zDepth"

    @property
    def sorting_hint(self) -> SortingMode | None:
        """Sorting hint of the prim; None while it is not visible."""
        return self._hint if self._shown else None

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull what `bits` marks and edit the render scene; `bits` is as in `Prim.sync`."""
        if bits & DirtyBits.CATEGORIES:
            self._crops = scene.crops(self.path)
        return super().sync(scene, param, bits)

    def finalize(self, param: RenderParam) -> None:
        """Release the arrays."""
        super().finalize(param)
        self._cropped_by = ()

    def _pull(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> bool:
        spec = scene.field(self.path)
        if spec is None:
            return False
        param.edit().set_field(self.path, spec)
        self._hint = spec.sorting_mode
        return True

    def _place(self, param: RenderParam, seen: tuple[InstanceSpec, ...]) -> None:
        super()._place(param, seen)
        if self._crops != self._cropped_by:
            param.edit().set_crops(self.path, self._crops)
            self._cropped_by = self._crops
