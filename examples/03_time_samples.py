"""Write time samples to a separate layer: a wave passes through a capture, which is not changed.

The layer contains only `over`s, in packed form: 76 bytes per splat of degree 3 and frame instead of
236. Mute the layer to restore the capture.

    python examples/03_time_samples.py [FOLDER]
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from usdsplat import Engine, SplatCloud, procedural_capture, schema

FRAMES = range(1, 9)


def wave(cloud: SplatCloud, frame: int) -> SplatCloud:
    """Return the cloud with a ripple of 4 cm that moves along x."""
    offset = 0.04 * np.sin(12 * cloud.positions[:, 0] - 0.7 * frame)
    positions = cloud.positions + np.stack([0 * offset, offset, 0 * offset], axis=1)
    return replace(cloud, positions=positions.astype(np.float32))


def main(folder: Path) -> Path:
    """Write capture.usdc, wave.usdc and shot.usda, which has both as sublayers.

    Return shot.usda.
    """
    cloud = procedural_capture(20_000)
    base = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(base, "/World/Capture", cloud)
    base.Save()
    result = Sdf.Layer.CreateNew(str(folder / "wave.usdc"))
    shot = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    shot.GetRootLayer().subLayerPaths = ["wave.usdc", "capture.usdc"]
    with Usd.EditContext(shot, result):
        for frame in FRAMES:
            schema.author(shot, "/World/Capture", wave(cloud, frame), form="packed", time=frame)
    shot.SetStartTimeCode(FRAMES[0])
    shot.SetEndTimeCode(FRAMES[-1])
    result.Save()
    shot.Save()
    return folder / "shot.usda"


def check(path: Path) -> None:
    """Check that frames differ, and that muting the results restores the picture bit for bit."""
    shot = Usd.Stage.Open(str(path))
    with Engine(shot) as engine:
        view = engine.view(resolution=(160, 120))
        pictures = []
        for frame in FRAMES:
            engine.set_time(frame)
            pictures.append(engine.picture(view)["color"])
        assert all(np.any(a != b) for a, b in itertools.pairwise(pictures))
        shot.MuteLayer(shot.ResolveIdentifierToEditTarget("wave.usdc"))
        restored = engine.picture(view)["color"]
    capture_alone = Usd.Stage.Open(str(path.parent / "capture.usdc"))
    with Engine(capture_alone) as engine:
        np.testing.assert_array_equal(restored, engine.picture(view)["color"])


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
