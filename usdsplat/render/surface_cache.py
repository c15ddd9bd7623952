"""Lay out triangles, materials and textures of a scene's meshes for kernels.

The layout does not depend on view or transforms. The last one is cached for pictures of the same
meshes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I32, I64
from usdsplat.kernels import shade, texture
from usdsplat.kernels.device import Device
from usdsplat.render.specs import MaterialSpec, MeshSpec, TextureSpec

WRAPS = {
    "black": texture.BLACK,
    "clamp": texture.CLAMP,
    "repeat": texture.REPEAT,
    "mirror": texture.MIRROR,
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PackedMeshes:
    """Concatenated arrays of all meshes of a scene. A single mesh is not copied."""

    points: F32
    triangles: I32
    """Rows of the mesh's own points."""
    looks: tuple[npt.NDArray[Any], ...]
    """The argument `looks` of `shade.shade`."""
    rows: dict[str, I64]
    """APPEARANCE field -> first row of each mesh in that array, -1 for a mesh without one."""
    points_of: I64
    """Number of points of each mesh."""
    triangles_of: I64
    """Number of triangles of each mesh."""


class SurfaceCache:
    """Cache of the layout of the meshes that were drawn last."""

    def __init__(self) -> None:
        self._specs: tuple[MeshSpec, ...] = ()
        self._packed: PackedMeshes | None = None

    def clear(self) -> None:
        """Release the layout."""
        self._packed, self._specs = None, ()

    def packed(self, device: Device, specs: Sequence[MeshSpec]) -> PackedMeshes:
        """Return the layout of `specs`, which are distinct."""
        same = len(specs) == len(self._specs) and all(map(_is, specs, self._specs))
        if self._packed is None or not same:
            self._packed = None  # released before another is allocated
            self._packed, self._specs = _pack(device, specs), tuple(specs)
        return self._packed


def _is(a: object, b: object) -> bool:
    return a is b


def _pack(device: Device, specs: Sequence[MeshSpec]) -> PackedMeshes:
    rows, looks = {}, []
    for name, target, shape, dtype in (
        ("points", "points", (3,), np.float32),
        ("triangles", "rows", (3,), np.int32),
        ("faces", "faces", (), np.int32),
        ("normals", "normals", (3, 3), np.float32),
        ("colors", "colors", (3, 3), np.float32),
        ("uvs", "uvs", (3, 2), np.float32),
        ("material_of", "material_of", (), np.int32),
    ):
        array, rows[target] = _joined([getattr(spec, name) for spec in specs], shape, dtype)
        looks.append(device.keep(array))
    numbers = np.array([len(spec.materials) for spec in specs], np.int64)
    rows["material"] = np.cumsum(numbers) - numbers
    # faces have the same rows as triangles
    del rows["faces"]
    materials = [material for spec in specs for material in spec.materials]
    return PackedMeshes(
        points=looks[0],
        triangles=looks[1],
        looks=(*looks[2:], *_materials(device, materials)),
        rows=rows,
        points_of=np.array([len(spec.points) for spec in specs], np.int64),
        triangles_of=np.array([len(spec.triangles) for spec in specs], np.int64),
    )


def _joined(
    arrays: Sequence[npt.NDArray[Any] | None], shape: tuple[int, ...], dtype: npt.DTypeLike
) -> tuple[npt.NDArray[Any], I64]:
    """Return the arrays that are not None, concatenated, and the first row of each, -1 for None."""
    there = [array for array in arrays if array is not None]
    lengths = np.array([0 if array is None else len(array) for array in arrays], np.int64)
    firsts = np.cumsum(lengths) - lengths
    firsts[[array is None for array in arrays]] = -1
    if len(there) == 1:
        return there[0], firsts
    return np.concatenate([np.empty((0, *shape), dtype), *there]), firsts


def _materials(
    device: Device, materials: Sequence[MaterialSpec]
) -> tuple[npt.NDArray[Any], npt.NDArray[Any], F32]:
    """Return MATERIAL records, LEVEL records and the texels of all mipmaps. Equal textures are
    stored once."""
    records = np.zeros(len(materials), shade.MATERIAL)
    levels: list[tuple[int, int, int]] = []
    pictures: dict[int, tuple[int, int]] = {}
    textures: list[TextureSpec] = []
    end = 0
    for record, material in zip(records, materials, strict=True):
        record["red"], record["green"], record["blue"] = material.diffuse
        record["uses_colors"] = material.uses_colors
        picture = material.texture
        if picture is None or picture.pixels.size == 0:
            continue
        if id(picture.pixels) not in pictures:
            first = len(levels)
            for height, width in _halvings(*picture.pixels.shape[:2]):
                levels.append((end, width, height))
                end += height * width * texture.CHANNELS
            pictures[id(picture.pixels)] = first, len(levels) - first
            textures.append(picture)
        record["first"], record["levels"] = pictures[id(picture.pixels)]
        record["wrap_u"], record["wrap_v"] = (WRAPS[wrap] for wrap in picture.wrap)
    table = np.array(levels, texture.LEVEL)
    texels = device.empty(end, np.float32)
    for picture in textures:
        first, count = pictures[id(picture.pixels)]
        start = table["first"][first]
        texels[start : start + picture.pixels.size] = picture.pixels.ravel()
        for k in range(first, first + count - 1):
            # pass only the two levels, which are copied to a GPU
            pair = table[k : k + 2].copy()
            pair["first"] -= table["first"][k]
            size = pair["first"][1] + pair["width"][1] * pair["height"][1] * texture.CHANNELS
            begin = table["first"][k]
            small = int(pair["height"][1]), int(pair["width"][1])
            device.run(texture.halve, texels[begin : begin + size], pair, 0, small)
    return device.keep(records), device.keep(table), device.keep(texels)


def _halvings(height: int, width: int) -> Iterator[tuple[int, int]]:
    """Yield the sizes of the levels of a mipmap, down to one texel."""
    yield height, width
    while height > 1 or width > 1:
        height, width = max(1, height // 2), max(1, width // 2)
        yield height, width
