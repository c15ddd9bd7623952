"""Read UsdGeomPoints in the renderer's form: each point is a round splat.

A splat of opacity 1 is half transparent at the radius of its point. Widths, colours and opacities
may be constant or per point, and colours and opacities may be inherited. `primvars:widths` has
precedence over `widths`, as in UsdGeomPoints.
"""

from __future__ import annotations

import math

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.sh import C0
from usdsplat.images.color import color_space, convert
from usdsplat.render.specs import FieldSpec
from usdsplat.schema import attributes, tokens
from usdsplat.schema.values import integers, value, vectors

SIGMA = 0.5 / math.sqrt(2 * math.log(2))
"""Standard deviation of the splat that draws a point, divided by the width of the point."""

DEFAULT_WIDTH = 1.0
"""Width of points without one [scene unit]."""
DEFAULT_COLOR = 0.18
"""Linear colour of points without one: the grey of surfaces."""
LINEAR = "lin_rec709_scene"
"""Colour space of a displayColor that names none."""

POINTS, WIDTHS = "points", "widths"
COLOR, OPACITY = "displayColor", "displayOpacity"
PROPERTIES = (POINTS, WIDTHS, f"primvars:{WIDTHS}", tokens.IDS, tokens.VELOCITIES)
"""Own properties that points are read from."""

_PER_POINT = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)


def is_points(prim: Usd.Prim) -> bool:
    """Return whether a prim is UsdGeomPoints."""
    return bool(prim.IsA(UsdGeom.Points))


def read_points(prim: Usd.Prim, time: float | None) -> FieldSpec | None:
    """Read points as splats; None if there are none at this time.

    Raises:
        UsdSplatError: If they cannot be drawn.
    """
    code = _code(prim, time)
    try:
        positions, velocities = attributes.centres(prim, POINTS, code, time)
        ids = attributes.ids(prim, code, len(positions))
    except (TypeError, ValueError) as error:
        found = f"attributes of other types than the schema's ({error})"
        raise StageError(str(prim.GetPath()), found, "those of UsdGeomPoints") from error
    n = len(positions)
    if not n:
        return None
    positions = vectors(f"{prim.GetPath()}.{POINTS}", positions, 3)
    widths = _widths(prim, code, n)
    cloud = SplatCloud(
        positions=positions,
        scales=np.repeat(np.float32(SIGMA) * widths, 3, axis=1),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        opacities=np.clip(_primvar(prim, OPACITY, 1, code, n, 1.0)[:, 0], 0, 1),
        sh=_harmonics(prim, code, n),
        ids=ids,
        velocities=velocities,
    )
    return FieldSpec(cloud=cloud, rasterize_mode="antialiased")


def are_points_varying(prim: Usd.Prim) -> bool:
    """Return whether `read_points` may return different splats at different times."""
    if attributes.have_velocities(prim):
        return True
    found = [prim.GetAttribute(name) for name in PROPERTIES]
    api = UsdGeom.PrimvarsAPI(prim)
    inherited = [api.FindPrimvarWithInheritance(name) for name in (COLOR, OPACITY)]
    for primvar in (api.GetPrimvar(WIDTHS), *inherited):
        if primvar:
            found += [primvar.GetAttr(), primvar.GetIndicesAttr()]
    return any(each and each.ValueMightBeTimeVarying() for each in found)


def _code(prim: Usd.Prim, time: float | None) -> Usd.TimeCode:
    """Return the time at which to read; None is the default value or else the first sample."""
    if time is not None:
        return attributes.time_code(prim, time)
    has_default = prim.GetAttribute(POINTS).Get() is not None
    return Usd.TimeCode.Default() if has_default else Usd.TimeCode.EarliestTime()


def _widths(prim: Usd.Prim, code: Usd.TimeCode, n: int) -> F32:
    """Return the width of each point [scene unit], shape (n, 1)."""
    if UsdGeom.PrimvarsAPI(prim).GetPrimvar(WIDTHS).HasAuthoredValue():
        where = f"{prim.GetPath()}.primvars:{WIDTHS}"
        widths = _primvar(prim, WIDTHS, 1, code, n, DEFAULT_WIDTH)
    else:
        where = f"{prim.GetPath()}.{WIDTHS}"
        values = vectors(where, value(prim.GetAttribute(WIDTHS), code), 1)
        if not len(values):
            return np.full((n, 1), DEFAULT_WIDTH, np.float32)
        constant = UsdGeom.Points(prim).GetWidthsInterpolation() not in _PER_POINT
        widths = _each_point(where, values, n, constant=constant)
    if (widths < 0).any():
        raise StageError(where, "a negative width", "widths of 0 or more")
    return widths


def _harmonics(prim: Usd.Prim, code: Usd.TimeCode, n: int) -> F32:
    """Return the colours as harmonics of degree 0 in the default training space."""
    linear = _primvar(prim, COLOR, 3, code, n, DEFAULT_COLOR)
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(COLOR)
    space = LINEAR
    if primvar and primvar.GetAttr().HasColorSpace():
        space = str(primvar.GetAttr().GetColorSpace())
        space = tokens.COLOR_SPACE_ALIASES.get(space, space)
        color_space(space, where=f"{prim.GetPath()}.primvars:{COLOR} color space")
    colors = convert(linear, space, tokens.DEFAULT_COLOR_SPACE)
    return ((colors - 0.5) / C0).astype(np.float32).reshape(n, 1, 3)


def _primvar(
    prim: Usd.Prim, name: str, width: int, code: Usd.TimeCode, n: int, fallback: float
) -> F32:
    """Return a primvar at each point, own or inherited, shape (n, width)."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    found = value(primvar.GetAttr(), code) if primvar else None
    where = f"{prim.GetPath()}.primvars:{name}"
    if found is None:
        return np.full((n, width), fallback, np.float32)
    values = vectors(where, found if primvar.GetTypeName().isArray else [found], width)
    if primvar.IsIndexed():
        rows = integers(f"{where}:indices", value(primvar.GetIndicesAttr(), code))
        if ((rows < 0) | (rows >= len(values))).any():
            raise StageError(f"{where}:indices", "an index outside the values", "a valid one")
        values = values[rows]
    if not len(values):
        return np.full((n, width), fallback, np.float32)
    constant = str(primvar.GetInterpolation()) not in _PER_POINT
    return _each_point(where, values, n, constant=constant)


def _each_point(where: str, values: F32, n: int, *, constant: bool) -> F32:
    """Return values for n points: the first for all, or one for each."""
    if constant or (len(values) == 1 and n == 1):
        return np.repeat(values[:1], n, axis=0)
    if len(values) < n:
        raise StageError(where, f"{len(values)} values", f"{n}, one for each point")
    return values[:n]
