"""Map changes of the stage to the prims of the render index that they affect."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate import light_groups
from usdsplat.delegate.scene_delegate.notices import Changes, is_color_space
from usdsplat.delegate.scene_delegate.points import PROPERTIES as POINT_PROPERTIES
from usdsplat.delegate.scene_delegate.points import is_points
from usdsplat.delegate.scene_delegate.population import Level, Population, source_of
from usdsplat.delegate.scene_delegate.trees import PROPERTIES as TREE_PROPERTIES
from usdsplat.delegate.scene_delegate.volumes import SIZES

FIELD_PROPERTIES = (
    schema.DATA_ATTRIBUTES
    | schema.GRADE_ATTRIBUTES
    | schema.tokens.SURFACE_ATTRIBUTES
    | {
        schema.tokens.RASTERIZE_MODE,
        schema.tokens.LIGHTING,
        schema.tokens.CAPTURED_LIGHTS,
        schema.tokens.FOOTPRINT,
        schema.tokens.PROJECTION_MODE,
        schema.tokens.SORTING_MODE,
        *POINT_PROPERTIES,
    }
)
"""Properties that a field is read from; it may have others."""

MESH_PROPERTIES = {
    **dict.fromkeys(("points", "velocities", "accelerations"), DirtyBits.POINTS),
    **dict.fromkeys(
        (
            "radius",
            "radiusBottom",
            "radiusTop",
            "height",
            "size",
            "width",
            "length",
            "axis",
        ),
        DirtyBits.POINTS,
    ),
    **dict.fromkeys(
        (
            "faceVertexCounts",
            "faceVertexIndices",
            "holeIndices",
            "creaseIndices",
            "creaseLengths",
            "creaseSharpnesses",
            "cornerIndices",
            "cornerSharpnesses",
            "subdivisionScheme",
            "interpolateBoundary",
            "faceVaryingLinearInterpolation",
            "orientation",
        ),
        DirtyBits.TOPOLOGY,
    ),
    "normals": DirtyBits.NORMALS,
    "doubleSided": DirtyBits.DOUBLE_SIDED,
}
"""Properties that a mesh or a shape is read from, besides inherited ones."""


class Dependencies:
    """Map from stage paths to the paths in the render index that they affect.

    A stage path has four sets of prims in the index: prims at or below it, prims that it transforms
    or hides, prims whose own attributes it has, and fields that are cropped by volumes at or below
    it.

    Native instances are found by their own paths and by those in their prototypes.
    """

    def __init__(self, population: Population) -> None:
        self._beneath: dict[Sdf.Path, set[str]] = defaultdict(set)
        self._placed: dict[Sdf.Path, set[str]] = defaultdict(set)
        self._read: dict[Sdf.Path, set[str]] = defaultdict(set)
        self._cropped: dict[Sdf.Path, set[str]] = defaultdict(set)
        self._meshes = population.meshes.keys()
        self._fields, self._lights = population.fields.keys(), population.lights.keys()
        self._points = {path for path, each in population.fields.items() if is_points(each.prim)}
        for path, entry in population.rprims():
            for appearance in entry.appearances:
                self._add(path, appearance.levels, appearance.levels[-1].prim)
            for volume in entry.crop.volumes:
                for twin in _twins(volume.prim):
                    for prefix in twin.GetPath().GetPrefixes():
                        self._cropped[prefix].add(path)
        for kind in (population.instancers, population.cameras, population.lights):
            for path, prim in kind.items():
                self._add(path, (Level(prim=prim, root=None),), prim)

    def reached_by(self, changes: Changes) -> Iterator[tuple[str, DirtyBits]]:
        """Yield (path in the render index, dirty bits) for `changes`."""
        for path in changes.resynced:
            yield from _each(self._beneath.get(path), DirtyBits.ALL)
            # GeomSubsets are children of the mesh.
            parents = self._meshes & self._read.get(path.GetParentPath(), set())
            yield from _each(parents, DirtyBits.MATERIAL_ID)
            yield from _each(self._cropped.get(path), DirtyBits.CATEGORIES)
        for path in changes.prims:
            # inactiveIds is the only metadata in use that does not cause a resync.
            yield from _each(self._read.get(path), DirtyBits.INSTANCER)
        for path in changes.properties:
            prim, name = path.GetPrimPath(), path.name
            if name in SIZES or name.startswith("xformOp"):
                yield from _each(self._cropped.get(prim), DirtyBits.CATEGORIES)
            if bits := _inherited_bits(name):
                yield from _each(self._placed.get(prim), bits)
            elif name == f"primvars:{light_groups.PRIMVAR}":
                yield from _each(self._lights & self._beneath.get(prim, set()), DirtyBits.PARAMS)
            elif name in schema.GRADE_ATTRIBUTES:
                yield from _each(self._fields & self._beneath.get(prim, set()), DirtyBits.PRIMVAR)
            elif bits := inherited_by_mesh(name):
                beneath = self._beneath.get(prim, set())
                yield from _each(self._meshes & beneath, bits)
                yield from _each(self._points & beneath, bits & DirtyBits.PRIMVAR)
                if name in schema.tokens.SURFACE_ATTRIBUTES:
                    yield from _each(self._fields & self._read.get(prim, set()), _own_bits(name))
            else:
                for found in self._read.get(prim, ()):
                    own = mesh_bits(name) if found in self._meshes else _own_bits(name)
                    yield found, own

    def _add(self, path: str, levels: Iterable[Level], own: Usd.Prim) -> None:
        for twin in _twins(own):
            self._read[twin.GetPath()].add(path)
        for level in levels:
            for prim in level.lineage():
                for twin in _twins(prim):
                    self._placed[twin.GetPath()].add(path)
            for twin in _twins(level.prim):
                for prefix in twin.GetPath().GetPrefixes():
                    self._beneath[prefix].add(path)


def _twins(prim: Usd.Prim) -> tuple[Usd.Prim, ...]:
    """Return a prim and, for an instance proxy, the prim in the prototype."""
    return (prim, source_of(prim)) if prim.IsInstanceProxy() else (prim,)


def _each(paths: Iterable[str] | None, bits: DirtyBits) -> Iterator[tuple[str, DirtyBits]]:
    return ((path, bits) for path in paths or ())


def _inherited_bits(name: str) -> DirtyBits:
    """Return the bits that a property changes for a prim and its descendants."""
    if name.startswith("xformOp"):
        return DirtyBits.TRANSFORM
    if name == "visibility":
        return DirtyBits.VISIBILITY
    if name == "purpose":
        return DirtyBits.RENDER_TAG
    return DirtyBits.PRIMVAR if is_color_space(name) else DirtyBits.CLEAN


def inherited_by_mesh(name: str) -> DirtyBits:
    """Return the bits that a property changes for meshes at and below a prim."""
    if name.startswith("material:binding"):
        return DirtyBits.MATERIAL_ID
    if name.startswith(("skel:", "primvars:skel:")):
        return DirtyBits.POINTS | DirtyBits.TRANSFORM
    if name.startswith("primvars:normals"):
        return DirtyBits.NORMALS
    return DirtyBits.PRIMVAR if name.startswith("primvars:") else DirtyBits.CLEAN


def mesh_bits(name: str) -> DirtyBits:
    """Return the bits that any property of a mesh or shape changes for it."""
    return inherited_by_mesh(name) | MESH_PROPERTIES.get(name, DirtyBits.CLEAN)


def _own_bits(name: str) -> DirtyBits:
    """Return the bits that any other property changes for its own prim, which is not a mesh.

    Cameras, lights and instancers are read again after a change of any property.
    """
    bits = DirtyBits.PARAMS | DirtyBits.INSTANCER
    is_read = name in FIELD_PROPERTIES or name.startswith(TREE_PROPERTIES)
    return bits | DirtyBits.PRIMVAR | DirtyBits.TOPOLOGY if is_read else bits
