"""Skinning: splats follow a skeleton by joint weights of their own, of a mesh, or by mesh
triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F32, F64, I32
from usdsplat.core.errors import StageError
from usdsplat.core.progress import phase
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.skin import (
    DUAL,
    blend_dual,
    blend_linear,
    follow_triangles,
    gather_weights,
)
from usdsplat.sim.closest import Triangles
from usdsplat.sim.parameters import SkinParameters
from usdsplat.sim.specs import SkinBinding, SkinPose, Surface

STRONGEST = 8
"""Maximum number of joints of a splat that takes them from a mesh; the strongest are kept."""

NO_GRADIENT: F32 = np.zeros((0, 3, 3), np.float32)


class Skin:
    """Skin binding of each splat; changes only with births and deaths.

    Args:
        device: Runs the kernels.
        binding: Binding of the capture's splats.
        rest: Captured positions [unit], shape (n, 3).
        parameters: `binding` selects joint weights or triangles of a mesh.

    Raises:
        StageError: If weights do not fit the splats or the mesh, or there is nothing to follow.
    """

    def __init__(
        self, device: Device, binding: SkinBinding, rest: F32, parameters: SkinParameters
    ) -> None:
        self._device = device
        self._binding = binding
        self._by_triangles = binding.surface is not None and parameters.binding == "triangles"
        self._joints: I32
        self._weights: F32
        if binding.surface is not None:
            turn, shift = binding.bind[:3, :3], binding.bind[:3, 3]
            bound = (rest.astype(np.float64) @ turn.T + shift).astype(np.float32)
            with phase("binding to the mesh", work=len(rest)):
                hits = Triangles(device, binding.surface).closest(bound)
            self._joints, self._weights = hits.faces, hits.weights
            if not self._by_triangles:
                self._take_weights(binding.surface)
        elif binding.indices is None or binding.weights is None:
            raise StageError("skin", "neither joint weights nor a mesh", "one of them")
        else:
            _check_influences(binding.indices, binding.weights, len(rest), "splats")
            self._joints = np.ascontiguousarray(binding.indices)
            total = binding.weights.sum(axis=1, keepdims=True, dtype=np.float64)
            with np.errstate(divide="ignore", invalid="ignore"):
                normal = np.where(total > 0, binding.weights / total, 0)
            self._weights = normal.astype(np.float32)

    def _take_weights(self, surface: Surface) -> None:
        indices, weights = self._binding.surface_indices, self._binding.surface_weights
        if indices is None or weights is None:
            raise StageError("skin", "a mesh without joint weights", "one that is bound to joints")
        _check_influences(indices, weights, len(surface.points), "points")
        n, kept = len(self._joints), min(STRONGEST, 3 * indices.shape[1])
        joints, shares = np.empty((n, kept), np.int32), np.empty((n, kept), np.float32)
        self._device.run(
            gather_weights, self._joints, self._weights, surface.triangles, indices, weights,
            joints, shares,
        )  # fmt: skip
        self._joints, self._weights = joints, shares

    def __len__(self) -> int:
        return len(self._joints)

    def extended(self, parents: npt.NDArray[np.integer[Any]]) -> Skin:
        """Return a copy with children appended, bound like their parents.

        Args:
            parents: Rows of the parents, shape (c,).
        """
        return self.selected(np.concatenate([np.arange(len(self)), parents]))

    def selected(self, rows: npt.NDArray[np.integer[Any]]) -> Skin:
        """Return a copy with these rows only, in this order; rows may repeat."""
        other = object.__new__(Skin)
        other._device, other._binding = self._device, self._binding
        other._by_triangles = self._by_triangles
        other._joints, other._weights = self._joints[rows], self._weights[rows]
        return other

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return what is kept for each splat, first axis n."""
        return {"joints": self._joints, "weights": self._weights}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `memory`, for any number of splats."""
        self._joints, self._weights = memory["joints"], memory["weights"]

    def apply(
        self,
        pose: SkinPose,
        parameters: SkinParameters,
        positions: F32,
        gradient: F32 | None = None,
        factor: F32 | None = None,
    ) -> None:
        """Move splats with the pose of the skeleton.

        Args:
            pose: The skeleton now.
            parameters: Parameters now; `binding` must be that of the beginning.
            positions: [unit], shape (n, 3), changed in place.
            gradient: Gradient of the deformation so far, shape (n, 3, 3), multiplied in place.
            factor: Factor of the weight of each splat, shape (n,).

        Raises:
            StageError: If the pose lacks a joint, or the mesh that splats follow.
        """
        slopes = NO_GRADIENT if gradient is None else gradient
        amounts = np.array([parameters.weight])
        if factor is not None:
            amounts = parameters.weight * factor.astype(np.float64)
        common = positions, slopes, self._joints, self._weights, amounts
        if self._by_triangles:
            self._follow(pose, common)
            return
        most = int(self._joints.max(initial=-1))
        if most >= len(pose.joints):
            raise StageError("skin", f"joint {most}", f"0 to {len(pose.joints) - 1}")
        moves = pose.joints @ self._binding.bind
        if parameters.method == "linear":
            rows = np.ascontiguousarray(moves[:, :3]).reshape(-1, 12)
            self._device.run(blend_linear, *common, rows)
        else:
            self._device.run(blend_dual, *common, dual_quaternions(moves))

    def _follow(self, pose: SkinPose, common: tuple[Any, ...]) -> None:
        before, after = self._binding.surface, pose.surface
        assert before is not None
        if after is None or after.points.shape != before.points.shape:
            raise StageError("skin", "no mesh, or one with other points", "the mesh that was bound")
        bind = np.ascontiguousarray(self._binding.bind[:3], np.float64).reshape(12)
        meshes = before.triangles, before.points, after.points
        self._device.run(follow_triangles, *common, *meshes, bind)


def dual_quaternions(moves: F64) -> F64:
    """Return rotation, dual part and stretch of each matrix, as `blend_dual` reads them.

    Args:
        moves: Affine matrices, shape (j, 4, 4).

    Returns:
        Shape (j, 17). A reflection is part of the stretch, so that the rest is a rotation.
    """
    left, _, right = np.linalg.svd(moves[:, :3, :3])
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = left @ right
    real = quaternion.from_matrix(turn)
    shift = np.concatenate([np.zeros((len(moves), 1)), moves[:, :3, 3]], axis=1)
    out = np.empty((len(moves), DUAL))
    out[:, :4] = real
    out[:, 4:8] = 0.5 * quaternion.multiply(shift, real)
    out[:, 8:] = (turn.swapaxes(1, 2) @ moves[:, :3, :3]).reshape(-1, 9)
    return out


def _check_influences(indices: I32, weights: F32, count: int, of: str) -> None:
    if indices.shape != weights.shape or indices.ndim != 2 or len(indices) != count:
        found = f"joint indices {indices.shape} and weights {weights.shape}"
        raise StageError("skin", found, f"both ({count}, k) for {count} {of}")
    if indices.size and indices.min() < 0:
        raise StageError("skin", f"joint {indices.min()}", "0 or more")
