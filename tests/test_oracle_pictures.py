"""Tests of the whole way from a capture file to a stage to the reference picture."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.cli.main import main
from usdsplat.interchange import import_capture
from usdsplat.interchange.options import ImportOptions

CAPTURES = ("statue_angel.sog", "playbot_lod2.sog", "flowers_lod2_0.sog", "pod.spz")


def add_camera(stage, path, view, k, size):
    """Author an OpenCV camera of the capture's own frame as a USD camera in the world."""
    (field,) = (prim for prim in stage.Traverse() if schema.is_splat_field(prim))
    to_world = np.array(UsdGeom.Imageable(field).ComputeLocalToWorldTransform(0)).T
    camera_to_world = to_world @ np.linalg.inv(view.astype(np.float64)) @ np.diag([1, -1, -1, 1])
    camera = UsdGeom.Camera.Define(stage, path)
    camera.AddTransformOp().Set(Gf.Matrix4d(*camera_to_world.T.ravel().tolist()))
    camera.CreateFocalLengthAttr(50.0)
    camera.CreateHorizontalApertureAttr(float(50.0 * size[0] / k[0, 0]))
    camera.CreateVerticalApertureAttr(float(50.0 * size[1] / k[1, 1]))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1e6))


@pytest.mark.parametrize("form", ["float", "half", "packed"])
@pytest.mark.parametrize("name", CAPTURES)
def test_a_capture_becomes_its_reference_picture(data, tmp_path, name, form):
    """Oracle: gsplat 1.5.3 on CUDA, two views classic, one antialiased; packed loses a little."""
    oracle = np.load(data / "oracle" / "images" / f"{name.split('.')[0]}.npz")
    size = int(oracle["width"]), int(oracle["height"])
    shot = tmp_path / "shot.usdc"
    import_capture(data / "splats" / name, shot, options=ImportOptions(form=form))
    stage = Usd.Stage.Open(str(shot))
    for i, view in enumerate(oracle["viewmats"]):
        add_camera(stage, f"/World/view{i}", view, oracle["K"], size)
    stage.Save()
    for mode, i in (("classic", 0), ("classic", 1), ("antialiased", 0)):
        out = tmp_path / f"{mode}{i}.exr"
        arguments = [
            "render", str(shot), "-o", str(out), "--camera", f"/World/view{i}",
            "--resolution", f"{size[0]}x{size[1]}", "--color-mode", "display", "--float",
            "--rasterize-mode", mode,
        ]  # fmt: skip
        assert main(arguments) == 0
        pixels = oiio.ImageBuf(str(out)).get_pixels(oiio.FLOAT)
        error = np.abs(pixels[..., :3] - oracle[f"{mode}_rgb"][i].astype(np.float64))
        psnr = -10 * np.log10(np.mean(error**2))
        assert psnr >= (45 if form == "packed" else 60), f"{mode} view {i}: {psnr:.1f} dB"
        if form == "float":
            assert error.max() <= 0.1
            assert np.abs(pixels[..., 3] - oracle[f"{mode}_alpha"][i]).mean() < 1e-3
        print(f"{name} {form} {mode} view {i}: {psnr:.1f} dB, worst {error.max():.4f}")
