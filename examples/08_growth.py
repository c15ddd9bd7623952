"""Grow a pattern over a capture. Where it is high, it colours, raises and multiplies splats.

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
    "rd:preset=coral",
    "rd:substeps=120",  # develops the pattern in seconds; the preset needs a hundred frames
    "rd:patternScale=0.02",
    "rd:seedDensity=0.0005",
    "growth:birthRate=2",
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
    """Check that the pattern spreads, children have new ids, and only splats in the pattern
    move."""
    stage = Usd.Stage.Open(str(path))
    field = stage.GetPrimAtPath(FIELD)
    before, after = (schema.fetch(field, frame) for frame in FRAMES)
    pattern = field.GetAttribute("primvars:splatSim:v")
    areas = [np.mean(np.array(pattern.Get(frame)) > 0.2) for frame in FRAMES]
    count = len(before.positions)
    born = int(np.sum(after.opacities > 0)) - int(np.sum(before.opacities > 0))
    print(f"pattern on {areas[0]:.0%}, then {areas[1]:.0%} of the splats; {born} were born")
    assert areas[1] > max(0.3, 1.5 * areas[0])
    assert born > 100
    assert len(np.unique(after.ids)) == len(after.ids)
    assert np.array_equal(after.ids[:count], before.ids)
    v = np.array(pattern.Get(FRAMES[1]))[:count]
    moved = np.linalg.norm(after.positions[:count] - before.positions, axis=1)
    raised, flat = np.median(moved[v > 0.3]), np.median(moved[v < 0.02])
    print(f"raised by {1000 * raised:.1f} mm where it is, by {1000 * flat:.1f} mm elsewhere")
    assert raised > 10 * flat


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
