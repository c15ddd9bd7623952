"""A colour chart made of splats: 24 flat, opaque patches of known colours in front of a camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.sh import rgb_to_dc
from usdsplat.delegate.engine import Engine
from usdsplat.images.science import colour_science
from usdsplat.render.settings import RenderSettings

COLUMNS, ROWS = 6, 4
PITCH = 16
"""[pixel] from one patch to the next."""
SIZE = (COLUMNS * PITCH, ROWS * PITCH)
LAYERS = 8
"""Splats of each patch, one behind the other, so that it is opaque over more than a point."""
FIELD, CAMERA = "/World/Chart", "/World/Cam"


def chart_linear() -> F64:
    """The ColorChecker under D65, linear Rec.709, by colour-science alone; shape (24, 3)."""
    colour = colour_science()
    data = colour.CCS_COLOURCHECKERS["ColorChecker24 - After November 2014"]
    xyz = colour.xyY_to_XYZ(np.array(list(data.data.values())))
    rgb: F64 = colour.XYZ_to_RGB(
        xyz, "sRGB", data.illuminant, chromatic_adaptation_transform="Bradford"
    )
    return rgb


def chart_codes() -> F64:
    """What a camera that is balanced for D65 writes of it: sRGB code values, shape (24, 3)."""
    codes: F64 = colour_science().models.eotf_inverse_sRGB(np.clip(chart_linear(), 0.0, 1.0))
    return codes


def chart_cloud(codes: F64) -> SplatCloud:
    """Discs in the plane z = 0, the first at the top left; none of them touches another."""
    n = len(codes) * LAYERS
    patch, layer = np.divmod(np.arange(n), LAYERS)
    row, column = np.divmod(patch, COLUMNS)
    centers = (column + 0.5 - COLUMNS / 2, ROWS / 2 - row - 0.5, -1e-4 * layer)
    return SplatCloud(
        positions=np.stack(centers, axis=1).astype(np.float32),
        scales=np.tile(np.float32((0.12, 0.12, 1e-3)), (n, 1)),
        rotations=np.tile(np.float32((1, 0, 0, 0)), (n, 1)),
        opacities=np.ones(n, np.float32),
        sh=rgb_to_dc(codes[patch]).reshape(n, 1, 3).astype(np.float32),
    )


def chart_stage(stage: Usd.Stage | None = None, *, codes: F64 | None = None) -> Usd.Stage:
    """A stage with the chart as a capture, and a camera that sees just it."""
    stage = stage or Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, FIELD, chart_cloud(chart_codes() if codes is None else codes))
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 20))
    camera.CreateFocalLengthAttr(20.0)
    camera.CreateHorizontalApertureAttr(COLUMNS)
    camera.CreateVerticalApertureAttr(ROWS)
    camera.CreateClippingRangeAttr(Gf.Vec2f(1, 100))
    return stage


def regions() -> list[tuple[int, int, int, int]]:
    """Four by four pixels in the middle of each patch."""
    centers = [(PITCH * c + 8, PITCH * r + 8) for r in range(ROWS) for c in range(COLUMNS)]
    return [(x - 2, y - 2, x + 2, y + 2) for x, y in centers]


def picture(stage: Usd.Stage, **settings: Any) -> F32:
    """The camera's picture, premultiplied."""
    with Engine(stage) as engine:
        view = engine.view(CAMERA, resolution=SIZE)
        return np.array(engine.picture(view, RenderSettings(**settings))["color"])


def patches(image: F32) -> F64:
    """The straight colours of the patches in a picture, shape (24, 3)."""
    found = []
    for x0, y0, x1, y1 in regions():
        pixels = image[y0:y1, x0:x1].reshape(-1, 4).astype(np.float64)
        assert pixels[:, 3].min() > 0.98, "a patch is not opaque"
        found.append((pixels[:, :3] / pixels[:, 3:]).mean(axis=0))
    return np.array(found)


def delta_e(first: F64, second: F64) -> F64:
    """CIE 2000 differences of linear Rec.709 colours, by colour-science alone."""
    colour = colour_science()
    space = colour.RGB_COLOURSPACES["sRGB"]
    labs = [
        colour.XYZ_to_Lab(rgb @ space.matrix_RGB_to_XYZ.T, space.whitepoint)
        for rgb in (first, second)
    ]
    difference: F64 = colour.difference.delta_E_CIE2000(*labs)
    return difference
