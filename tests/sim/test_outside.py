"""Tests that normals turn to the outer side. Oracles: a sphere in a sphere, and a floor."""

from __future__ import annotations

import numpy as np

from tests.sim.recipes import ball
from usdsplat.core.cloud import SplatCloud
from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import Carriers

DEVICE = open_device(threads=1)


def joined(*clouds: SplatCloud) -> SplatCloud:
    """All splats of some clouds."""
    return SplatCloud(
        **{
            name: np.concatenate([getattr(each, name) for each in clouds])
            for name in ("positions", "scales", "rotations", "opacities", "sh")
        }
    )


def scaled(cloud: SplatCloud, factor: float) -> SplatCloud:
    """A cloud of another size."""
    return SplatCloud(
        positions=cloud.positions * np.float32(factor), scales=cloud.scales * np.float32(factor),
        rotations=cloud.rotations, opacities=cloud.opacities, sh=cloud.sh,
    )  # fmt: skip


def test_what_is_inside_is_known() -> None:
    """Oracle: a ball in a ball: the inner one gets no light, and normals of the outer one point
    away from the centre."""
    both = joined(ball(3000), scaled(ball(800), 0.45))
    found = Carriers.of(DEVICE, both, distance=0.08, seed=1)
    radius = np.linalg.norm(found.positions, axis=1)
    assert found.outer[radius > 0.8].mean() > 0.99
    assert not found.outer[radius < 0.6].any()
    outward = (found.positions * found.normals).sum(axis=1)[radius > 0.8]
    assert (outward > 0).mean() > 0.99


def test_a_floor_faces_the_sky() -> None:
    """Oracle: the sign of the normals of a flat sheet, for both directions of up."""
    x, z = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40))
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1).astype(np.float32)
    n = len(points)
    floor = SplatCloud(
        positions=points,
        scales=np.tile(np.float32([0.03, 0.002, 0.03]), (n, 1)),
        rotations=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacities=np.full(n, 0.95, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )
    for sign in (1.0, -1.0):
        found = Carriers.of(DEVICE, floor, distance=0.06, up=(0.0, sign, 0.0))
        assert (sign * found.normals[:, 1] > 0).mean() > 0.95
        assert found.outer.all()
