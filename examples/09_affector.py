"""Move a rotating capsule through a capture: it pushes splats away, which settle behind it.

python examples/09_affector.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat import author_parameters, procedural_capture, schema
from usdsplat import main as usdsplat

FIELD, ROD = "/World/Capture", "/World/Rod"
RADIUS, HALF = 0.12, 0.25
PASS, LAST = 16, 30
"""Last frame with the capsule, and last frame of all."""


def main(folder: Path) -> Path:
    """Write capture.usdc, rod.usda with the simulation, and pushed.usda with the result.

    Return pushed.usda.
    """
    base = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(base, FIELD, procedural_capture(10_000))
    base.Save()
    stage = Usd.Stage.CreateNew(str(folder / "rod.usda"))
    stage.GetRootLayer().subLayerPaths = ["capture.usdc"]
    stage.SetTimeCodesPerSecond(24)
    rod = UsdGeom.Capsule.Define(stage, ROD)
    rod.CreateRadiusAttr(RADIUS)
    rod.CreateHeightAttr(2 * HALF)
    move, turn = rod.AddTranslateOp(), rod.AddRotateXOp()
    for frame, x, angle in ((1, -1.5, 0.0), (PASS, 1.5, 360.0)):
        move.Set(Gf.Vec3d(x, 0.3, 0.1), frame)
        turn.Set(angle, frame)
    author_parameters(rod.GetPrim(), {"affector:role": "collide", "affector:friction": 0.1})
    for frame, enabled in ((1, True), (PASS + 1, False)):  # pushed splats can settle afterwards
        author_parameters(rod.GetPrim(), {"affector:enabled": enabled}, time=frame)
    sim = stage.DefinePrim("/World/Sim", "SplatSim")
    author_parameters(sim, {"settle:omega": 12.0})
    stage.Save()
    baked = folder / "pushed.usda"
    command = f"simulate {folder}/rod.usda -o {baked} --frames 1:{LAST}"
    assert usdsplat(command.split()) == 0
    return baked


def check(path: Path) -> None:
    """Check that no splat is in the capsule, that pushed splats return, and that others stay."""
    stage = Usd.Stage.Open(str(path))
    rod, field = UsdGeom.Capsule.Get(stage, ROD), stage.GetPrimAtPath(FIELD)
    base = Usd.Stage.Open(str(path.parent / "capture.usdc"))
    rest = schema.fetch(base.GetPrimAtPath(FIELD))
    moved, nearest = [], []
    for frame in range(1, LAST + 1):
        positions = schema.fetch(field, frame).positions
        moved.append(np.linalg.norm(positions - rest.positions, axis=1))
        if frame > PASS:
            continue
        place = np.array(rod.ComputeLocalToWorldTransform(frame))
        inside = (positions - place[3, :3]) @ place[:3, :3].T  # rotated, not scaled
        inside[:, 2] -= np.clip(inside[:, 2], -HALF, HALF)
        nearest.append(np.linalg.norm(inside, axis=1).min() - RADIUS)
    most = np.max(moved, axis=0)
    pushed = most > 1e-6
    print(
        f"{pushed.sum()} of {len(pushed)} splats pushed, by up to {most.max():.3f} m, none deeper "
        f"than {max(0, -min(nearest)):.1e} m; {moved[-1].max() / most.max():.1%} is left"
    )
    assert 100 < pushed.sum() < len(pushed)
    assert min(nearest) > -1e-5 * RADIUS
    assert moved[-1].max() < 0.1 * most.max()


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
