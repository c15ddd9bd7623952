"""Read UsdLux distant lights."""

from __future__ import annotations

import math

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.render.specs import LightSpec
from usdsplat.schema.stage_values import local_to_world


def read_light(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> LightSpec:
    """Read direction and irradiance of a DistantLight at a time.

    Source: UsdLux's documentation of `intensity`, `exposure`, `angle` and `normalize`. A light
    without `normalize` is a disc in the sky with the authored radiance, so E = L π sin²(angle / 2).
    A light with it, or without an angle, has E = L on a surface that faces it.

    Raises:
        StageError: If its numbers or its transform are invalid.
    """
    where = str(prim.GetPath())
    light = UsdLux.DistantLight(prim)

    def number(attribute: Usd.Attribute) -> float:
        return float(_numbers(attribute, time, 1)[0])

    color = _numbers(light.GetColorAttr(), time, 3)
    if light.GetEnableColorTemperatureAttr().Get(time):
        # For NaN, USD would read out of bounds, so `number` checks first.
        kelvin = number(light.GetColorTemperatureAttr())
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), np.float64)
    angle = math.radians(number(light.GetAngleAttr()))
    with np.errstate(all="ignore"):
        strength = np.float64(number(light.GetIntensityAttr()))
        strength *= np.exp2(number(light.GetExposureAttr()))
        strength *= number(light.GetDiffuseAttr())
        if angle != 0 and not light.GetNormalizeAttr().Get(time):
            strength *= math.pi * math.sin(min(abs(angle), math.pi) / 2) ** 2
        found = strength * color / math.pi
        ray = -column_matrix(local_to_world(prim, cache))[:3, 2]
        length = float(np.linalg.norm(ray))
    if not np.isfinite(found).all():
        raise StageError(where, "a light with a strength that is not finite", "finite numbers")
    if not (math.isfinite(length) and length > 0):
        raise StageError(where, "a transform without a direction", "an invertible transform")
    x, y, z = (ray / length).tolist()
    red, green, blue = found.tolist()
    return LightSpec(direction=(x, y, z), irradiance=(red, green, blue))


def _numbers(attribute: Usd.Attribute, time: Usd.TimeCode, width: int) -> F64:
    """Read one number or three, shape (width,)."""
    found = attribute.Get(time)
    try:
        numbers = np.array(found, np.float64).ravel()
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if len(numbers) != width or not np.isfinite(numbers).all():
        expected = "a finite number" if width == 1 else f"{width} finite numbers"
        raise StageError(str(attribute.GetPath()), repr(found), expected)
    return numbers
