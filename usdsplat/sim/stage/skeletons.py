"""UsdSkel for the simulation: skinned meshes, joints, and joint influences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.core.errors import StageError
from usdsplat.schema.shapes import mesh_points
from usdsplat.schema.skin import Bound, Skin
from usdsplat.schema.values import value

INSTANCES = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Influences:
    """Joint influences of points."""

    indices: I32
    """Joints of the skeleton, shape (n, k)."""
    weights: F32
    """Rows sum to 1, shape (n, k)."""
    bind: F64
    """`skel:geomBindTransform`: from the prim's space to that of the skeleton's bind pose."""


class Rigs:
    """Skinning of one stage, cached; the stage must not change."""

    def __init__(self) -> None:
        self._cache = UsdSkel.Cache()
        self._bound: dict[Sdf.Path, dict[Sdf.Path, Bound]] = {}

    def skin(self, prim: Usd.Prim) -> tuple[Skin, Usd.Prim] | None:
        """Return the skin of a prim, if it has one, and the prim in whose space the skinned points
        are."""
        found = self._bound_beneath(UsdSkel.Root.Find(prim)).get(prim.GetPath())
        if found is None:
            return None
        skin = Skin(*found)
        return skin, found[0].GetPrim() if skin.has_joints else prim

    def query(self, skeleton: Usd.Prim) -> UsdSkel.SkeletonQuery:
        """Return the query of a skeleton that can be posed.

        Raises:
            StageError: If it has no joints, or not as many transforms as joints.
        """
        where = str(skeleton.GetPath())
        if not skeleton.IsA(UsdSkel.Skeleton):
            raise StageError(where, f"a prim of type {skeleton.GetTypeName()!s}", "a Skeleton")
        self._bound_beneath(UsdSkel.Root.Find(skeleton))
        query = self._cache.GetSkelQuery(UsdSkel.Skeleton(skeleton))
        if not query or not len(query.GetJointOrder()) or not query.HasBindPose():
            raise StageError(where, "no joints with a bind pose", "bindTransforms for its joints")
        return query

    def skinned(self, skeleton: Usd.Prim) -> list[Usd.Prim]:
        """Return the meshes that a skeleton skins, ordered by path."""
        root = UsdSkel.Root.Find(skeleton)
        found = [
            skin.GetPrim()
            for query, skin in self._bound_beneath(root).values()
            if query.GetPrim() == skeleton and skin.HasJointInfluences()
        ]
        return sorted(found, key=lambda prim: prim.GetPath())

    def influences(self, prim: Usd.Prim, skeleton: Usd.Prim, count: int) -> Influences | None:
        """Return the joint influences of a prim's `count` points; None if it has none.

        They are read from primvars alone, so that splat fields can have them, which UsdSkel does
        not skin.

        Raises:
            StageError: If they do not fit the points or the skeleton.
        """
        api = UsdGeom.PrimvarsAPI(prim)
        names = "skel:jointIndices", "skel:jointWeights"
        primvars = [api.FindPrimvarWithInheritance(name) for name in names]
        if not all(primvar and primvar.HasAuthoredValue() for primvar in primvars):
            return None
        start = Usd.TimeCode.Default()
        indices, weights = (np.array(value(each.GetAttr(), start)) for each in primvars)
        rigid = primvars[0].GetInterpolation() == UsdGeom.Tokens.constant
        width = len(indices) if rigid else max(primvars[0].GetElementSize(), 1)
        where = f"{prim.GetPath()}.{primvars[0].GetName()}"
        rows = 1 if rigid else count
        if len(indices) != rows * width or len(weights) != len(indices) or not width:
            found = f"{len(indices)} joints and {len(weights)} weights"
            raise StageError(where, found, f"{width} of both for each of {rows} points")
        indices = self._of_skeleton(where, prim, skeleton, indices.astype(np.int64))
        table = indices.reshape(rows, width).astype(np.int32)
        shares = weights.reshape(rows, width).astype(np.float64)
        total = shares.sum(axis=1, keepdims=True)
        if not np.isfinite(shares).all() or (shares < 0).any() or (total <= 0).any():
            raise StageError(where, "weights that do not add up", "weights with a sum above 0")
        geom = _inherited(prim, UsdSkel.Tokens.primvarsSkelGeomBindTransform)
        return Influences(
            indices=np.ascontiguousarray(np.broadcast_to(table, (count, width))),
            weights=np.ascontiguousarray(np.broadcast_to(shares / total, (count, width)), "f4"),
            bind=np.eye(4) if geom is None else matrix_of(geom),
        )

    def _of_skeleton(self, where: str, prim: Usd.Prim, skeleton: Usd.Prim, indices: I64) -> I64:
        """Map joint indices in the prim's own order to those of the skeleton."""
        order = list(self.query(skeleton).GetJointOrder())
        own = _inherited(prim, UsdSkel.Tokens.skelJoints) or order
        if (indices < 0).any() or (indices >= len(own)).any():
            wrong = indices[(indices < 0) | (indices >= len(own))][0]
            raise StageError(where, f"joint {wrong}", f"0 or more and less than {len(own)}")
        unknown = [name for name in own if name not in order]
        if unknown:
            raise StageError(where, f"the joint {unknown[0]}", f"one of {skeleton.GetPath()}")
        return np.array([order.index(name) for name in own])[indices]

    def _bound_beneath(self, root: UsdSkel.Root) -> dict[Sdf.Path, Bound]:
        """Return everything that is skinned beneath a SkelRoot; nothing without one."""
        if not root:
            return {}
        path = root.GetPath()
        if path not in self._bound:
            self._cache.Populate(root, INSTANCES)
            found = {}
            for binding in self._cache.ComputeSkelBindings(root, INSTANCES):
                skeleton = self._cache.GetSkelQuery(binding.GetSkeleton())
                for skin in binding.GetSkinningTargets():
                    found[skin.GetPrim().GetPath()] = (skeleton, skin)
            self._bound[path] = found
        return self._bound[path]


def matrix_of(matrix: object) -> F64:
    """Return a USD matrix for column vectors."""
    return np.array(matrix, np.float64).T


def joint_transforms(query: UsdSkel.SkeletonQuery, time: Usd.TimeCode) -> F64:
    """Return the joints in the skeleton's space, shape (j, 4, 4)."""
    return _stack(query, query.ComputeJointSkelTransforms(time))


def skinning_transforms(query: UsdSkel.SkeletonQuery, time: Usd.TimeCode) -> F64:
    """Return the matrices from the bind pose to the skeleton's space at a time, shape (j, 4, 4)."""
    return _stack(query, query.ComputeSkinningTransforms(time))


def bind_transforms(query: UsdSkel.SkeletonQuery) -> F64:
    """Return the joints in the space of the bind pose, shape (j, 4, 4)."""
    return _stack(query, query.GetJointWorldBindTransforms())


def radii(rigs: Rigs, skeleton: Usd.Prim, bones: F64, owner: I32) -> F64:
    """Return the median distance of skinned points from the bones of their strongest joint.

    Args:
        rigs: Finds the meshes of the skeleton.
        skeleton: The Skeleton.
        bones: Ends of each bone in the bind pose, shape (b, 2, 3).
        owner: Joint at which each bone starts, shape (b,).

    Returns:
        Shape (j,) for the skeleton's joints. Joints without points get the median of the others;
        without any points all get a tenth of the bones' median length.
    """
    count = len(rigs.query(skeleton).GetJointOrder())
    nearest: list[list[F64]] = [[] for _ in range(count)]
    for prim in rigs.skinned(skeleton):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        points = mesh_points(prim, Usd.TimeCode.Default()).astype(np.float64)
        follows = rigs.influences(prim, skeleton, len(points))
        if follows is None:
            continue
        points = points @ follows.bind[:3, :3].T + follows.bind[:3, 3]
        most = follows.weights.argmax(axis=1)
        joint = follows.indices[np.arange(len(points)), most]
        for number in np.unique(joint):
            mine = bones[owner == number]
            if len(mine):
                own = points[joint == number]
                nearest[number].append(
                    np.min([_distances(own, bone) for bone in mine], axis=0),
                )
    found = np.array([np.median(np.concatenate(each)) if each else np.nan for each in nearest])
    lengths = np.linalg.norm(bones[:, 1] - bones[:, 0], axis=1)
    other = np.nanmedian(found) if np.isfinite(found).any() else 0.1 * np.median(lengths)
    return np.where(np.isfinite(found), found, other)


def _inherited(prim: Usd.Prim, name: str) -> Any:
    """Return the value of an attribute on a prim or the nearest ancestor that has one."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            return value(attribute, Usd.TimeCode.Default())
        prim = prim.GetParent()
    return None


def _distances(points: F64, bone: F64) -> F64:
    """Return the distances of points, shape (n, 3), from a segment, shape (2, 3)."""
    along = bone[1] - bone[0]
    square = float(along @ along)
    t = np.clip((points - bone[0]) @ along / square, 0, 1) if square else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - bone[0] - t[:, None] * along, axis=1))


def _stack(query: UsdSkel.SkeletonQuery, found: object) -> F64:
    """Return USD matrices for column vectors."""
    joints = len(query.GetJointOrder())
    array = np.array(found, np.float64).reshape(-1, 4, 4)
    if len(array) != joints:
        where = str(query.GetPrim().GetPath())
        raise StageError(where, f"{len(array)} transforms", f"one for each of {joints} joints")
    if not np.isfinite(array).all():
        where = str(query.GetPrim().GetPath())
        raise StageError(where, "joints that are nowhere", "transforms that are finite")
    return array.transpose(0, 2, 1)
