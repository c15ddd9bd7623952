"""Grow new matter over a capture: a front spreads from seeds, and behind it a pattern rises.

python examples/08_growth.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Usd

from usdsplat import main as usdsplat
from usdsplat import procedural_capture, schema

FIELD = "/World/Capture"
FRAMES = (1, 16)
SETTINGS = (
    "rd:substeps=120",
    "rd:frontSpeed=80",  # spreads in half a second; the preset takes a hundred frames
    "bake:pattern=true",
)


def main(folder: Path) -> Path:
    """Write capture.usdc, grow.usda with the simulation, and grown.usda with the result.

    Return grown.usda.
    """
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, FIELD, procedural_capture(4_000))
    stage.Save()
    made, grown = folder / "grow.usda", folder / "grown.usda"
    assert usdsplat(f"simulate --preset grow {folder}/capture.usdc -o {made}".split()) == 0
    command = ["simulate", str(made), "-o", str(grown), "--frames", f"{FRAMES[0]}:{FRAMES[1]}"]
    for setting in SETTINGS:
        command += ["--set", setting]
    assert usdsplat(command) == 0
    return grown


def check(path: Path) -> None:
    """Check that the pattern spreads, new matter has new ids and lies over the capture, and the
    capture stays."""
    stage = Usd.Stage.Open(str(path))
    field = stage.GetPrimAtPath(FIELD)
    before, after = (schema.fetch(field, frame) for frame in FRAMES)
    pattern = field.GetAttribute("primvars:splatSim:v")
    here = before.opacities > 0  # the capture; new matter has rows, but is invisible
    areas = [np.mean(np.array(pattern.Get(frame))[here] > 0.2) for frame in FRAMES]
    born = int(np.sum(after.opacities > 0)) - int(np.sum(here))
    print(f"pattern on {areas[0]:.0%}, then {areas[1]:.0%} of the capture; {born} discs were born")
    assert areas[0] < 0.05 and areas[1] > 0.2
    assert born > 1000
    assert len(np.unique(after.ids)) == len(after.ids)
    assert np.array_equal(after.ids, before.ids)
    moved = np.linalg.norm(after.positions - before.positions, axis=1)[here]
    print(f"half of the capture moved by {1000 * np.median(moved):.1f} mm")
    assert np.median(moved) == 0


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
