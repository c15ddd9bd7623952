"""The splats of one prim, and everywhere they are seen."""

from __future__ import annotations

from collections.abc import Mapping

from usdsplat.core.cloud import F64
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.instancing import Placement, Scatter, expand
from usdsplat.delegate.prim import Rprim, SceneDelegate
from usdsplat.delegate.render_param import RenderParam
from usdsplat.delegate.specs import CropSpec, InstanceSpec, SortingMode


class SplatField(Rprim):
    """One splat prim. Native instances and point instances of it share its arrays.

    The arrays of a field that cannot be seen are not pulled: PRIMVAR stays dirty until it shows.
    """

    INITIAL_DIRTY_BITS = DirtyBits.ALL & ~DirtyBits.PARAMS

    def __init__(self, path: str, instancers: Mapping[str, Scatter]) -> None:
        super().__init__(path)
        self._instancers = instancers
        self._placements: tuple[Placement, ...] = ()
        self._transforms: tuple[tuple[F64, ...], ...] = ()
        self._visible: tuple[bool, ...] = ()
        self._instances: tuple[InstanceSpec, ...] = ()
        self._crops: tuple[CropSpec, ...] = ()
        self._cropped_by: tuple[CropSpec, ...] = ()
        self.is_seen = False
        """Whether anything would show it, if it can be drawn."""
        self._resident = False
        self._shown = False
        self._hint: SortingMode = "zDepth"

    @property
    def sorting_hint(self) -> SortingMode | None:
        """The order that the prim asks for; None while it is not seen."""
        return self._hint if self._shown else None

    def sync(self, scene: SceneDelegate, param: RenderParam, bits: DirtyBits) -> DirtyBits:
        """Pull what `bits` marks and edit the render scene; `bits` is as in `Prim.sync`."""
        if bits & DirtyBits.INSTANCE_INDEX:
            self._placements = scene.placements(self.path)
        if bits & DirtyBits.TRANSFORM:
            self._transforms = scene.transforms(self.path)
        if bits & (DirtyBits.VISIBILITY | DirtyBits.RENDER_TAG):
            self._visible = scene.visible(self.path)
        if bits & DirtyBits.CATEGORIES:
            self._crops = scene.crops(self.path)
        seen = expand(self._placements, self._transforms, self._visible, self._instancers)
        self.is_seen = bool(seen)
        if not seen:
            self._show(param, False)
            return bits & DirtyBits.PRIMVAR
        if bits & DirtyBits.PRIMVAR:
            self._pull_arrays(scene, param)
        if self._resident:
            self._place(param, seen)
            self._crop(param)
            self._show(param, True)
        return DirtyBits.CLEAN

    def finalize(self, param: RenderParam) -> None:
        """Release the arrays."""
        if self._resident:
            param.edit().remove(self.path)
        self._resident = self._shown = False
        self._instances = ()
        self._cropped_by = ()

    def _pull_arrays(self, scene: SceneDelegate, param: RenderParam) -> None:
        """Make the render scene hold the prim's splats, or nothing when it has none to draw."""
        spec = scene.field(self.path)
        if spec is None:
            self.finalize(param)
            return
        param.edit().set_field(self.path, spec)
        self._resident = True
        self._hint = spec.sorting_mode

    def _place(self, param: RenderParam, seen: tuple[InstanceSpec, ...]) -> None:
        if seen != self._instances:
            param.edit().set_instances(self.path, seen)
            self._instances = seen

    def _crop(self, param: RenderParam) -> None:
        if self._crops != self._cropped_by:
            param.edit().set_crops(self.path, self._crops)
            self._cropped_by = self._crops

    def _show(self, param: RenderParam, shown: bool) -> None:
        if shown != self._shown:
            param.edit().set_visible(self.path, shown)
            self._shown = shown
