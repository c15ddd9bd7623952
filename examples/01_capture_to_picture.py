"""Convert a capture to a stage, and render the stage.

python examples/01_capture_to_picture.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from usdsplat import ImportOptions, formats, import_capture, procedural_capture
from usdsplat import main as usdsplat


def main(folder: Path) -> Path:
    """Write capture.ply, capture.usdc and capture.exr. Return the picture."""
    scan, stage, picture = (folder / f"capture{suffix}" for suffix in (".ply", ".usdc", ".exr"))
    formats.write(procedural_capture(20_000), scan)
    y_up = ImportOptions(axes="rub")  # most scans have other axes
    report = import_capture(scan, stage, options=y_up)
    print(f"{report.splats} splats at {report.prim_path}")
    usdsplat(["render", str(stage), "-o", str(picture), "--resolution", "320x240"])
    return picture


def check(picture: Path) -> None:
    """Check that splats are visible, that colours are linear Rec.709, and that empty pixels are
    0."""
    image = oiio.ImageBuf(str(picture))
    pixels = image.get_pixels(oiio.FLOAT)
    assert image.spec().getattribute("colorInteropID") == "lin_rec709_scene"
    assert 0.1 < np.mean(pixels[..., 3] > 0.5) < 0.95
    assert not pixels[pixels[..., 3] == 0].any()


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    target.mkdir(parents=True, exist_ok=True)
    check(main(target))
