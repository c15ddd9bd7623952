"""Compute transforms, visibility and purpose, which prims inherit from their ancestors.

In the world these are USD's own rules. Inside a prototype of a point instancer, inheritance ends at
the prototype's root, including its own transform, and continues at the instancer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.delegate.scene_delegate.population import Appearance, Level
from usdsplat.schema.stage_values import local_to_ancestor, local_to_world


def column_matrix(matrix: Gf.Matrix4d) -> F64:
    """Convert a Gf matrix, for row vectors, to one for column vectors, shape (4, 4)."""
    return np.array(matrix, np.float64).T


def transforms(
    appearance: Appearance, frame: Usd.Prim, cache: UsdGeom.XformCache
) -> tuple[F64, ...]:
    """Return the matrices of an appearance's levels, as in `SceneDelegate.transforms`.

    The last one is that of `frame`, which replaces the prim: a skeleton for a mesh with joints.

    Raises:
        StageError: If USD does not know one of the transform ops.
    """
    *outer, last = appearance.levels
    levels = (*outer, replace(last, prim=frame))
    return tuple(column_matrix(_to_frame(level, cache)) for level in levels)


def _to_frame(level: Level, cache: UsdGeom.XformCache) -> Gf.Matrix4d:
    if level.root is None:
        return local_to_world(level.prim, cache)
    return local_to_ancestor(level.prim, level.root.GetParent(), cache)


def is_visible(
    appearance: Appearance, time: Usd.TimeCode, shown: frozenset[Sdf.Path] = frozenset()
) -> bool:
    """Return whether nothing hides an appearance; `shown` are items of LOD roots, whose own
    visibility is ignored."""
    prims = (prim for level in appearance.levels for prim in level.lineage())
    return not any(_hides(prim, time) and prim.GetPath() not in shown for prim in prims)


def _hides(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    imageable = UsdGeom.Imageable(prim)
    return bool(imageable) and imageable.GetVisibilityAttr().Get(time) == UsdGeom.Tokens.invisible


def purpose(appearance: Appearance) -> str:
    """Return the purpose of an appearance: the nearest authored one, from the rprim outwards."""
    for level in reversed(appearance.levels):
        for prim in level.lineage():
            imageable = UsdGeom.Imageable(prim)
            if imageable and imageable.GetPurposeAttr().HasAuthoredValue():
                return str(imageable.GetPurposeAttr().Get())
    return str(UsdGeom.Tokens.default_)
