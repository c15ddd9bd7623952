"""Dissolve a capture patch by patch, and assemble it by the same motion reversed in time.

python examples/12_dissolve.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Usd

from usdsplat import SplatCloud, procedural_capture, schema
from usdsplat import main as usdsplat

FIELD = "/World/Capture"
LAST = 19
"""Last frame, three quarters of a second after the first."""
COMMON = ("dissolve:duration=0.5", "dissolve:fade=0.25", "particles:turbulence=0")
MODES = {
    "dissolve": ("dissolve:mode=dissolve", "dissolve:start=0"),
    "assemble": ("dissolve:mode=assemble", "dissolve:start=0.25"),
}
"""Mode -> parameters.

The last splat detaches half a second after the first, and has vanished at the last frame. To be the
exact reverse, assembling starts a quarter of a second later.
"""


def main(folder: Path) -> Path:
    """Write capture.usdc, scene.usda, and a bake of each mode. Return the folder."""
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, FIELD, procedural_capture(5_000))
    stage.Save()
    scene = folder / "scene.usda"
    assert usdsplat(f"simulate --preset dissolve {folder}/capture.usdc -o {scene}".split()) == 0
    for mode, settings in MODES.items():
        command = f"simulate {scene} -o {folder}/{mode}.usda --frames 1:{LAST}".split()
        for setting in (*COMMON, *settings):
            command += ["--set", setting]
        assert usdsplat(command) == 0
    return folder


def check(folder: Path) -> None:
    """Check the order, that splats are unchanged until they detach, and that assemble is the
    reverse."""
    stages = {mode: Usd.Stage.Open(str(folder / f"{mode}.usda")) for mode in MODES}
    # the capture with its large splats divided, which the bake has as default values
    rest = schema.fetch(stages["dissolve"].GetPrimAtPath(FIELD))

    def at(mode: str, frame: int) -> SplatCloud:
        return schema.fetch(stages[mode].GetPrimAtPath(FIELD), frame)

    gone, vanished = [], []
    for frame in range(1, LAST + 1):
        cloud = at("dissolve", frame)
        away = (cloud.positions != rest.positions).any(axis=1)
        assert np.array_equal(cloud.scales[~away], rest.scales[~away])
        gone.append(int(away.sum()))
        vanished.append(int(np.sum((cloud.opacities == 0) & (rest.opacities > 0))))
    print(f"gone {gone[::3]}, vanished {vanished[::3]} of {len(rest.positions)}")
    assert gone == sorted(gone)
    assert vanished == sorted(vanished)
    assert gone[0] == vanished[0] == 0
    assert vanished[-1] == gone[-1] == len(rest.positions)
    size = np.ptp(rest.positions, axis=0).max()
    off, pale = 0.0, 0.0
    for frame in range(1, LAST + 1):
        there, here = at("dissolve", LAST + 1 - frame), at("assemble", frame)
        off = max(off, float(np.abs(there.positions - here.positions).max()) / size)
        pale = max(pale, float(np.abs(there.opacities - here.opacities).max()))
    print(f"mirrored to {off:.1%} of its size and to {pale:.1e} of opacity")
    assert off < 0.01  # steps of 1/96 s, compared with a closed form
    assert pale < 1e-5
    assert np.array_equal(at("assemble", LAST).positions, rest.positions)


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
