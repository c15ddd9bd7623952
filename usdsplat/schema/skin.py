"""Skin mesh points and normals with UsdSkel.

Source: the UsdSkel documentation, "Schemas" and "API Introduction". Blend shapes move points in the
mesh's own space. Joints transform them into the skeleton's space, so the transform of a mesh with
joints is ignored.
"""

from __future__ import annotations

import numpy as np
from pxr import Gf, Usd, UsdSkel, Vt

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError

Bound = tuple[UsdSkel.SkeletonQuery, UsdSkel.SkinningQuery]


class Skin:
    """A mesh bound to a skeleton."""

    def __init__(self, skeleton: UsdSkel.SkeletonQuery, skin: UsdSkel.SkinningQuery) -> None:
        self._skeleton = skeleton
        self._skin = skin
        self._where = str(skin.GetPrim().GetPath())

    @property
    def has_joints(self) -> bool:
        """Whether joints move the mesh, not only blend shapes."""
        return bool(self._skin.HasJointInfluences())

    def points(self, points: F32, time: Usd.TimeCode) -> F32:
        """Return the moved points, shape (n, 3): in the skeleton's space if joints move them.

        Raises:
            StageError: If influences or blend shapes do not match the points.
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
        """Return normals after blend shapes and joints, shape (n, 3), not normalised.

        Args:
            normals: Normals, shape (n, 3).
            at: Index of the point of each normal, shape (n,).
            count: Number of points.
            time: Time code.

        Raises:
            StageError: If influences do not match the points.
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
        """Return the weight of each of the prim's blend shapes."""
        weights = self._skeleton.GetAnimQuery().ComputeBlendShapeWeights(time)
        mapper = self._skin.GetBlendShapeMapper()
        return mapper.Remap(weights) if mapper and weights else weights

    def _blend(self, points: Vt.Vec3fArray, time: Usd.TimeCode) -> None:
        """Apply the blend shapes to points, in place."""
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
        """Return normals with the offsets of blend shapes and in-betweens added."""
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
    """Return the normal matrix of `matrix`; its linear part unchanged if that is singular."""
    upper = matrix.ExtractRotationMatrix()
    return upper.GetInverse().GetTranspose() if upper.GetDeterminant() else upper


_MISFIT = ("joints or blend shapes that do not fit its points", "some that do")
