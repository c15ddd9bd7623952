"""Render a deep picture of splats, and the same with another renderer's picture as a holdout.

A deep EXR contains every contribution to a pixel. Flattened, it equals the picture blended in
linear light. If a CG ball is the holdout, compositing the ball leaves no visible edge.

    python examples/05_deep_and_holdout.py [FOLDER]
"""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Usd, UsdGeom

from usdsplat import DeepImage, procedural_capture, read_deep, schema
from usdsplat import main as usdsplat

COMMON = "--resolution 160x120 --camera /World/Camera"
COMMANDS = (
    "render shot.usda -o cg.exr --aovs color,Z --float --mask /CG",
    "render shot.usda -o deep.exr --deep --mask /World",
    "render shot.usda -o linear.exr --blend-space linear --float --mask /World",
    "render shot.usda -o held.exr --holdout cg.exr --float --mask /World",
    "render shot.usda -o both.exr --float",
)
"""Commands. Splats are below /World; a ball below /CG stands for another renderer's picture."""


def main(folder: Path) -> Path:
    """Write a stage and the pictures of `COMMANDS`. Return the folder."""
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    schema.author(stage, "/World/Capture", procedural_capture(20_000))
    ball = UsdGeom.Sphere.Define(stage, "/CG/Ball")
    ball.GetRadiusAttr().Set(0.3)
    ball.AddTranslateOp().Set((0.2, 0.3, 0.0))
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set((0.0, 0.4, 5.0))
    camera.GetClippingRangeAttr().Set((0.1, 100.0))
    stage.Save()
    with contextlib.chdir(folder):
        for command in COMMANDS:
            assert usdsplat(f"{command} {COMMON}".split()) == 0
    return folder


def check(folder: Path) -> None:
    """Check that deep pictures flatten to the linear one, and that the ball fits into the
    holdout."""
    deep = read_deep(folder / "deep.exr")
    print(f"{len(deep.depth)} samples, at most {np.diff(deep.offsets).max()} in a pixel")
    np.testing.assert_allclose(flattened(deep), color(folder / "linear.exr"), atol=1e-3)
    held, ball = color(folder / "held.exr"), color(folder / "cg.exr")
    assert 0.01 < np.mean(ball[..., 3]) < 0.5
    merged = held + (1 - held[..., 3:]) * ball
    np.testing.assert_allclose(merged, color(folder / "both.exr"), atol=1e-5)


def color(path: Path) -> np.ndarray:
    """Return the RGBA of a flat picture, shape (h, w, 4)."""
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :4]


def flattened(deep: DeepImage) -> np.ndarray:
    """Composite the samples of each pixel, near over far, shape (h, w, 4)."""
    image = np.zeros((len(deep.offsets) - 1, 4), np.float32)
    for i, (start, end) in enumerate(zip(deep.offsets[:-1], deep.offsets[1:], strict=True)):
        for sample in deep.color[start:end]:
            image[i] += (1 - image[i, 3]) * sample
    x0, y0, x1, y1 = deep.window
    return image.reshape(y1 - y0, x1 - x0, 4)


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
