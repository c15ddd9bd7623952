"""Group the prims and materials of a scene for each layer of Cryptomatte.

Kernels accumulate the coverage of each pixel by group. Coverage is therefore exact for every layer:
it is never the sum of ranks that were cut off before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.images.cryptomatte import object_hash
from usdsplat.render.fields import DrawnMesh, distinct_meshes
from usdsplat.render.specs import InstanceSpec

UNBOUND = "default"
"""Name of the group of everything without a bound material."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MatteGroups:
    """Groups of one layer of Cryptomatte."""

    names: tuple[str, ...]
    """Name of each group, sorted."""
    of_prims: I32
    """Group of each drawn prim, shape (prims,)."""
    of_materials: I32 | None = None
    """Group of each material of the drawn meshes, shape (materials,); None if surfaces are grouped
    by prim."""

    @cached_property
    def hashes(self) -> F32:
        """Cryptomatte's id of each group, shape (groups,)."""
        return np.array([object_hash(name) for name in self.names], np.float32)


def matte_groups(
    layer: str,
    prims: Sequence[str],
    splats: Sequence[InstanceSpec],
    meshes: Sequence[DrawnMesh],
) -> MatteGroups:
    """Return the groups of one of `cryptomatte.LAYERS`.

    Args:
        prims: Paths of all drawn prims, sorted.
        splats, meshes: Appearances of splats and of meshes.
    """
    if layer == "cryptoObject":
        return MatteGroups(names=tuple(prims), of_prims=np.arange(len(prims), dtype=np.int32))
    if layer == "cryptoAsset":
        seen = (*splats, *(instance for _, _, instance in meshes))
        assets = {instance.path: instance.asset or instance.path for instance in seen}
        return _grouped(prims, assets, None)
    bound = {instance.path: instance.material or UNBOUND for instance in splats}
    specs, _ = distinct_meshes(meshes)
    of_meshes = [each.path or UNBOUND for spec in specs for each in spec.materials]
    return _grouped(prims, bound, of_meshes)


def _grouped(
    prims: Sequence[str], of_prims: Mapping[str, str], of_materials: Sequence[str] | None
) -> MatteGroups:
    """Number the names of groups. Prims without a name, which are meshes grouped by material, get
    the number 0. It is not used."""
    names = tuple(sorted({*of_prims.values(), *(of_materials or ())}))
    numbers = {name: number for number, name in enumerate(names)}

    def numbered(found: Iterable[str]) -> I32:
        return np.array([numbers.get(name, 0) for name in found], np.int32)

    return MatteGroups(
        names=names,
        of_prims=numbered(of_prims.get(path, "") for path in prims),
        of_materials=None if of_materials is None else numbered(of_materials),
    )
