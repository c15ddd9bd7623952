"""The fields of splats and the meshes of a render scene."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.render.spatial_order import SpatialOrder
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec, MeshSpec
from usdsplat.render.splat_budget import SplatBudget, SplatSubset

SHAPES = ("positions", "rotations", "scales", "opacities")
"""Arrays of a cloud that projection reads."""

Box = tuple[F64, F64]
Drawn = tuple[str, "Field", InstanceSpec]
"""Path of a field, the field, and one of its instances."""
DrawnMesh = tuple[str, "Mesh", InstanceSpec]
"""Path of a mesh, the mesh, and one of its instances."""


@dataclass(slots=True)
class Field:
    """One range of splats and where it is seen."""

    spec: FieldSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    crops: tuple[CropSpec, ...] = ()
    """Volumes in the world by which its splats are kept or left out."""
    local: Box | None = None
    """Bounds in its own space, conservative; computed when first asked for."""
    subject: Box | None = None
    """Bounds of the centres without strays; computed when first asked for."""
    thinning: SplatBudget | None = None
    """What a budget leaves of it; made when first asked for."""
    laying: SpatialOrder = field(default_factory=SpatialOrder)
    """How its splats lie in memory."""
    shapes: object = field(default_factory=object)
    """Another one whenever its splats are elsewhere or of another form or opacity."""
    radiance: object = field(default_factory=object)
    """Another one whenever their harmonics are others."""

    def thinned(self, count: int) -> SplatSubset:
        """Return its `count` most conspicuous splats."""
        if self.thinning is None:
            self.thinning = SplatBudget(self.spec.cloud)
        return self.thinning.part(count)

    def replace(self, spec: FieldSpec) -> None:
        """Take other splats; arrays with the same numbers as before stay the same objects, and all
        that was made of them stays with them."""
        before, now = self.spec.cloud, spec.cloud
        equal = {
            name: _equal(getattr(before, name), getattr(now, name)) for name in (*SHAPES, "sh")
        }
        kept = {name: getattr(before, name) for name, same in equal.items() if same}
        self.spec, self.thinning = replace(spec, cloud=replace(now, **kept)), None
        if not equal["sh"]:
            self.radiance = object()
        if not all(equal[name] for name in SHAPES):
            self.local, self.subject, self.shapes = None, None, object()
            self.laying.forget()

    @property
    def is_drawn(self) -> bool:
        """Whether there is anything of it to see."""
        return self.visible and bool(self.instances) and len(self.spec.cloud) > 0


@dataclass(slots=True)
class Mesh:
    """One opaque prim and where it is seen."""

    spec: MeshSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    local: Box | None = None
    """Bounds in its own space; computed when first asked for."""
    subject: Box | None = None
    """The same: a surface has no strays."""

    @property
    def is_drawn(self) -> bool:
        """Whether there is anything of it to see."""
        return self.visible and bool(self.instances) and len(self.spec.triangles) > 0


def _equal(a: F32, b: F32) -> bool:
    """Whether two arrays hold the same numbers; those of an animation differ at first sight."""
    few = slice(None, None, max(1, len(a) // 64))
    return a is b or (
        a.shape == b.shape and np.array_equal(a[few], b[few]) and np.array_equal(a, b)
    )
