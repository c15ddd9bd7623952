"""Render a moving capture with motion blur and motion vectors.

python examples/06_blur.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import Engine, RenderSettings, procedural_capture, schema

STEP = 0.25
"""Motion of the capture to the right from frame to frame [scene unit]."""
PIXELS = 80
"""Pixels per scene unit: 320 across an orthographic camera of width 4."""


def main(folder: Path) -> Path:
    """Author blur.usda, and save pictures of frame 2, sharp and blurred. Return the file."""
    stage = Usd.Stage.CreateNew(str(folder / "blur.usda"))
    field = schema.author(stage, "/World/Capture", procedural_capture(20_000))
    move = UsdGeom.Xformable(field).AddTranslateOp()
    for frame in (1, 4):
        move.Set((STEP * (frame - 2), 0.0, 0.0), frame)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set((0.0, 0.4, 5.0))
    camera.GetProjectionAttr().Set(UsdGeom.Tokens.orthographic)
    camera.GetHorizontalApertureAttr().Set(40.0)  # unit: a tenth of a scene unit
    camera.GetVerticalApertureAttr().Set(30.0)
    camera.GetShutterOpenAttr().Set(0.0)
    camera.GetShutterCloseAttr().Set(0.5)
    stage.Save()
    with Engine(stage, time=2) as engine:
        view = engine.view("/World/Camera", resolution=(320, 240))
        # The static picture has the same 32 points in each pixel, so that only the shutter differs.
        blur = RenderSettings(samples=32)
        still = RenderSettings(samples=32, motion_blur=False)
        blurred = engine.picture(view, blur, ("color", "motionForward", "motionBackward"))
        target = folder / "blur.npz"
        np.savez(target, **blurred, still=engine.picture(view, still)["color"])
    return target


def check(target: Path) -> None:
    """Check the motion vectors, and that blur keeps the sum of the coverage and moves its centre by
    half of the motion during the shutter."""
    picture = np.load(target)
    for name in ("motionForward", "motionBackward"):
        moves = picture[name][picture[name].any(axis=-1)]
        np.testing.assert_allclose(moves, [[STEP * PIXELS, 0]] * len(moves), atol=1e-3)
    blurred, still = (np.sum(picture[name][..., 3], axis=0) for name in ("color", "still"))
    np.testing.assert_allclose(blurred.sum(), still.sum(), rtol=1e-3)
    columns = np.arange(320)
    moved = np.average(columns, weights=blurred) - np.average(columns, weights=still)
    print(f"{moved:.2f} pixels, {0.25 * STEP * PIXELS:g} until the middle of the shutter")
    assert abs(moved - 0.25 * STEP * PIXELS) < 0.1


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
