"""Read and write the normals of splats, their confidence and their occlusion, as primvars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat.core.cloud import F32
from usdsplat.schema import attributes, tokens
from usdsplat.schema.attributes import Time
from usdsplat.schema.vt import as_float32, to_vt

_Type = Sdf.ValueTypeNames


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfacePrimvars:
    """Values of n splats, in the order of the field's arrays. None if there is no such primvar."""

    normals: F32 | None
    """Unit vectors in the space of the prim, shape (n, 3)."""
    confidence: F32 | None
    """[0..1], shape (n,)."""
    occlusion: F32 | None
    """[0..1], shape (n,)."""


def author_surface(
    prim: Usd.Prim,
    *,
    normals: F32,
    confidence: F32,
    occlusion: F32,
    time: float | None = None,
) -> None:
    """Write the primvars of a splat field on the stage's edit target, in half precision.

    Args:
        prim: The field.
        normals: Unit vectors in the space of the prim, shape (n, 3).
        confidence, occlusion: [0..1], shape (n,).
        time: Time code of a sample; None writes the default values.
    """
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    for name, kind, vt_kind, values in (
        (tokens.NORMALS, _Type.Normal3hArray, Vt.Vec3hArray, normals),
        (tokens.CONFIDENCE, _Type.HalfArray, Vt.HalfArray, confidence),
        (tokens.OCCLUSION, _Type.HalfArray, Vt.HalfArray, occlusion),
    ):
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, UsdGeom.Tokens.vertex)
        primvar.Set(to_vt(values, vt_kind), code)


def has_normals(prim: Usd.Prim, *, moves: bool = False) -> bool:
    """Return whether a splat field has normals that follow its splats: a field with time samples,
    or of which it is known that it moves, needs samples of normals, too."""
    attribute = prim.GetAttribute(f"primvars:{tokens.NORMALS}")
    if not attribute or not attribute.HasAuthoredValue():
        return False
    if attribute.ValueMightBeTimeVarying():
        return True
    return not moves and not attributes.sample_times(prim, tokens.SHAPE_ATTRIBUTES)


def fetch_surface(prim: Usd.Prim, count: int, time: Time = None) -> SurfacePrimvars:
    """Read the primvars of a splat field.

    Longer arrays are truncated, shorter ones ignored, as the stock schema has it. Between samples,
    values are interpolated as `schema.fetch` does it.

    Args:
        prim: The field.
        count: Number of its splats at this time.
        time: As for `schema.fetch`.
    """
    code = attributes.time_code(prim, time)

    def values(name: str, shape: tuple[int, ...]) -> F32 | None:
        found = attributes.rows(attributes.array(prim, f"primvars:{name}", code), count)
        if found is None or found.shape != shape or found.dtype.kind != "f":
            return None
        return as_float32(np.asarray(found))

    return SurfacePrimvars(
        normals=_unit(values(tokens.NORMALS, (count, 3))),
        confidence=values(tokens.CONFIDENCE, (count,)),
        occlusion=values(tokens.OCCLUSION, (count,)),
    )


def _unit(vectors: F32 | None) -> F32 | None:
    """Return vectors of length 1; those without length or not finite become 0."""
    if vectors is None:
        return None
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    sound = np.isfinite(length) & (length > 0)
    return as_float32(np.where(sound, vectors, 0) / np.where(sound, length, 1))
