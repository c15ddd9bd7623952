"""UsdLux lights that are infinitely far away."""

from __future__ import annotations

import math

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from usdsplat.core.errors import StageError
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.delegate.specs import LightSpec


def read_light(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> LightSpec:
    """Return what the DistantLight `prim` sends out at `time`, and where to.

    Source: UsdLux's documentation of `intensity`, `exposure`, `angle` and `normalize`. A light
    without `normalize` is a disc in the sky of the radiance authored, so E = L π sin²(angle / 2);
    one with it, or without an angle, lights a surface that faces it as if E = L.

    Raises:
        StageError: If its numbers or its transform are not usable.
    """
    where = str(prim.GetPath())
    light = UsdLux.DistantLight(prim)
    color = np.array(light.GetColorAttr().Get(time), np.float64)
    if light.GetEnableColorTemperatureAttr().Get(time):
        kelvin = light.GetColorTemperatureAttr().Get(time)
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), np.float64)
    angle = math.radians(light.GetAngleAttr().Get(time))
    with np.errstate(all="ignore"):
        strength = np.float64(light.GetIntensityAttr().Get(time))
        strength *= np.exp2(np.float64(light.GetExposureAttr().Get(time)))
        strength *= light.GetDiffuseAttr().Get(time)
        if angle != 0 and not light.GetNormalizeAttr().Get(time):
            strength *= math.pi * math.sin(min(abs(angle), math.pi) / 2) ** 2
        found = strength * color / math.pi
        ray = -column_matrix(cache.GetLocalToWorldTransform(prim))[:3, 2]
        length = float(np.linalg.norm(ray))
    if not np.isfinite(found).all():
        raise StageError(where, "a light of no finite strength", "finite numbers")
    if not (math.isfinite(length) and length > 0):
        raise StageError(where, "a transform that leaves no direction", "one that can be undone")
    x, y, z = (ray / length).tolist()
    red, green, blue = found.tolist()
    return LightSpec(direction=(x, y, z), irradiance=(red, green, blue))
