"""Render a ball that is half inside a capture: splats and surfaces hide each other in all AOVs.

python examples/04_surfaces_and_aovs.py [FOLDER]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Usd, UsdGeom

from usdsplat import main as usdsplat
from usdsplat import procedural_capture, schema

AOVS = "color,Z,N,P,albedo,cryptoObject"
BALL, FIELD = "/World/Ball", "/World/Capture"


def main(folder: Path) -> Path:
    """Write ball.usda and ball.exr. Return the picture."""
    stage = Usd.Stage.CreateNew(str(folder / "ball.usda"))
    schema.author(stage, FIELD, procedural_capture(20_000))
    ball = UsdGeom.Sphere.Define(stage, BALL)
    ball.GetRadiusAttr().Set(0.25)
    # Its centre is on the ground, whose splats hide the lower half.
    ball.AddTranslateOp().Set((0.0, 0.0, 0.8))
    ball.CreateDisplayColorAttr([(0.8, 0.1, 0.05)])
    stage.Save()
    picture = folder / "ball.exr"
    command = f"render {folder}/ball.usda -o {picture} --resolution 320x240 --aovs {AOVS}"
    usdsplat(command.split())
    return picture


def check(picture: Path) -> None:
    """Check that both prims are in the matte, weights sum to the coverage, and P agrees with Z."""
    image = oiio.ImageBuf(str(picture))
    spec = image.spec()
    channels = np.moveaxis(image.get_pixels(oiio.FLOAT), 2, 0)
    pixels = dict(zip(spec.channelnames, channels, strict=True))
    manifest = next(
        json.loads(entry.value) for entry in spec.extra_attribs if entry.name.endswith("/manifest")
    )
    assert {BALL, FIELD} <= set(manifest)
    print({path: int(np.sum(_weight(pixels, bits))) for path, bits in manifest.items()}, "pixels")
    assert np.sum(_weight(pixels, manifest[BALL])) > 100
    total = sum(_weight(pixels, bits) for bits in manifest.values())
    # A is stored as half. A splat may peak so near a surface that rounding decides the order.
    assert np.mean(np.abs(total - pixels["A"]) > 2e-3) < 1e-4
    seen = np.isfinite(pixels["Z"])
    normals = np.stack([pixels[f"N.{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(normals[:, seen], axis=0), 1, atol=1e-2)
    assert not any(pixels[f"P.{axis}"][~seen].any() for axis in "xyz")
    assert pixels["albedo.R"].max() > 0.1


def _weight(pixels: dict[str, np.ndarray], bits: str) -> np.ndarray:
    """Return the fraction of each pixel that is covered by the prim with a Cryptomatte id."""
    total = np.zeros_like(pixels["A"])
    for rank in range(3):
        for hashed, weight in ("RG", "BA"):
            is_it = pixels[f"cryptoObject{rank:02}.{hashed}"].view(np.uint32) == int(bits, 16)
            total += np.where(is_it, pixels[f"cryptoObject{rank:02}.{weight}"], 0)
    return total


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
