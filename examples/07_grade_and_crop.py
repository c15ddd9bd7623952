"""Author a grade and a garbage matte in a separate layer. The capture's arrays are not changed.

python examples/07_grade_and_crop.py [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from usdsplat import Engine, RenderSettings, procedural_capture, schema

RADIUS = 0.6
LOOK = f"""#usda 1.0
over "World"
{{
    over "Capture" (prepend apiSchemas = ["SplatGradeAPI", "SplatCropAPI"])
    {{
        float splat:grade:exposure = -1
        rel collection:cropInclude:includes = </World/Keep>
    }}
    def Sphere "Keep"
    {{
        double radius = {RADIUS}
    }}
}}
"""
LINEAR = RenderSettings(blend_space="linear", color_mode="scene")


def main(folder: Path) -> Path:
    """Write capture.usdc, look.usda and shot.usda, which has both as sublayers.

    Return shot.usda.
    """
    base = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(base, "/World/Capture", procedural_capture(20_000))
    base.Save()
    look = Sdf.Layer.CreateNew(str(folder / "look.usda"))
    look.ImportFromString(LOOK)
    look.Save()
    shot = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    shot.GetRootLayer().subLayerPaths = ["look.usda", "capture.usdc"]
    shot.Save()
    return folder / "shot.usda"


def check(path: Path) -> None:
    """Check that only splats in the sphere are drawn, with half the brightness in linear light."""
    shot = Usd.Stage.Open(str(path))
    field = shot.GetPrimAtPath("/World/Capture")
    positions = schema.fetch(field).positions
    with Engine(shot) as engine:
        view = engine.view(resolution=(320, 240))
        picture = engine.picture(view, LINEAR, ("color", "elementId"))
        seen = np.unique(picture["elementId"][picture["elementId"] >= 0])
        assert len(seen) > 100
        assert np.linalg.norm(positions[seen], axis=1).max() <= RADIUS
        schema.author_grade(field, exposure=0.0)  # the engine follows this unsaved edit
        plain = engine.picture(view, LINEAR)["color"]
        np.testing.assert_allclose(picture["color"][..., :3], plain[..., :3] / 2, atol=1e-6)
        shot.MuteLayer(shot.ResolveIdentifierToEditTarget("look.usda"))
        whole = engine.picture(view, LINEAR)["color"]
        print(f"{plain[..., 3].sum():.0f} of {whole[..., 3].sum():.0f} pixels are kept")
        assert plain[..., 3].sum() < 0.8 * whole[..., 3].sum()


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
