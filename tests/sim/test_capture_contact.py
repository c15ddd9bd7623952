"""Tests of many affectors on a real capture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.sim.affectors import affector, capsule_gaps, capsules
from usdsplat.core.cloud import SplatCloud
from usdsplat.formats import read
from usdsplat.kernels.devices import open_device
from usdsplat.sim.contact import Contacts
from usdsplat.sim.parameters import SettleParameters
from usdsplat.sim.settle import settle_back
from usdsplat.sim.specs import Affector
from usdsplat.sim.state import State

FRAMES = 100


def test_a_hundred_frames_of_sixteen_capsules(data: Path) -> None:
    """Oracle: distances from capsules in float64 NumPy. After every tenth of 100 frames of capsules
    that overlap, move and pull splats back between them, none is inside by more than 1e-5 R; and
    what a seventeenth capsule struck, which crosses the capture within frame 50, is nowhere in the
    way that it took."""
    cloud = read(data / "splats" / "statue_angel.sog").cloud
    third = {
        name: np.ascontiguousarray(getattr(cloud, name)[::3])
        for name in ("positions", "scales", "rotations", "opacities", "sh")
    }
    cloud = SplatCloud(**third)
    state = State.of(cloud)
    middle = np.median(state.positions, axis=0)
    reach = float(np.quantile(np.linalg.norm(state.positions - middle, axis=1), 0.6))
    state.positions -= middle.astype(np.float32)
    state.rest_positions = state.positions.copy()
    largest = state.rest_scales.max(axis=1).astype(np.float64)
    sigma = np.minimum(largest, 3 * np.median(largest))
    radius, device, dt = 0.2 * reach, open_device(), 1 / 24
    contacts = Contacts(device)
    settle = SettleParameters(omega=8.0)
    worst, touched, struck = np.inf, 0, 0
    knobs = {"blend": 0.05 * reach, "clearance": 0.5, "friction": 0.2}

    def at(frame: int) -> list[Affector]:
        slow = capsules(frame / 40, count=16, radius=radius, half=0.4 * reach, spread=0.5 * reach,
                        seed=11, **knobs)  # fmt: skip
        matrix = np.eye(4)
        matrix[0, 3] = -20 * reach if frame <= 50 else 20 * reach
        size = (0.05 * reach, 0.05 * reach, 0.1 * reach)
        return [*slow, affector("capsule", size, matrix, path="/fast", friction=0.2)]

    for frame in range(FRAMES):
        started = state.positions.copy()
        settle_back(device, state, state.rest_positions, state.rest_positions, settle, dt)
        ends = at(frame), at(frame + 1)
        counts = contacts.step(state, started, *ends, dt)
        touched, struck = touched + counts.touched, struck + counts.struck
        assert counts.trapped == 0
        if frame % 10 == 9:
            joined, least = capsule_gaps(ends[1], state.positions, sigma)
            worst = min(worst, joined.min() / radius, least.min() / radius)
        if frame == 50:
            matrix, size = ends[1][-1].solids[0].matrix, ends[1][-1].solids[0].size
            was = started.astype(np.float64)
            near = np.maximum(np.abs(was[:, 2]) - size[2], 0)
            in_way = np.hypot(was[:, 1], near) < 0.5 * size[0]
            in_way &= np.abs(was[:, 0]) < 19 * reach
            now = state.positions.astype(np.float64)
            tube = np.hypot(now[:, 1], np.maximum(np.abs(now[:, 2]) - size[2], 0)) < 0.5 * size[0]
            passed = in_way & tube & (now[:, 0] < matrix[0, 3])
            gap = capsule_gaps(ends[1][:-1], now, sigma)[0]
            assert in_way.sum() > 50
            # Others may have been pushed back into its way afterwards by the capsules they touch.
            assert not (passed & (gap > 0.01 * radius)).any()
    assert touched > 100_000
    assert struck > 500
    assert worst >= -1e-5
