"""Tests of all stages together with births and deaths: the same bits in every kind of run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.folded import folded
from tests.sim.recipes import Written, on_carriers, on_themselves, played, started
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim import checkpoint
from usdsplat.sim.checkpoint import Checkpoint
from usdsplat.sim.state import BORN, FREE, Frame

FRAMES, HALF = 60, 30
SCENES = {"carrier": on_carriers, "self": on_themselves}


def print_of(frame: Frame) -> str:
    """SHA-256 over all that is handed over."""
    cloud = frame.cloud
    total = hashlib.sha256(repr(frame.time).encode())
    for array in (
        cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh, cloud.ids,
        cloud.velocities, frame.uv, frame.births,
    ):  # fmt: skip
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


class Run:
    """A simulation and the prints of its frames."""

    def __init__(self, device: CpuDevice, recipe: Written, first: int = 0, state=None) -> None:
        self.solver = started(device, recipe, FRAMES, state=state)
        self.prints = [] if state else [print_of(self.solver.frame())]
        self.frame = first

    def to(self, frame: int) -> Run:
        while self.frame < frame:
            self.solver.advance()
            self.prints.append(print_of(self.solver.frame()))
            self.frame += 1
        return self

    def digest(self) -> str:
        return self.solver.checkpoint().digest()


@pytest.fixture(scope="module", params=list(SCENES))
def scene(request) -> Callable[[], Written]:
    return SCENES[request.param]


@pytest.fixture(scope="module")
def straight(any_device, scene) -> Run:
    """60 frames by one thread."""
    return Run(open_device(threads=1), scene()).to(FRAMES)


def test_everything_happens(scene, straight) -> None:
    """Oracle: counts of the state; what does not happen is not proved by the other tests."""
    state = straight.solver.state
    solver = started(open_device(), scene(), FRAMES)
    counts = [len(solver.state)]
    flew = touched = 0
    for _ in range(FRAMES):
        solver.advance()
        solver.frame()
        counts.append(len(solver.state))
        flew = max(flew, int(((solver.state.flags & FREE) != 0).sum()))
        touched += int((solver.state.memory["contact:since"] == 0).sum())
    changes = np.diff(counts)
    assert (changes > 0).any()
    assert (changes < 0).any()
    assert state.next_id > counts[0] + 50
    assert ((state.flags & BORN) != 0).any()
    assert flew > 100
    assert touched > 100
    assert np.ptp(state.uv[:, 1]) > 0.1
    assert (np.diff(state.ids) > 0).all()
    assert np.isfinite(state.positions).all()
    assert not np.array_equal(state.sh, state.rest_sh)


def test_two_threads_give_the_same_bits_as_one(scene, straight) -> None:
    """Oracle: one thread, over 60 frames: each frame and the state."""
    both = Run(open_device(threads=2), scene()).to(FRAMES)
    assert both.prints == straight.prints
    assert both.digest() == straight.digest()


@pytest.mark.parametrize("half", folded([17, 1, HALF]))
def test_a_restart_goes_on_with_the_same_bits(scene, straight, tmp_path: Path, half: int) -> None:
    """Oracle: straight through; the state goes through a file and a solver of its own."""
    before = Run(open_device(threads=2), scene()).to(half)
    states = {"/f": before.solver.checkpoint()}
    checkpoint.save(tmp_path / "c", Checkpoint(time=half, states=states, parameter_hash=""))
    state = checkpoint.load(tmp_path / "c").states["/f"]
    after = Run(open_device(threads=2), scene(), half, state).to(FRAMES)
    assert before.prints + after.prints == straight.prints
    assert after.digest() == straight.digest()


def test_what_a_frame_holds_never_changes(scene) -> None:
    """Oracle: the prints of frames when they were handed over."""
    recipe = scene()
    solver = started(open_device(), recipe, 12)
    frames, prints = [], []
    for _ in range(12):
        frames.append(solver.frame())
        prints.append(print_of(frames[-1]))
        solver.advance()
    assert [print_of(each) for each in frames] == prints
    assert [print_of(each) for each in played(open_device(), recipe, 12)] == prints
