"""Read the skies of dome lights: their axes and their pictures."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError, StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.wording import counted
from usdsplat.delegate.scene_delegate.placing import column_matrix
from usdsplat.delegate.scene_delegate.textures import read_asset
from usdsplat.render.lights.dome import plain_sky, split
from usdsplat.render.lights.specs import DomeSky
from usdsplat.schema.stage_values import local_to_world, up_axis

MOST_SKIES = 16
"""Number of pictures whose skies are kept, so that a dome that turns is not read again."""
FORMATS = ("automatic", "latlong")
"""The values of inputs:texture:format that domes support. "automatic" is read as "latlong"."""
STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation that turns the pole of a dome from y to z."""


class Skies:
    """Skies of pictures by resolved path. A file that changes on disk appears in the next
    engine."""

    def __init__(self) -> None:
        self._found: OrderedDict[str, tuple[DomeSky, int, int]] = OrderedDict()

    def clear(self) -> None:
        """Release all skies."""
        self._found.clear()

    def read(self, prim: Usd.Prim, time: Usd.TimeCode) -> tuple[DomeSky, tuple[Finding, ...]]:
        """Return the sky of a dome light, and findings on its picture.

        Raises:
            StageError: If the picture is not there, is none, or is not latlong.
        """
        attribute = prim.GetAttribute("inputs:texture:file")
        asset = attribute.Get(time) if attribute else None
        if not isinstance(asset, Sdf.AssetPath) or not asset.path:
            return plain_sky(), ()
        layout = prim.GetAttribute("inputs:texture:format")
        name = layout.Get(time) if layout else None
        if name not in (None, *FORMATS):
            raise StageError(str(layout.GetPath()), repr(name), " or ".join(FORMATS))
        key = asset.resolvedPath or asset.path
        if key in self._found:
            self._found.move_to_end(key)
        else:
            try:
                pixels = read_asset(asset, "auto")
            except FormatError as error:
                raise StageError(str(attribute.GetPath()), key, error.expected) from None
            self._found[key] = (*split(pixels), pixels.shape[0] * pixels.shape[1])
            while len(self._found) > MOST_SKIES:
                self._found.popitem(last=False)
        sky, wrong, count = self._found[key]
        if not wrong:
            return sky, ()
        found = f"{counted(wrong, 'pixel')} of {count} that are negative or not finite"
        return sky, (finding("bad-texels", str(attribute.GetPath()), found, "radiance"),)


def dome_to_world(prim: Usd.Prim, cache: UsdGeom.XformCache) -> F64:
    """Return dome to world, shape (4, 4). The pole of a dome is its y axis, or that of poleAxis.

    Raises:
        StageError: If the transform has no directions.
    """
    matrix = column_matrix(local_to_world(prim, cache))
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all() or np.linalg.matrix_rank(linear) < 3:
        raise StageError(
            str(prim.GetPath()), "a transform without a direction", "an invertible transform"
        )
    pole = prim.GetAttribute("poleAxis")
    axis = str(pole.Get()) if pole else "Y"
    if (up_axis(prim.GetStage()) if axis == "scene" else axis) == "Z":
        matrix[:3, :3] = linear @ STANDING
    return matrix
