"""Read UsdLux lights: distant, sphere, disk, rect, cylinder and dome lights."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from usdsplat.core.cloud import F64
from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.delegate.scene_delegate import collections
from usdsplat.delegate.scene_delegate.domes import dome_to_world
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.render.lights.dome import strongest_light
from usdsplat.render.lights.sampling import area
from usdsplat.render.lights.specs import (
    EVERYTHING,
    DomeSky,
    LightKind,
    LightSpec,
    Rules,
    Shadow,
    Shaping,
    Vector,
)
from usdsplat.schema.stage_values import local_to_world

KINDS: tuple[tuple[Any, LightKind, tuple[str, ...]], ...] = (
    (UsdLux.SphereLight, "sphere", ("inputs:radius",)),
    (UsdLux.DiskLight, "disk", ("inputs:radius",)),
    (UsdLux.RectLight, "rect", ("inputs:width", "inputs:height")),
    (UsdLux.CylinderLight, "cylinder", ("inputs:radius", "inputs:length")),
)
"""Type of a light with an area, our kind, and the attributes with its size."""

BRIGHTEST = float(np.float32(1e30))
"""Highest strength of a light, so that sums of lights are finite."""
FARTHEST = 1e6
"""Distance at which an area light may still light a white surface to the largest number of a half
picture [scene unit]."""

SEEN: dict[LightKind, float] = {"sphere": 0.25, "cylinder": 1 / math.pi, "disk": 1.0, "rect": 1.0}
"""Largest part of the area of a light that is seen from far away: its projection."""


def read_light(
    prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache, sky: DomeSky | None = None
) -> LightSpec:
    """Read a light at a time.

    Args:
        sky: Picture of a dome light; None for other lights.

    Raises:
        StageError: If its numbers or its transform are invalid.
    """
    if sky is not None:
        return _read_dome(prim, time, cache, sky)
    for schema, kind, names in KINDS:
        if prim.IsA(schema):
            return _read_area(prim, time, cache, kind, names)
    return _read_distant(prim, time, cache)


def finding_on_brightness(where: str, light: LightSpec) -> Finding | None:
    """Return a finding on a light that is negative, or probably too bright by mistake, or None.

    Distant lights and domes are compared with the largest number of a half picture, which a white
    surface that faces them must not pass. How far surfaces are from other lights is not known here,
    so these are compared at a distance of `FARTHEST`. What is negative is drawn as 0.
    """
    if min(light.irradiance if light.kind == "distant" else light.radiance) < 0:
        return finding("negative-light", where, "a negative strength", "0 or more")
    if light.kind == "distant":
        level, most = max(light.irradiance), HALF_MAX
        where_lit = "on a white surface that faces it"
    elif light.sky is not None:
        level, most = strongest_light(light), HALF_MAX
        where_lit = "on a white surface that faces its light"
    else:
        linear = np.array(light.to_world).reshape(4, 4)[:3, :3]
        seen = SEEN[light.kind] * (area(light.kind, light.size, linear) or 1.0)
        level, most = max(light.radiance) * seen / math.pi, HALF_MAX * FARTHEST**2
        where_lit = "at a distance of 1"
    if level <= most:
        return None
    # the amount is not part of what was found, which is said once for all frames
    found, expected = f"too much light {where_lit}", f"at most {most:g}, not {level:.3g}"
    return finding("extreme-light", where, found, expected)


def _read_distant(prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache) -> LightSpec:
    """Read direction and irradiance of a DistantLight.

    Source: UsdLux's documentation of `intensity`, `exposure`, `angle` and `normalize`. A light
    without `normalize` is a disc in the sky with the authored radiance, so E = L π sin²(angle / 2).
    A light with it, or without an angle, has E = L on a surface that faces it.
    """
    light = UsdLux.DistantLight(prim)
    angle = math.radians(_number(light.GetAngleAttr(), time))
    strength, color = _emission(prim, time)
    with np.errstate(all="ignore"):
        if angle != 0 and not light.GetNormalizeAttr().Get(time):
            strength *= math.pi * math.sin(min(abs(angle), math.pi) / 2) ** 2
        found = strength * color / math.pi
    _check(prim, found)
    return LightSpec(
        direction=_axis(prim, column_matrix(local_to_world(prim, cache))),
        irradiance=_vector(found),
        angle=abs(angle),
        shadow=_shadow(prim, time),
        linked=_rules(prim, "lightLink"),
        casters=_rules(prim, "shadowLink"),
    )


def _read_area(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    cache: UsdGeom.XformCache,
    kind: LightKind,
    names: tuple[str, ...],
) -> LightSpec:
    """Read a light with an area.

    Source: UsdLux's documentation: its radiance is the authored one, or with `normalize` that
    divided by the area in the world. A light without an area is dark without `normalize`.
    """
    matrix = column_matrix(local_to_world(prim, cache))
    sizes = [abs(_number(prim.GetAttribute(name), time)) for name in names]
    size = (sizes[0], sizes[-1] if len(sizes) > 1 else 0.0)
    strength, color = _emission(prim, time)
    with np.errstate(all="ignore"):
        surface = area(kind, size, matrix[:3, :3])
        if UsdLux.LightAPI(prim).GetNormalizeAttr().Get(time):
            strength /= surface or 1.0
        elif surface == 0.0:
            strength = np.float64(0.0)
        radiance = strength * color
    with np.errstate(all="ignore"):
        _check(prim, np.append(radiance * (surface or 1.0), surface))
    as_point = prim.GetAttribute("treatAsPoint")
    return LightSpec(
        kind=kind,
        to_world=tuple(matrix.ravel().tolist()),
        size=size,
        radiance=_vector(radiance),
        is_point=bool(as_point and as_point.Get(time)),
        axis=_axis(prim, matrix),
        shaping=_shaping(prim, time),
        shadow=_shadow(prim, time),
        linked=_rules(prim, "lightLink"),
        casters=_rules(prim, "shadowLink"),
    )


def _read_dome(
    prim: Usd.Prim, time: Usd.TimeCode, cache: UsdGeom.XformCache, sky: DomeSky
) -> LightSpec:
    """Read a dome light. `normalize` has no effect on it, as UsdLux says."""
    strength, color = _emission(prim, time)
    with np.errstate(all="ignore"):
        radiance = strength * color
    _check(prim, radiance)
    return LightSpec(
        kind="dome",
        to_world=tuple(dome_to_world(prim, cache).ravel().tolist()),
        radiance=_vector(radiance),
        sky=sky,
        shadow=_shadow(prim, time),
        linked=_rules(prim, "lightLink"),
        casters=_rules(prim, "shadowLink"),
    )


def _emission(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[np.float64, F64]:
    """Return intensity × 2^exposure × diffuse of a light, and its colour."""
    light = UsdLux.LightAPI(prim)
    color = _numbers(light.GetColorAttr(), time, 3)
    with np.errstate(all="ignore"):
        if light.GetEnableColorTemperatureAttr().Get(time):
            # For NaN, USD would read out of bounds, so `_number` checks first.
            kelvin = _number(light.GetColorTemperatureAttr(), time)
            color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), np.float64)
        strength = np.float64(_number(light.GetIntensityAttr(), time))
        strength *= np.exp2(_number(light.GetExposureAttr(), time))
        strength *= _number(light.GetDiffuseAttr(), time)
    return strength, color


def _shaping(prim: Usd.Prim, time: Usd.TimeCode) -> Shaping:
    """Read focus and cone; the profile of an IES file is a finding, see `unsupported`."""
    if not prim.HasAPI(UsdLux.ShapingAPI):
        return Shaping()
    api = UsdLux.ShapingAPI(prim)
    angle = math.radians(_number(api.GetShapingConeAngleAttr(), time))
    return Shaping(
        focus=_number(api.GetShapingFocusAttr(), time),
        tint=_vector(_numbers(api.GetShapingFocusTintAttr(), time, 3)),
        angle=min(abs(angle), math.pi),
        softness=_number(api.GetShapingConeSoftnessAttr(), time),
    )


def _shadow(prim: Usd.Prim, time: Usd.TimeCode) -> Shadow:
    if not prim.HasAPI(UsdLux.ShadowAPI):
        return Shadow()
    api = UsdLux.ShadowAPI(prim)
    return Shadow(
        enable=bool(api.GetShadowEnableAttr().Get(time)),
        color=_vector(_numbers(api.GetShadowColorAttr(), time, 3)),
        distance=_number(api.GetShadowDistanceAttr(), time),
        falloff=max(0.0, _number(api.GetShadowFalloffAttr(), time)),
        gamma=_number(api.GetShadowFalloffGammaAttr(), time),
    )


def _rules(prim: Usd.Prim, name: str) -> Rules:
    """Return the rules of a light's collection: which prims it lights or shadows."""
    collection = Usd.CollectionAPI(prim, name)
    relationships = (collection.GetIncludesRel(), collection.GetExcludesRel())
    is_linked = any(each and each.HasAuthoredTargets() for each in relationships)
    includes_root = collection.GetIncludeRootAttr()
    has_root = not includes_root or includes_root.Get() is not False
    if has_root and not is_linked:
        return EVERYTHING
    found = collections.rules(prim.GetStage(), [collection])
    return (*EVERYTHING, *found) if has_root else found


def _axis(prim: Usd.Prim, matrix: F64) -> Vector:
    """Return the unit vector along which a light points, −z of its transform."""
    ray = -matrix[:3, 2]
    length = float(np.linalg.norm(ray))
    if not (math.isfinite(length) and length > 0):
        where, expected = str(prim.GetPath()), "an invertible transform"
        raise StageError(where, "a transform without a direction", expected)
    return _vector(ray / length)


def _check(prim: Usd.Prim, found: F64) -> None:
    where = str(prim.GetPath())
    if not np.isfinite(found).all():
        raise StageError(where, "a light with a strength that is not finite", "finite numbers")
    if np.abs(found).max() > BRIGHTEST:
        found_text = f"a light with a strength of {np.abs(found).max():.3g}"
        raise StageError(where, found_text, f"at most {BRIGHTEST:g}")


def _vector(numbers: F64) -> Vector:
    x, y, z = numbers.tolist()
    return x, y, z


def _number(attribute: Usd.Attribute, time: Usd.TimeCode) -> float:
    return float(_numbers(attribute, time, 1)[0])


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
