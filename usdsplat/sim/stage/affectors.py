"""Read affectors: prims with SplatAffectorAPI, as solid bodies in the simulation's space.

Spheres, cubes and capsules with a non-uniform scale become triangles. The kind of a body is decided
once, from all samples of its transform, because it cannot change.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.schema.values import value
from usdsplat.sim.parameters import NAMESPACE, AffectorParameters
from usdsplat.sim.specs import Affector, Solid, Surface
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.bones import Bones
from usdsplat.sim.stage.parameters import read
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space
from usdsplat.sim.stage.targets import Triangles, facing_outwards, unchanged_or

ROUND = ("Sphere", "Capsule", "Capsule_1", "Cube")
TYPES = (*ROUND, "Plane", "Mesh", "Skeleton")
_STEADY = 1e-6
"""Relative change of a stretch that counts as none."""


class AffectorReader:
    """Reader of one affector at any time.

    Args:
        prim: The affector.
        space: The simulation's space.
        rigs: Skinning of the stage.

    Raises:
        StageError: If the prim cannot be an affector, or a value is out of range.
    """

    def __init__(self, prim: Usd.Prim, space: Space, rigs: Rigs) -> None:
        self.prim, self._space = prim, space
        kind = str(prim.GetTypeName())
        if prim.IsA(UsdGeom.Mesh):
            kind = "Mesh"
        elif prim.IsA(UsdSkel.Skeleton):
            kind = "Skeleton"
        if kind not in TYPES:
            found = f"an affector of type {kind}" if kind else "an affector without a type"
            raise StageError(str(prim.GetPath()), found, f"one of {', '.join(TYPES)}")
        self._kind = kind
        self._bones: Bones | None = None
        self._mesh: MeshBody | None = None
        if kind == "Skeleton":
            self._bones = Bones(prim, space, rigs, self.parameters(space.start))
        elif kind == "Mesh" or (kind in ROUND and not self._is_even()):
            self._mesh = MeshBody(prim, space, rigs)

    def parameters(self, time: Usd.TimeCode) -> AffectorParameters:
        """Return the parameters at a time."""
        return read(self.prim, AffectorParameters, f"{NAMESPACE}:affector", time)

    def at(self, time: Usd.TimeCode) -> Affector:
        """Return the affector at a time.

        Raises:
            StageError: If a value is out of range.
        """
        asked = self.parameters(time)
        if self._bones:
            solids = self._bones.at(time, asked)
        elif self._mesh:
            solids = (self._mesh.at(time, asked.radius_scale),)
        else:
            solids = (self._primitive(time, asked.radius_scale),)
        return Affector(path=str(self.prim.GetPath()), parameters=asked, solids=solids)

    def _is_even(self) -> bool:
        """Return whether the scale is uniform at all samples of the prim's transform."""
        codes = _codes(self._space.times(self.prim), self._space.start)
        return all(spaces.is_uniform(self._space.from_prim(self.prim, code)) for code in codes)

    def _primitive(self, time: Usd.TimeCode, larger: float) -> Solid:
        """Return a sphere, capsule, box or plane."""
        matrix = self._space.from_prim(self.prim, time)
        if self._kind == "Plane":
            return Solid(kind="plane", matrix=_plane(matrix, self._turn(time)))
        rotation, _ = spaces.rotation_and_stretch(matrix)
        at, scale = matrix[:3, 3], spaces.size_of(matrix) * larger
        if self._kind == "Sphere":
            size = (self._size("radius", time) * scale, 0.0, 0.0)
            return Solid(kind="sphere", matrix=spaces.rigid(rotation, at), size=size)
        if self._kind == "Cube":
            half = self._size("size", time) * scale / 2
            return Solid(kind="box", matrix=spaces.rigid(rotation, at), size=(half, half, half))
        names = ("radiusBottom", "radiusTop") if self._kind == "Capsule_1" else ("radius",) * 2
        low, high = (self._size(name, time) * scale for name in names)
        # `rotation` lacks the reflection of x of a mirroring matrix; without it, the ends of a
        # capsule along x would be swapped
        turn = self._turn(time)
        if np.linalg.det(matrix[:3, :3]) < 0:
            rotation = rotation @ np.diag([-1.0, 1.0, 1.0]) @ turn @ np.diag([-1.0, 1.0, 1.0])
        else:
            rotation = rotation @ turn
        half = self._size("height", time) * scale / 2
        return Solid(kind="capsule", matrix=spaces.rigid(rotation, at), size=(low, high, half))

    def _turn(self, time: Usd.TimeCode) -> F64:
        """Return the rotation from z to the prim's axis, (3, 3)."""
        found = str(value(self.prim.GetAttribute("axis"), time))
        if found not in ("X", "Y", "Z"):
            raise StageError(f"{self.prim.GetPath()}.axis", repr(found), "X, Y or Z")
        return np.roll(np.eye(3), "XYZ".index(found) + 1, axis=0)

    def _size(self, name: str, time: Usd.TimeCode) -> float:
        """Return a length attribute of the prim."""
        found = value(self.prim.GetAttribute(name), time)
        if not isinstance(found, (int, float)) or not 0 <= found < np.inf:
            raise StageError(f"{self.prim.GetPath()}.{name}", repr(found), "0 or more")
        return float(found)


class MeshBody:
    """A solid of triangles: rigid, in a moving frame, or deformed, in the simulation's space.

    Args:
        prim: A Mesh, or a shape with a non-uniform scale.
        space: The simulation's space.
        rigs: Skinning of the stage.
    """

    def __init__(self, prim: Usd.Prim, space: Space, rigs: Rigs) -> None:
        self._space = space
        self._triangles = Triangles(prim, rigs)
        placer = self._triangles.placer
        larger = prim.GetAttribute(f"{NAMESPACE}:affector:radiusScale")
        self._rigid = not self._triangles.varies and not (
            larger and larger.ValueMightBeTimeVarying()
        )
        stretches = [
            spaces.rotation_and_stretch(space.from_prim(placer, code))[1]
            for code in _codes(space.times(placer), space.start)
        ]
        self._stretch = stretches[0]
        size = np.abs(self._stretch).max()
        self._rigid &= all(
            np.abs(each - self._stretch).max() <= _STEADY * size for each in stretches
        )
        self._last: Surface | None = None

    def at(self, time: Usd.TimeCode, larger: float) -> Solid:
        """Return the body at a time, scaled about its prim's origin."""
        points, triangles = self._triangles.at(time)
        matrix = self._space.from_prim(self._triangles.placer, time)
        about = np.eye(4)
        about[:3, :3] *= larger
        inner = about @ spaces.rigid(self._stretch, np.zeros(3)) if self._rigid else matrix @ about
        made = Surface(
            points=spaces.transform_points(inner, points),
            triangles=facing_outwards(triangles, inner),
        )
        self._last = unchanged_or(self._last, made)
        outer = np.eye(4)
        if self._rigid:
            outer = spaces.rigid(spaces.rotation_and_stretch(matrix)[0], matrix[:3, 3])
        return Solid(kind="mesh", matrix=outer, surface=self._last, is_rigid=self._rigid)


def _plane(matrix: F64, turn: F64) -> F64:
    """Return the frame of a half-space, z its normal, after the prim's transform.

    Normals transform by the inverse transpose, so that a sheared plane remains a plane.
    """
    linear = matrix[:3, :3]
    if not abs(np.linalg.det(linear)) > 0:
        return spaces.rigid(turn, matrix[:3, 3])
    z = np.linalg.solve(linear.T, turn[:, 2])
    z /= np.linalg.norm(z)
    x = linear @ turn[:, 0]
    x -= z * (x @ z)
    x /= np.linalg.norm(x)
    return spaces.rigid(np.stack([x, np.cross(z, x), z], axis=1), matrix[:3, 3])


def _codes(times: Iterable[float], start: Usd.TimeCode) -> list[Usd.TimeCode]:
    """Return the time codes of a transform to examine: its samples, and the start."""
    return [start, *(Usd.TimeCode(time) for time in times)]
