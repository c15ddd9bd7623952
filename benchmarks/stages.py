"""Draw the stages of the test data with a capture in each, on one sheet: `docs/stages.jpg`.

    python -m benchmarks.stages [SHEET]

Every picture shows a stage of another project as its files define it, and a capture, scaled to the
size of the scene, that is added by a reference. Cameras are those of the stages, if they have one.
Warnings of each stage are printed.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Usd, UsdGeom

from benchmarks.scenes import DATA
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import import_capture
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

SIZE = (480, 360)
COLUMNS = 4
USDWG, OPENUSD = DATA / "usd" / "usdwg", DATA / "usd" / "openusd"
VEHICLES = USDWG / "Vehicles" / "assets" / "vehicles"
BACKGROUND = (0.09, 0.1, 0.12)

SHIFT, SCALE = 0.4, 0.2
"""Offset of a capture to the right, and its size, as fractions of the scene's size."""
ELSEWHERE = {"Creases_SpinningPyramids": (0.12, 0.1), "renderSettingsEdits": (0.05, 0.12)}
"""Other values for stages whose camera would not see the capture there."""

STAGES = (
    (USDWG / "CesiumMan.usdz", 24.0, "skinned, textured"),
    (USDWG / "RiggedFigure.usdz", 20.0, "skinned"),
    (USDWG / "RiggedSimple.usdz", 30.0, "skinned"),
    (USDWG / "BoxAnimated.usdz", 40.0, "animated"),
    (USDWG / "InterpolationTest.usdz", 20.0, "interpolation"),
    (USDWG / "SubdivisionSurfaces" / "Creases_SpinningPyramids.usda", 10.0, "creases, camera"),
    (USDWG / "SubdivisionSurfaces" / "Pyramid" / "Pyramid.usd", 0.0, "payload"),
    (OPENUSD / "AnimCube.usda", 5.0, "animated"),
    (OPENUSD / "motionBlur.usda", 5.0, "motion blur, 32 samples"),
    (OPENUSD / "renderSettingsEdits.usda", 1.0, "render settings, camera"),
    (OPENUSD / "test_lbs.usda", 5.0, "linear blend skinning"),
    (OPENUSD / "test_dqs.usda", 5.0, "dual quaternion skinning"),
    (OPENUSD / "skelBake" / "blendshapes.usda", 3.0, "blend shapes"),
    (VEHICLES / "sedan" / "asset" / "sedanFullAsset.usda", 1.0, "materials"),
    (VEHICLES / "tractor" / "asset" / "tractorFullAsset.usda", 1.0, "materials"),
    (VEHICLES / "vehicleVariants.usda", 1.0, "variants"),
)


def box_of(stage: Usd.Stage, time: float) -> tuple[Gf.Vec3d, float]:
    """Return the centre of the floor of everything drawn, and its size."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode(time), ["default", "render"])
    box = cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    return box.GetMidpoint(), max(box.GetSize())


def with_capture(path: Path, capture: Path, time: float) -> Usd.Stage:
    """Return the stage with an upright capture in front of it to the right."""
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths.append(str(path))
    source = Usd.Stage.Open(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(source))
    stage.SetTimeCodesPerSecond(source.GetTimeCodesPerSecond())
    middle, size = box_of(stage, time)
    scan = UsdGeom.Xform.Define(stage, "/Scan")
    scan.GetPrim().GetReferences().AddReference(str(capture))
    up = UsdGeom.GetStageUpAxis(stage)
    right, scale = ELSEWHERE.get(path.stem, (SHIFT, SCALE))
    shift = Gf.Vec3d(right, 0, 0.35) if up == "Y" else Gf.Vec3d(right, -0.35, 0)
    scan.ClearXformOpOrder()
    scan.AddTranslateOp().Set(middle + shift * size)
    if up == "Z":
        scan.AddRotateXOp().Set(90.0)
    scan.AddScaleOp().Set(Gf.Vec3f(size * scale))
    return stage


def picture(path: Path, capture: Path, time: float) -> np.ndarray:
    """Draw one stage over a plain background, display-referred, shape (h, w, 3)."""
    stage = with_capture(path, capture, time)
    with Engine(stage, time=time) as engine:
        cameras = engine.cameras()
        view = engine.view(cameras[0] if cameras else None, resolution=SIZE)
        samples = 16
        if path.name == "motionBlur.usda":
            camera = engine.framing_camera([time], framing=view.framing)
            camera = replace(camera, shutter=(-0.5, 0.5))
            view, samples = View(camera=camera, framing=view.framing), 32
        for warning in engine.warnings:
            print(f"  {path.name}: {warning[:150]}")
        color = engine.picture(view, RenderSettings(color_mode="display", samples=samples))["color"]
    return color[..., :3] + (1 - color[..., 3:]) * np.float32(BACKGROUND)


def main(sheet: Path) -> None:
    """Draw the sheet."""
    rows = -(-len(STAGES) // COLUMNS)
    width, height = SIZE
    image = np.zeros((rows * height, COLUMNS * width, 3), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        capture = Path(folder) / "scan.usdc"
        import_capture(DATA / "splats" / "statue_angel.sog", capture)
        for i, (path, time, _) in enumerate(STAGES):
            y, x = i // COLUMNS * height, i % COLUMNS * width
            image[y : y + height, x : x + width] = picture(path, capture, time)
    buffer = oiio.ImageBuf(np.ascontiguousarray(np.clip(image, 0, 1)))
    for i, (path, _, what) in enumerate(STAGES):
        y, x = i // COLUMNS * height, i % COLUMNS * width
        text = f"{path.stem}: {what}"
        oiio.ImageBufAlgo.render_text(buffer, x + 10, y + height - 12, text, 16)
    half = oiio.ImageBufAlgo.resize(
        buffer, roi=oiio.ROI(0, image.shape[1] * 3 // 4, 0, image.shape[0] * 3 // 4, 0, 1, 0, 3)
    )
    half.set_write_format("uint8")
    half.specmod().attribute("Compression", "jpeg:80")
    half.write(str(sheet))
    print(f"{sheet}: {sheet.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs") / "stages.jpg")
