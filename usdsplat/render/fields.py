"""Fields of splats and meshes of a render scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.render.spatial_order import SpatialOrder
from usdsplat.render.specs import CropSpec, FieldSpec, InstanceSpec, MeshSpec, SurfaceSpec
from usdsplat.render.splat_budget import SplatBudget, SplatSubset
from usdsplat.render.splat_normals import NO_SURFACE, SurfaceValues, surface_values

SHAPES = ("positions", "rotations", "scales", "opacities")
"""Arrays of a cloud that projection reads."""

Box = tuple[F64, F64]
Drawn = tuple[str, "Field", InstanceSpec]
"""Path of a field, the field, and one of its instances."""
DrawnMesh = tuple[str, "Mesh", InstanceSpec]
"""Path of a mesh, the mesh, and one of its instances."""


@dataclass(slots=True)
class Field:
    """Splats of one prim and their instances."""

    spec: FieldSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    crops: tuple[CropSpec, ...] = ()
    """Volumes in the world that keep or remove splats."""
    local: Box | None = None
    """Conservative bounds in local space; computed on first use."""
    subject: Box | None = None
    """Bounds of the centres without outliers; computed on first use."""
    splat_budget: SplatBudget | None = None
    """Subsets for splat budgets; created on first use."""
    spatial_order: SpatialOrder = field(default_factory=SpatialOrder)
    """Spatial order of the splats in memory."""
    shapes: object = field(default_factory=object)
    """Token that is replaced whenever geometry or opacity changes."""
    radiance: object = field(default_factory=object)
    """Token that is replaced whenever harmonics change."""
    first_element: int = 0
    """Element id of the first splat."""
    surface: SurfaceValues | None = None
    """Normals of the surfaces that the splats lie on; computed on first use."""
    tree: str = ""
    """Path of the tree that these are splats of; empty for a prim's own."""
    is_inner: bool = False
    """Whether these splats stand for those of a tree below them. They are always antialiased, and
    drawn with samples of their own."""

    @property
    def is_node(self) -> bool:
        """Whether these are splats of nodes of a tree. A budget of splats does not reduce them."""
        return bool(self.tree)

    def subset(self, count: int) -> SplatSubset:
        """Return the `count` most conspicuous splats of the field."""
        if self.splat_budget is None:
            self.splat_budget = SplatBudget(self.spec.cloud)
        return self.splat_budget.part(count)

    def surface_values(self, rows: I32 | None) -> SurfaceValues:
        """Return the normals of all splats, or those of some rows. Nodes of trees have none."""
        if self.is_node:
            return NO_SURFACE
        if self.surface is None:
            self.surface = surface_values(self.spec)
        return self.surface if rows is None else self.surface.take(rows)

    def replace(self, spec: FieldSpec) -> None:
        """Replace the splats.

        Arrays with the same values as before stay the same objects, and everything computed from
        them is kept.
        """
        before, now, surface = self.spec.cloud, spec.cloud, self.spec.surface
        equal = {
            name: _equal(getattr(before, name), getattr(now, name)) for name in (*SHAPES, "sh")
        }
        kept = {name: getattr(before, name) for name, same in equal.items() if same}
        self.spec, self.splat_budget = replace(spec, cloud=replace(now, **kept)), None
        if not all(equal.values()) or not _equal_surface(surface, spec.surface):
            self.surface = None
        if not equal["sh"]:
            self.radiance = object()
        if not all(equal[name] for name in SHAPES):
            self.local, self.subject, self.shapes = None, None, object()
            self.spatial_order.forget()

    @property
    def is_drawn(self) -> bool:
        """Whether the field is visible, and has instances and splats."""
        return self.visible and bool(self.instances) and len(self.spec.cloud) > 0


@dataclass(slots=True)
class Mesh:
    """One opaque prim and its instances."""

    spec: MeshSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    local: Box | None = None
    """Bounds in local space; computed on first use."""
    subject: Box | None = None
    """Bounds in local space; a surface has no outliers."""

    @property
    def is_drawn(self) -> bool:
        """Whether the mesh is visible, and has instances and triangles."""
        return self.visible and bool(self.instances) and len(self.spec.triangles) > 0


def distinct_meshes(drawn: Sequence[DrawnMesh]) -> tuple[list[MeshSpec], I64]:
    """Return the distinct meshes, and the number of each appearance's mesh."""
    numbers: dict[int, int] = {}
    specs: list[MeshSpec] = []
    for _, mesh, _ in drawn:
        if numbers.setdefault(id(mesh.spec), len(specs)) == len(specs):
            specs.append(mesh.spec)
    return specs, np.array([numbers[id(mesh.spec)] for _, mesh, _ in drawn], np.int64)


def _equal(a: F32, b: F32) -> bool:
    """Return whether two arrays have the same values.

    A few rows are compared first: frames of an animation differ there already.
    """
    if a is b:
        return True
    if a.shape != b.shape:
        return False
    at, other = a.__array_interface__, b.__array_interface__
    if at["data"][0] == other["data"][0] and at["strides"] == other["strides"]:
        return True  # two views of USD's memory
    few = slice(None, None, max(1, len(a) // 64))
    return bool(np.array_equal(a[few], b[few]) and np.array_equal(a, b))


def _equal_surface(a: SurfaceSpec | None, b: SurfaceSpec | None) -> bool:
    """Return whether authored normals have the same values."""
    if a is None or b is None:
        return a is b
    pairs = ((a.normals, b.normals), (a.confidence, b.confidence), (a.occlusion, b.occlusion))
    return all(x is y or (x is not None and y is not None and _equal(x, y)) for x, y in pairs)
