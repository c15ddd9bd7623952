"""Scenes on the GPU as arguments of `FramePicture`, with the same views as for gsplat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.scenes import DATA, garden
from usdsplat import formats
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.kernels.bins import grid_of
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame.groups import FrameGroup, FrameView
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.project import CAMERA, LOW_PASS
from usdsplat.render import spatial_order
from usdsplat.schema import packing

NEAR = 0.01
"""Near plane [scene unit]."""
CLAMP = 1.3
"""Clamp of the affine approximation, as a multiple of half the window, as in gsplat."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """A cloud, and the camera of its measurements."""

    name: str
    cloud: SplatCloud
    matrix: F64
    """World to camera, OpenCV's axes, shape (4, 4)."""
    focal: float
    """Focal length as a multiple of the picture's width."""

    def k(self, width: int, height: int) -> F64:
        """Return the intrinsics [pixel], with the axis in the middle."""
        f = self.focal * width
        return np.array([[f, 0, width / 2], [0, f, height / 2], [0, 0, 1.0]])

    def view(self, width: int, height: int) -> FrameView:
        """Return the same camera for our kernels."""
        f = self.focal * width
        camera = np.zeros(1, CAMERA)
        camera["fx"] = camera["fy"] = f
        camera["cx"], camera["cy"] = width / 2 - 0.5, height / 2 - 0.5
        camera["near"], camera["far"] = NEAR, 1e10
        camera["low_u"], camera["high_u"] = -CLAMP * width / 2 / f, CLAMP * width / 2 / f
        camera["low_v"], camera["high_v"] = -CLAMP * height / 2 / f, CLAMP * height / 2 / f
        camera["right"], camera["bottom"] = width - 1, height - 1
        camera["low_pass"], camera["trained"] = LOW_PASS, np.inf
        matrix = self.matrix.astype(np.float64)
        sights = np.zeros((1, 3, 4))
        sights[0, :, :3] = np.eye(3)
        sights[0, :, 3] = matrix[:3, :3].T @ matrix[:3, 3]
        return FrameView(
            cameras=camera,
            matrices=np.ascontiguousarray(matrix[None, :3]),
            sights=sights,
            conversions=np.zeros((1, 14), np.float32),
            grid=grid_of(0, 0, width, height),
        )


def tiled(grid: int, degree: int) -> Scene:
    """Return the garden, tiled grid x grid times."""
    cloud, matrix, k = garden(grid, degree=degree)
    return Scene(
        name=f"garden {grid}×{grid}", cloud=cloud, matrix=matrix, focal=float(k[0, 0]) / 1920
    )


def captured(name: str) -> Scene:
    """Return a capture with the camera of its first reference picture."""
    stem = name.partition(".")[0]
    oracle = np.load(DATA / "oracle" / "images" / f"{stem}.npz")
    cloud = formats.read(DATA / "splats" / name).cloud
    return Scene(
        name=stem, cloud=cloud, matrix=oracle["viewmats"][0], focal=float(oracle["K"][0, 0]) / 640
    )


def group_of(device: CudaDevice, cloud: SplatCloud, *, packed: bool) -> FrameGroup:
    """Return a cloud on the GPU, as floats or packed, in the order that an engine uses."""
    turns = cloud.rotations / np.linalg.norm(cloud.rotations, axis=1, keepdims=True)
    cloud = replace(cloud, rotations=turns.astype(np.float32))
    small = len(cloud) < spatial_order.LEAST
    laid = spatial_order.as_it_is(cloud) if small else spatial_order.laid_out(CpuDevice(), cloud)
    held: tuple[Any, ...]
    if packed:
        arrays = packing.pack(cloud)
        width = max(1, packing.harmonics_width(arrays.degree))
        words = arrays.core if small else arrays.core[laid.rows]
        steps = (arrays.harmonics_range / np.float32(127)).astype(np.float32)
        harmonics = arrays.harmonics.reshape(-1, 4 * width)
        held = laid.positions, words, harmonics, arrays.color_range.ravel(), steps
    else:
        held = laid.positions, laid.rotations, laid.scales, laid.opacities, cloud.sh
    return FrameGroup(
        splats=tuple(device.keep(array) for array in (*held, laid.rows)),
        is_packed=packed,
        boxes=device.keep(laid.boxes),
        instances=1,
        degree=cloud.sh_degree,
    )
