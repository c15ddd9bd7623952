"""Frames of a simulation, which windows keep and draw while it goes on."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.progress import silent
from usdsplat.interchange.files import open_stage
from usdsplat.kernels.devices import open_device
from usdsplat.products.presets import make_stage
from usdsplat.sim.stage.simulation import Simulation
from usdsplat.sim.state import Frame

CASES = (
    "grow", "grow moss", "grow crystals", "grow veins", "push", "push rubber", "push stone",
    "wade", "shatter", "morph", "dissolve",
)  # fmt: skip
COUNT = 1_000
FRAMES = 32


def digest(frame: Frame) -> str:
    """SHA-256 of all arrays of a frame."""
    cloud = frame.cloud
    arrays = (
        cloud.positions, cloud.rotations, cloud.scales, cloud.opacities, cloud.sh, cloud.ids,
        cloud.velocities, frame.uv, frame.births,
    )  # fmt: skip
    total = hashlib.sha256()
    for each in arrays:
        assert each is not None
        total.update(np.ascontiguousarray(each).view(np.uint8).reshape(-1).data)
    return total.hexdigest()


@pytest.mark.parametrize("case", CASES)
def test_a_frame_does_not_change_while_the_simulation_goes_on(
    data: Path, tmp_path: Path, case: str
) -> None:
    """Oracle: the bytes of each frame when it was made. State and frames share arrays, so every
    stage must replace what it changes."""
    preset, _, form = case.partition(" ")
    cloud = formats.read(data / "splats" / "statue_massa.sog").cloud
    rows = np.sort(np.random.default_rng(0).choice(len(cloud), COUNT, replace=False))
    formats.write(edit.take(cloud, rows), tmp_path / "a.ply")
    option = "style" if preset == "grow" else "material"
    options: dict[str, str | None] = {option: form} if form else {}
    if preset == "morph":
        other = formats.read(data / "splats" / "pod.spz").cloud
        formats.write(edit.take(other, np.arange(0, len(other), 100)), tmp_path / "b.ply")
        options["target"] = str(tmp_path / "b.ply")
    make_stage(
        preset, tmp_path / "a.ply", tmp_path / "shot.usda", axes=None, progress=silent,
        options=options,
    )  # fmt: skip
    stage = open_stage(tmp_path / "shot.usda")
    times = [1.0 + number for number in range(FRAMES)]
    simulation = Simulation(stage, times, device=open_device())
    simulation.begin()
    made: list[tuple[str, Frame]] = []
    for number in range(FRAMES):
        if number:
            simulation.advance()
        for path in simulation.recipes:
            frame = simulation.frame(path)
            made.append((digest(frame), frame))
    assert len({before for before, _ in made}) > 1, "nothing moves"
    for before, frame in made:
        assert digest(frame) == before
