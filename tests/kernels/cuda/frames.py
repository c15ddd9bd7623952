"""Checks of pictures from CUDA kernels, for tests on a GPU and on the simulator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels import blocks, reference
from usdsplat.kernels.bins import grid_of
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame import picture
from usdsplat.kernels.cuda.frame.groups import FrameGroup, FrameView
from usdsplat.kernels.cuda.frame.picture import FramePicture
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.project import BLOCK, CAMERA, LOW_PASS
from usdsplat.schema import packing

SIZE = (40, 24)
NO_ROWS = np.empty(0, np.int32)
FOCAL = 30.0


def cloud_of(n: int, degree: int = 0, *, seed: int = 0, spread: float = 1.0) -> SplatCloud:
    """Splats before the camera, large and small, some beyond the edges."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(n, 4))
    places = rng.uniform([-spread, -spread, 2], [spread, spread, 5], (n, 3))
    return SplatCloud(
        positions=places.astype(np.float32),
        scales=np.exp(rng.uniform(-5, -1, (n, 3))).astype(np.float32),
        rotations=(turns / np.linalg.norm(turns, axis=1, keepdims=True)).astype(np.float32),
        opacities=rng.uniform(0.002, 1, n).astype(np.float32),
        sh=rng.normal(0, 0.4, (n, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def group_of(device: CudaDevice, cloud: SplatCloud, **changes: Any) -> FrameGroup:
    """A cloud as floats, all of its blocks looked at."""
    arrays = cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh, NO_ROWS
    group = FrameGroup(
        splats=tuple(device.keep(array) for array in arrays),
        is_packed=False,
        boxes=device.keep(np.empty((0, blocks.BOX), np.float32)),
        instances=1,
        degree=cloud.sh_degree,
    )
    return replace(group, **changes)


def view_of(matrices: Any = None, size: tuple[int, int] = SIZE) -> FrameView:
    """A camera at the origin that looks along z; instances by their local-to-camera matrices."""
    matrices = np.eye(4)[None] if matrices is None else np.asarray(matrices)
    camera = np.zeros(1, CAMERA)
    camera["fx"] = camera["fy"] = FOCAL
    camera["cx"], camera["cy"] = size[0] / 2 - 0.5, size[1] / 2 - 0.5
    camera["near"], camera["far"], camera["low_pass"] = 0.01, 1e10, LOW_PASS
    camera["trained"] = np.inf
    for axis, length in (("u", size[0]), ("v", size[1])):
        camera[f"high_{axis}"] = 1.3 * length / 2 / FOCAL
        camera[f"low_{axis}"] = -1.3 * length / 2 / FOCAL
    camera["right"], camera["bottom"] = size[0] - 1, size[1] - 1
    sights = np.zeros((len(matrices), 3, 4))
    sights[:, :, :3] = np.eye(3)
    sights[:, :, 3] = (matrices[:, :3, :3].transpose(0, 2, 1) @ matrices[:, :3, 3:])[..., 0]
    return FrameView(
        cameras=camera,
        matrices=np.ascontiguousarray(matrices[:, :3].astype(np.float64)),
        sights=sights,
        conversions=np.zeros((1, 14), np.float32),
        grid=grid_of(0, 0, *size),
    )


def expected(pairs: Any, size: tuple[int, int] = SIZE) -> Any:
    """The picture in float64; pairs of a cloud and its local-to-world matrix."""
    lens = reference.Lens(
        world_to_camera=np.eye(4), focal=(FOCAL, FOCAL), center=(size[0] / 2, size[1] / 2),
        size=size,
    )  # fmt: skip
    return reference.render(list(pairs), lens).color


def check_floats(device: CudaDevice, n: int, degree: int) -> None:
    cloud = cloud_of(n, degree)
    found = device.fetch(FramePicture(device).draw([group_of(device, cloud)], view_of()))
    np.testing.assert_allclose(found, expected([(cloud, np.eye(4))]), atol=2e-4)


def check_variants(device: CudaDevice, n: int) -> None:
    """Each of the kernels that blend, whatever is fastest."""
    cloud = cloud_of(n, seed=3)
    wanted = expected([(cloud, np.eye(4))])
    chosen = picture.blend.variant
    try:
        for each in ((1, False), (2, True), (4, True)):
            picture.blend.variant = lambda *_, each=each: each
            found = device.fetch(FramePicture(device).draw([group_of(device, cloud)], view_of()))
            np.testing.assert_allclose(found, wanted, atol=2e-4)
    finally:
        picture.blend.variant = chosen


def check_packed(device: CudaDevice, n: int, degree: int) -> None:
    cloud = cloud_of(n, degree, seed=1)
    arrays = packing.pack(cloud)
    plain = packing.unpack(cloud.positions, arrays)
    width = max(1, packing.harmonics_width(degree))
    words = arrays.harmonics.reshape(-1, 4 * width)
    steps = (arrays.harmonics_range / np.float32(127)).astype(np.float32)
    held = (cloud.positions, arrays.core, words, arrays.color_range.ravel(), steps, NO_ROWS)
    packed = group_of(
        device, cloud, splats=tuple(device.keep(each) for each in held), is_packed=True
    )
    found = device.fetch(FramePicture(device).draw([packed], view_of()))
    wanted = device.fetch(FramePicture(device).draw([group_of(device, plain)], view_of()))
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    assert wanted[..., 3].max() > 0.5


def check_instances_and_fields(device: CudaDevice, n: int) -> None:
    clouds = cloud_of(n, 1, seed=4), cloud_of(n // 2, 0, seed=5)
    shifts = np.tile(np.eye(4), (3, 1, 1))
    shifts[1, :3, 3] = 0.3, -0.2, 0.5
    shifts[2, :3, 3] = -0.4, 0.1, 1.0
    groups = [group_of(device, clouds[0], instances=2), group_of(device, clouds[1])]
    view = view_of(shifts)
    view = replace(view, cameras=np.repeat(view.cameras, 2), conversions=np.zeros((2, 14), "f4"))
    found = device.fetch(FramePicture(device).draw(groups, view))
    parts = [(clouds[0], shifts[0]), (clouds[0], shifts[1]), (clouds[1], shifts[2])]
    np.testing.assert_allclose(found, expected(parts), atol=2e-4)


def check_boxes_leave_nothing_out(device: CudaDevice, n: int) -> None:
    """Splats all around the camera, in an order that makes their blocks compact."""
    cloud = cloud_of(n, seed=6, spread=6.0)
    order = np.argsort(cloud.positions[:, 0])
    cloud = SplatCloud(
        **{
            name: np.ascontiguousarray(getattr(cloud, name)[order])
            for name in ("positions", "scales", "rotations", "opacities", "sh")
        }
    )
    bounds = np.empty((-(-n // BLOCK), blocks.BOX), np.float32)
    CpuDevice().run(blocks.boxes, cloud.positions, cloud.scales, cloud.opacities, bounds)
    one, other = FramePicture(device), FramePicture(device)
    plain = device.fetch(one.draw([group_of(device, cloud)], view_of()))
    boxed = device.fetch(
        other.draw([group_of(device, cloud, boxes=device.keep(bounds))], view_of())
    )
    np.testing.assert_array_equal(boxed, plain)
    assert one.visible == other.visible > 0


def check_room_grows(device: CudaDevice, n: int) -> None:
    """From almost nothing seen to all, and back."""
    cloud = cloud_of(n, seed=7)
    away = np.eye(4)
    away[:3, 3] = 0, 0, -100
    drawn, group = FramePicture(device), group_of(device, cloud)
    first = device.fetch(drawn.draw([group], view_of())).copy()
    assert not device.fetch(drawn.draw([group], view_of(away[None]))).any()
    np.testing.assert_array_equal(device.fetch(drawn.draw([group], view_of())), first)
    np.testing.assert_array_equal(device.fetch(drawn.draw([group], view_of())), first)


def check_ties_are_settled(device: CudaDevice, n: int, *, flat: bool = False) -> None:
    """Splats of few depths, or of one, in memory in another order than in their field."""
    cloud = cloud_of(n, 1, seed=8)
    cloud.positions[:, 2] = 0.0 if flat else np.round(cloud.positions[:, 2])
    rows = np.random.default_rng(9).permutation(n).astype(np.int32)
    laid = [getattr(cloud, name)[rows] for name in ("positions", "rotations", "scales")]
    arrays = (*laid, cloud.opacities[rows], cloud.sh, rows)
    moved = group_of(device, cloud, splats=tuple(device.keep(each) for each in arrays))
    found = device.fetch(FramePicture(device).draw([moved], view_of()))
    plain = device.fetch(FramePicture(device).draw([group_of(device, cloud)], view_of()))
    np.testing.assert_array_equal(found, plain)
