"""UsdSkel: which meshes a skeleton moves, and where it moves their points.

Source: the UsdSkel documentation, "Schemas" and "API Introduction". Blend shapes move points in the
mesh's own space; joints carry them into the skeleton's, so a mesh with joints stands where its
skeleton does and its own transform does not count.
"""

from __future__ import annotations

import numpy as np
from pxr import Gf, Sdf, Usd, UsdSkel, Vt

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.readings import Sources

INSTANCES = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)

Bound = tuple[UsdSkel.SkeletonQuery, UsdSkel.SkinningQuery]


class Skeletons:
    """What UsdSkel knows of one stage; to be cleared after any edit."""

    def __init__(self) -> None:
        self._cache = UsdSkel.Cache()
        self._bound: dict[Sdf.Path, dict[Sdf.Path, Bound]] = {}

    def clear(self) -> None:
        """Forget everything."""
        self._cache.Clear()
        self._bound.clear()

    def skin(self, prim: Usd.Prim, sources: Sources) -> Skin | None:
        """The skin that `prim` is, if it is one; notes all that moves its points."""
        skeleton = _inherited(prim, UsdSkel.Tokens.skelSkeleton, sources)
        if skeleton:
            _note(skeleton, sources)
            if animation := _inherited(skeleton, UsdSkel.Tokens.skelAnimationSource, sources):
                sources.add(animation)
        sources.targets(prim, UsdSkel.Tokens.skelBlendShapeTargets)
        return self._find(prim)

    def frame(self, prim: Usd.Prim, sources: Sources) -> Usd.Prim:
        """The prim that places `prim`, and noted: its skeleton if joints carry it, else itself."""
        skeleton = _inherited(prim, UsdSkel.Tokens.skelSkeleton, sources)
        skin = self._find(prim)
        if skeleton is None or skin is None or not skin.has_joints:
            return prim
        sources.place(skeleton)
        return skeleton

    def _find(self, prim: Usd.Prim) -> Skin | None:
        root = UsdSkel.Root.Find(prim)
        found = self._in(root).get(prim.GetPath()) if root else None
        return Skin(*found) if found else None

    def _in(self, root: UsdSkel.Root) -> dict[Sdf.Path, Bound]:
        """All that is skinned beneath a SkelRoot."""
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


class Skin:
    """One mesh and the skeleton that moves it."""

    def __init__(self, skeleton: UsdSkel.SkeletonQuery, skin: UsdSkel.SkinningQuery) -> None:
        self._skeleton = skeleton
        self._skin = skin
        self._where = str(skin.GetPrim().GetPath())

    @property
    def has_joints(self) -> bool:
        """Whether joints carry the mesh, not only blend shapes."""
        return bool(self._skin.HasJointInfluences())

    def points(self, points: F32, time: Usd.TimeCode) -> F32:
        """Where the points are, shape (n, 3): in the skeleton's space if joints carry them.

        Raises:
            StageError: If influences or shapes do not fit the points.
        """
        moved = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points))
        if self._skin.HasBlendShapes() and self._skeleton.GetAnimQuery():
            self._blend(moved, time)
        if self.has_joints:
            joints = self._skeleton.ComputeSkinningTransforms(time)
            if not joints or not self._skin.ComputeSkinnedPoints(joints, moved, time):
                raise StageError(self._where, *_MISFIT)
        return np.array(moved, np.float32).reshape(-1, 3)

    def normals(self, normals: F32, at: I32, count: int, time: Usd.TimeCode) -> F32:
        """Normals as shapes and joints turn them, shape (n, 3), not of unit length.

        Args:
            normals: Shape (n, 3).
            at: The point that each of them is at, shape (n,).
            count: How many points there are.
            time: When.

        Raises:
            StageError: If influences do not fit the points.
        """
        if self._skin.HasBlendShapes() and self._skeleton.GetAnimQuery() and count == len(normals):
            normals = self._blended_normals(normals, time)
        if not self.has_joints:
            return normals
        joints = self._skeleton.ComputeSkinningTransforms(time)
        if joints and self._skin.IsRigidlyDeformed():
            rigid = _normal_matrix(self._skin.ComputeSkinnedTransform(joints, time))
            return (normals @ np.array(rigid, np.float64)).astype(np.float32)
        found = self._skin.ComputeVaryingJointInfluences(count)
        if not joints or not found:
            raise StageError(self._where, *_MISFIT)
        if order := self._skin.GetJointOrder():
            known = dict(zip(self._skeleton.GetJointOrder(), joints, strict=True))
            joints = [known.get(name, Gf.Matrix4d(1.0)) for name in order]
        width = self._skin.GetNumInfluencesPerComponent()
        indices, weights = (np.asarray(each).reshape(count, width)[at].ravel() for each in found)
        turned = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(normals))
        if not UsdSkel.SkinNormals(
            self._skin.GetSkinningMethod(),
            _normal_matrix(self._skin.GetGeomBindTransform(time)),
            Vt.Matrix3dArray([_normal_matrix(joint) for joint in joints]),
            Vt.IntArray.FromNumpy(indices),
            Vt.FloatArray.FromNumpy(weights),
            width,
            turned,
        ):
            raise StageError(self._where, *_MISFIT)
        return np.array(turned, np.float32).reshape(-1, 3)

    def _weights(self, time: Usd.TimeCode) -> Vt.FloatArray | None:
        """The weight of each of the prim's own blend shapes."""
        weights = self._skeleton.GetAnimQuery().ComputeBlendShapeWeights(time)
        mapper = self._skin.GetBlendShapeMapper()
        return mapper.Remap(weights) if mapper and weights else weights

    def _blend(self, points: Vt.Vec3fArray, time: Usd.TimeCode) -> None:
        """Move the points by the shapes."""
        weights = self._weights(time)
        if not weights:
            return
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self._skin.GetPrim()))
        found = shapes.ComputeSubShapeWeights(weights)
        offsets = shapes.ComputeSubShapePointOffsets()
        indices = shapes.ComputeBlendShapePointIndices()
        if not found or not shapes.ComputeDeformedPoints(*found, indices, offsets, points):
            raise StageError(self._where, *_MISFIT)

    def _blended_normals(self, normals: F32, time: Usd.TimeCode) -> F32:
        """Normals with the shapes' offsets added, in-betweens too."""
        weights = self._weights(time)
        if not weights:
            return normals
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self._skin.GetPrim()))
        every = shapes.ComputeBlendShapePointIndices()
        moved = normals.copy()
        for weight, shape, part in zip(*shapes.ComputeSubShapeWeights(weights), strict=True):
            between = shapes.GetInbetween(part)
            whole = shapes.GetBlendShape(shape).GetNormalOffsetsAttr().Get()
            offsets = np.array((between.GetNormalOffsets() if between else whole) or (), np.float32)
            rows = np.array(every[shape] or range(len(offsets)), np.int64)
            if len(offsets) == len(rows) and (rows < len(moved)).all():
                np.add.at(moved, rows, np.float32(weight) * offsets.reshape(-1, 3))
        return moved


def _normal_matrix(matrix: Gf.Matrix4d) -> Gf.Matrix3d:
    """What turns normals where `matrix` moves points; nothing where that squashes them flat."""
    upper = matrix.ExtractRotationMatrix()
    return upper.GetInverse().GetTranspose() if upper.GetDeterminant() else upper


_MISFIT = ("joints or blend shapes that do not fit its points", "some that do")


def _inherited(prim: Usd.Prim, name: str, sources: Sources) -> Usd.Prim | None:
    """The target of a relationship of the prim, or of the nearest above it that has one."""
    while prim and not prim.IsPseudoRoot():
        relationship = prim.GetRelationship(name)
        if relationship and relationship.HasAuthoredTargets():
            targets = sources.targets(prim, name)
            found = sources.follow(targets[0]) if targets else None
            return found if found else None
        prim = prim.GetParent()
    return None


def _note(prim: Usd.Prim, sources: Sources) -> None:
    """Whatever is said on a prim, or inherited by it, counts."""
    while prim and not prim.IsPseudoRoot():
        sources.add(prim)
        prim = prim.GetParent()
