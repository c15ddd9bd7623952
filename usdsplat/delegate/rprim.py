"""Base class of drawn prims."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

from usdsplat.core.cloud import F64
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import Placement, Scatter, expand
from usdsplat.delegate.prim import Prim, SceneDelegate
from usdsplat.delegate.render_param import RenderParam
from usdsplat.render.specs import InstanceSpec


class Rprim(Prim):
    """A drawn prim with arrays, shared by its native instances and point instances.

    Arrays of a prim without visible instances are not pulled: ARRAYS stay dirty until it is
    visible.
    """

    ARRAYS: DirtyBits
    """Bits of the data that `_pull` pulls."""

    def __init__(self, path: str, instancers: Mapping[str, Scatter]) -> None:
        super().__init__(path)
        self._instancers = instancers
        self._placements: tuple[Placement, ...] = ()
        self._transforms: tuple[tuple[F64, ...], ...] = ()
        self._visible: tuple[bool, ...] = ()
        self._instances: tuple[InstanceSpec, ...] = ()
        self.is_seen = False
        """Whether it has a visible instance."""
        self._resident = False
        self._shown = False

    @property
    def is_wanted(self) -> bool:
        """Whether an appearance is neither hidden nor of another purpose, wherever it is."""
        return any(self._visible)

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull what `bits` marks and edit the render scene; `bits` is as in `Prim.sync`."""
        if bits & DirtyBits.INSTANCE_INDEX:
            self._placements = scene.placements(self.path)
        if bits & DirtyBits.TRANSFORM:
            self._transforms = scene.transforms(self.path)
        if bits & (DirtyBits.VISIBILITY | DirtyBits.RENDER_TAG):
            self._visible = scene.visible(self.path)
        seen = expand(self._placements, self._transforms, self._visible, self._instancers)
        self.is_seen = bool(seen)
        if not seen:
            self._show(param, False)
            return bits & self.ARRAYS
        if bits & self.ARRAYS:
            if self._pull(scene, param, bits & self.ARRAYS):
                self._resident = True
            else:
                self.finalize(param)
        if self._resident:
            self._place(param, seen)
            self._show(param, True)
        return DirtyBits.CLEAN

    def finalize(self, param: RenderParam) -> None:
        """Release the arrays."""
        if self._resident:
            param.edit().remove(self.path)
        self._resident = self._shown = False
        self._instances = ()

    @abstractmethod
    def _pull(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> bool:
        """Set the arrays in the render scene; return False if there is nothing to draw."""

    def _place(self, param: RenderParam, seen: tuple[InstanceSpec, ...]) -> None:
        if seen != self._instances:
            param.edit().set_instances(self.path, seen)
            self._instances = seen

    def _show(self, param: RenderParam, shown: bool) -> None:
        if shown != self._shown:
            param.edit().set_visible(self.path, shown)
            self._shown = shown
