"""Small inputs for the commands of the fault tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from usdsplat import formats
from usdsplat.core.cloud import SplatCloud
from usdsplat.interchange import import_capture
from usdsplat.interchange.files import open_stage
from usdsplat.sim.stage.presets import author_preset

SPLATS = 200


def _cloud(seed: int) -> SplatCloud:
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(SPLATS, 4)).astype(np.float32)
    return SplatCloud(
        positions=rng.normal(size=(SPLATS, 3)).astype(np.float32),
        rotations=rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        scales=np.full((SPLATS, 3), 0.05, np.float32),
        opacities=np.full(SPLATS, 0.8, np.float32),
        sh=rng.random((SPLATS, 4, 3)).astype(np.float32),
    )


def write_inputs(folder: Path) -> None:
    """Write a capture, a sequence of three, stages with one and two fields, and a simulation."""
    formats.write(_cloud(0), folder / "scan.ply")
    for number in (1, 2, 3):
        formats.write(_cloud(number), folder / f"scan.{number:04d}.ply")
    import_capture(folder / "scan.ply", folder / "stage.usda")
    author_preset("push", open_stage(folder / "stage.usda"), folder / "push.usda", last=24)
    (folder / "two.usda").write_text(
        "#usda 1.0\n"
        'def "A" (references = @./stage.usda@) {}\n'
        'def "B" (references = @./stage.usda@) {}\n'
    )
