"""Tests of a few frames of a simulation on the simulated GPU: resident and fetched arrays."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.affectors import affector, placed
from tests.sim.recipes import Written, ball, knobs
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.parameters import NeighborsParameters
from usdsplat.sim.solver import Solver
from usdsplat.sim.state import State
from usdsplat.sim.uses import uses_over

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # kernels may overflow
FRAMES = 2


def simulated(device: Device) -> State:
    """The state after some frames of a pattern that grows while a capsule goes through."""

    def says(time: float) -> dict[str, object]:
        capsule = affector("capsule", (0.3, 0.3, 0.5), placed((0.9 - 0.2 * time, 0, 0)), blend=0.1)
        return {
            "parameters": knobs(
                rd={"enabled": True, "domain": "self", "substeps": 2}, growth={"rate": 0.5}
            ),
            "affectors": (capsule,),
        }

    recipe = Written(ball(40), says)
    uses = uses_over(recipe, [float(t) for t in range(FRAMES + 1)])
    solver = Solver(recipe, uses, device=device, start=0.0)
    for _ in range(FRAMES):
        solver.advance()
    return solver.state


def test_frames_are_those_of_the_cpu() -> None:
    """Oracle: the CPU's loops."""
    found, wanted = simulated(CudaDevice()), simulated(CpuDevice())
    assert (wanted.positions != ball(40).positions).any()
    for (name, a), (_, b) in zip(found.per_splat(), wanted.per_splat(), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3, err_msg=name)


def test_lists_that_are_refreshed_are_those_of_the_cpu() -> None:
    """Oracle: the CPU's loops: twins are parted, a slight move keeps lists, a long one does not."""
    start = ball(50).positions
    start[7] = start[8]
    support = np.full(50, 0.8, np.float32)
    searches = [Neighbors(each, NeighborsParameters()) for each in (CudaDevice(), CpuDevice())]
    for way in (0.0, 0.01, 0.7):
        moved = start + np.float32(way) * np.random.default_rng(1).normal(size=(50, 3))
        found, wanted = (each.update(moved.astype(np.float32), support) for each in searches)
        assert found.build == wanted.build
        for name in ("order", "rank", "rows", "neighbors", "positions", "support"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), name)
