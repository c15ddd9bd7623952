"""Splat fields: the capture at rest, and numbers that lie on its splats."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.schema.values import value, vectors

SELECTION = "splatSim:weight"
"""The primvar that selects splats."""


def read_rest(prim: Usd.Prim, start: Usd.TimeCode) -> SplatCloud:
    """The capture as it is at the start, in its own space.

    Raises:
        UsdSplatError: If it cannot be read, or holds no splats.
    """
    cloud = schema.fetch(prim, start)
    if not len(cloud):
        raise StageError(str(prim.GetPath()), "no splats", "some to simulate")
    return cloud


def read_selection(prim: Usd.Prim, count: int, start: Usd.TimeCode) -> F32 | None:
    """How far each of `count` splats takes part, shape (n,), 0 to 1; None where all do.

    Raises:
        StageError: If there are not as many numbers as splats, or one is none of these.
    """
    found = per_splat(prim, SELECTION, count, start)
    if found is not None and not ((found >= 0) & (found <= 1)).all():
        wrong = found[(found < 0) | (found > 1)][0]
        raise StageError(f"{prim.GetPath()}.primvars:{SELECTION}", f"{wrong:g}", "0 to 1")
    return found


def per_splat(prim: Usd.Prim, name: str, count: int, time: Usd.TimeCode) -> F32 | None:
    """A primvar of numbers for each of `count` splats, shape (n,); None where there is none.

    Raises:
        StageError: If there are neither one nor as many numbers as splats.
    """
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    found = value(primvar.GetAttr(), time) if primvar else None
    if found is None:
        return None
    where = f"{prim.GetPath()}.primvars:{name}"
    if primvar.IsIndexed():
        found = primvar.ComputeFlattened(time)
    numbers = vectors(where, found if primvar.GetTypeName().isArray else [found], 1)[:, 0]
    if len(numbers) not in (1, count):
        raise StageError(where, f"{len(numbers)} numbers", f"{count}, one for each splat, or 1")
    return np.ascontiguousarray(np.broadcast_to(numbers, (count,)))


def missing(prim: Usd.Prim, name: str, primvar: str, field: Usd.Prim) -> StageError:
    """That a primvar which an attribute names is not on the field."""
    found = f"{primvar!r}, which is not there"
    return StageError(f"{prim.GetPath()}.{name}", found, f"a primvar of {field.GetPath()}")
