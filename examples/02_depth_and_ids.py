"""Render two fields of a stage, sorted together, with depth and ids for compositing.

The second field is a mirrored, sheared reference to the first. Its splats and harmonics are
transformed accordingly.

    python examples/02_depth_and_ids.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat import Engine, procedural_capture, schema


def main(folder: Path) -> Path:
    """Author a stage with two fields, and save its AOVs as arrays. Return the file."""
    stage = Usd.Stage.CreateNew(str(folder / "pair.usda"))
    cloud = procedural_capture(20_000)
    schema.author(stage, "/World/Left", cloud)
    right = UsdGeom.Xformable(stage.DefinePrim("/World/Right"))
    right.GetPrim().GetReferences().AddInternalReference("/World/Left")
    mirrored = Gf.Matrix4d(-1, 0, 0, 0, 0.3, 1, 0, 0, 0, 0, 1, 0, 1.5, 0, -0.5, 1)
    right.AddTransformOp().Set(mirrored)
    stage.Save()
    with Engine(stage) as engine:
        view = engine.view(resolution=(320, 240))
        picture = engine.picture(view, aovs=("color", "depth", "primId", "elementId"))
        target = folder / "pair.npz"
        np.savez(target, splats=len(cloud), **picture)
    return target


def check(target: Path) -> None:
    """Check that both fields are visible, every splat pixel has a depth, and ids are valid rows."""
    picture = np.load(target)
    assert set(np.unique(picture["primId"])) == {-1, 0, 1}
    np.testing.assert_array_equal(np.isfinite(picture["depth"]), picture["primId"] >= 0)
    assert 0 <= picture["elementId"].max() < picture["splats"]


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
