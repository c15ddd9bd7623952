"""Catch the shadow of a capture for a plate, and let a box on it cast its own.

python examples/15_lighting.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Usd, UsdGeom, UsdLux

from usdsplat import main as usdsplat
from usdsplat import procedural_capture, schema

FIELD, GROUND = "/World/Capture", "/World/Ground"


def main(folder: Path) -> Path:
    """Write lit.usda and lit.exr. Return the picture."""
    stage = Usd.Stage.CreateNew(str(folder / "lit.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    capture = procedural_capture(20_000)
    schema.author(stage, FIELD, capture)
    low, high = (np.quantile(capture.positions, part, axis=0) for part in (0.01, 0.99))
    size, middle = float((high - low).max()), (0.5 * (low + high)).tolist()
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    ground = UsdGeom.Mesh.Define(stage, GROUND)
    ground.CreatePointsAttr(
        [(middle[0] + 3 * size * x, middle[1] + 3 * size * y, float(low[2])) for x, y in corners]
    )
    ground.CreateFaceVertexCountsAttr([4])
    ground.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    box = UsdGeom.Cube.Define(stage, "/World/Box")
    box.CreateSizeAttr(0.2 * size)
    box.AddTranslateOp().Set(Gf.Vec3d(*middle) + Gf.Vec3d(0, 0, 0.7 * size))
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    sun.CreateAngleAttr(1.0)
    sun.CreateNormalizeAttr(True)
    sun.CreateIntensityAttr(3.0)
    sun.AddRotateXYZOp().Set((25.0, 30.0, 0.0))
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.GetClippingRangeAttr().Set((0.01 * size, 100 * size))
    eye, target = Gf.Vec3d(1.0, -5.0, 2.4) * size + Gf.Vec3d(*middle), Gf.Vec3d(*middle)
    matrix = Gf.Matrix4d().SetLookAt(eye, target, Gf.Vec3d.ZAxis()).GetInverse()
    camera.AddTransformOp().Set(matrix)
    stage.Save()
    picture = folder / "lit.exr"
    command = f"render {folder}/lit.usda -o {picture} --resolution 320x240 --aovs color,shadow"
    usdsplat([*command.split(), "--lighting", "shadowed", "--catcher", GROUND])
    return picture


def check(picture: Path) -> None:
    """Check that the ground is not in the picture, and that a shadow lies on part of it."""
    image = oiio.ImageBuf(str(picture))
    names = image.spec().channelnames
    pixels = dict(zip(names, np.moveaxis(image.get_pixels(oiio.FLOAT), 2, 0), strict=True))
    shadow = np.stack([pixels[f"shadow.{each}"] for each in "RGB"])
    assert shadow.min() > 0 and shadow.max() <= 1
    # the umbra keeps the ambient light: 0.2 of 1.2
    assert abs(float(shadow.min()) - 0.2 / 1.2) < 0.05
    in_shadow = shadow[0] < 0.5
    print(f"{in_shadow.mean():.1%} of the plate in shadow")
    assert 0.01 < in_shadow.mean() < 0.5
    assert (pixels["A"] == 0).mean() > 0.2  # the ground is transparent


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
