"""Read the binding of a field to a skeleton, and the skeleton's pose.

Bind transforms are in the simulation's space, with the skeleton's placement at the start. A field
whose own primvars name joints is bound by `skel:geomBindTransform`, like any prim of UsdSkel. A
field that takes its joints from a mesh is bound where it is at the start, unless it has such a
transform itself.
"""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.schema.values import value
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.specs import SkinBinding, SkinPose, Surface
from usdsplat.sim.stage.skeletons import Influences, Rigs, matrix_of, skinning_transforms
from usdsplat.sim.stage.spaces import Space, transform_points
from usdsplat.sim.stage.targets import SurfaceReader, Triangles, facing_outwards, related

SKELETON = f"{NAMESPACE}:skin:skeleton"
MESH = f"{NAMESPACE}:skin:mesh"


class BindingReader:
    """Reader of the skeleton that a simulation names, for one field.

    Args:
        simulation: Prim with the relationships.
        skeleton: Target of the first of them.
        count: Number of splats of the field.
        space: The simulation's space; has the field.
        rigs: Skinning of the stage.
        by_triangles: Whether splats follow the mesh's triangles instead of joints.

    Raises:
        StageError: If the joints of the splats are not defined, or do not fit.
    """

    def __init__(
        self,
        simulation: Usd.Prim,
        skeleton: Usd.Prim,
        count: int,
        space: Space,
        rigs: Rigs,
        *,
        by_triangles: bool,
    ) -> None:
        self._skeleton, self._space = skeleton, space
        self._query = rigs.query(skeleton)
        self._bound_from = space.from_prim(skeleton, space.start)
        self._mesh: SurfaceReader | None = None
        mesh = related(simulation, MESH)
        own = rigs.influences(space.field, skeleton, count)
        if mesh is None:
            self.binding = self._of_field(simulation, own)
        else:
            self.binding = self._of_mesh(mesh, own, rigs)
            if by_triangles:
                self._mesh = SurfaceReader(mesh, space, rigs)

    def at(self, time: Usd.TimeCode) -> SkinPose:
        """Return the pose at a time."""
        now = self._space.from_prim(self._skeleton, time)
        joints = now @ skinning_transforms(self._query, time) @ np.linalg.inv(self._bound_from)
        return SkinPose(joints=joints, surface=self._mesh.at(time) if self._mesh else None)

    def _of_field(self, simulation: Usd.Prim, own: Influences | None) -> SkinBinding:
        """Bind by the primvars of the field."""
        if own is None:
            found = "no mesh, and no joint weights on the field"
            raise StageError(f"{simulation.GetPath()}.{MESH}", found, "either of them")
        bind = self._bound_from @ own.bind
        return SkinBinding(indices=own.indices, weights=own.weights, bind=bind)

    def _of_mesh(self, mesh: Usd.Prim, own: Influences | None, rigs: Rigs) -> SkinBinding:
        """Bind by a mesh; joints of the field itself take precedence."""
        where = str(mesh.GetPath())
        if not mesh.IsA(UsdGeom.Mesh):
            raise StageError(where, f"a prim of type {mesh.GetTypeName()!s}", "a Mesh")
        points, triangles = Triangles(mesh, rigs).rest(Usd.TimeCode.Default())
        follows = rigs.influences(mesh, self._skeleton, len(points))
        if follows is None:
            found = "a mesh without joint weights"
            raise StageError(where, found, f"a mesh bound to {self._skeleton.GetPath()}")
        matrix = self._bound_from @ follows.bind
        surface = Surface(
            points=transform_points(matrix, points), triangles=facing_outwards(triangles, matrix)
        )
        return SkinBinding(
            indices=None if own is None else own.indices,
            weights=None if own is None else own.weights,
            bind=self._field_bind(),
            surface=surface,
            surface_indices=follows.indices,
            surface_weights=follows.weights,
        )

    def _field_bind(self) -> F64:
        """Return the bind transform of a field without joints of its own: authored, or its
        transform at the start."""
        name = UsdSkel.Tokens.primvarsSkelGeomBindTransform
        found = value(self._space.field.GetAttribute(name), Usd.TimeCode.Default())
        return np.eye(4) if found is None else self._bound_from @ matrix_of(found)
