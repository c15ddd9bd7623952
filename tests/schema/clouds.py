"""Clouds and prims for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat.core.cloud import SplatCloud
from usdsplat.schema import tokens

TYPES = {
    tokens.POSITIONS: Sdf.ValueTypeNames.Point3fArray,
    tokens.ORIENTATIONS: Sdf.ValueTypeNames.QuatfArray,
    tokens.SCALES: Sdf.ValueTypeNames.Float3Array,
    tokens.OPACITIES: Sdf.ValueTypeNames.FloatArray,
    tokens.SH_COEFFICIENTS: Sdf.ValueTypeNames.Float3Array,
}


def cloud(seed: int = 0, n: int = 40, degree: int = 3, moving: bool = False) -> SplatCloud:
    """A random cloud; `moving` ones have ids and velocities."""
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(n, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return SplatCloud(
        positions=rng.normal(size=(n, 3)).astype(np.float32),
        scales=np.exp(rng.normal(-2, 1, (n, 3))).astype(np.float32),
        rotations=rotations.astype(np.float32),
        opacities=rng.random(n).astype(np.float32),
        sh=rng.normal(size=(n, (degree + 1) ** 2, 3)).astype(np.float32),
        ids=rng.permutation(n).astype(np.int64) if moving else None,
        velocities=rng.normal(size=(n, 3)).astype(np.float32) if moving else None,
    )


def stock_prim(
    stage: Usd.Stage, values: dict[str, Any], type_name: str = tokens.STOCK_TYPE
) -> Usd.Prim:
    """A stock prim with these values, written with USD's own conversions only."""
    prim = stage.DefinePrim("/Splats", type_name)
    for name, value in values.items():
        kind = TYPES.get(name)
        attribute = prim.CreateAttribute(name, kind) if kind else prim.GetAttribute(name)
        attribute.Set(value)
    return prim


def three_points() -> Vt.Vec3fArray:
    """Centres for three splats."""
    return Vt.Vec3fArray([(1, 2, 3), (4, 5, 6), (7, 8, 9)])


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between the rotations of unit quaternions [radian], in float64."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    b = np.where(np.einsum("ni,ni->n", a, b)[:, None] < 0, -b, b)
    return 4 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=1) / 2, 1))
