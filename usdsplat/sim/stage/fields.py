"""Read splat fields: the capture at rest, and primvars on its splats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.schema.tree_cuts import TreeReading
from usdsplat.schema.values import value, vectors

SELECTION = "splatSim:weight"
"""Primvar with the selection weight of splats."""


def read_rest(
    prim: Usd.Prim, start: Usd.TimeCode, cut: TreeReading | None = None
) -> tuple[SplatCloud, list[Finding]]:
    """Return the capture at the start, in its own space, and findings about it. That of a splat
    tree is a cut.

    Ids that do not ascend are dropped: a simulation orders splats by id and by row, which must
    agree.

    Raises:
        UsdSplatError: If it cannot be read, has no splats, or some that are not finite.
    """
    where = str(prim.GetPath())
    cloud = schema.fetch(prim, start) if cut is None else cut.cloud()
    if not len(cloud):
        raise StageError(where, "no splats", "at least one splat")
    numbers = (cloud.positions, cloud.scales, cloud.rotations, cloud.opacities[:, None])
    wrong = ~np.all([np.isfinite(each).all(axis=1) for each in numbers], axis=0)
    if wrong.any():
        found = f"{wrong.sum()} splats with numbers that are not finite"
        raise StageError(where, found, "finite ones")
    if cloud.ids is not None and (np.diff(cloud.ids) <= 0).any():
        expected = "ascending ids; the ids are ignored"
        code, found = "left-out-of-simulation", "ids that do not ascend"
        return replace(cloud, ids=None), [finding(code, f"{where}.ids", found, expected)]
    return cloud, []


def read_selection(prim: Usd.Prim, count: int, start: Usd.TimeCode) -> F32 | None:
    """Return the selection weight of `count` splats, shape (n,), 0 to 1; None where all are
    selected.

    Raises:
        StageError: If there are not as many numbers as splats, or one is out of range.
    """
    found = per_splat(prim, SELECTION, count, start)
    if found is not None and not ((found >= 0) & (found <= 1)).all():
        wrong = found[(found < 0) | (found > 1)][0]
        raise StageError(f"{prim.GetPath()}.primvars:{SELECTION}", f"{wrong:g}", "0 to 1")
    return found


def per_splat(prim: Usd.Prim, name: str, count: int, time: Usd.TimeCode) -> F32 | None:
    """Return a primvar of `count` splats, shape (n,); None where there is none.

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
    """Return the error that a primvar named by an attribute is missing on the field."""
    found = f"{primvar!r}, which does not exist"
    return StageError(f"{prim.GetPath()}.{name}", found, f"a primvar of {field.GetPath()}")
