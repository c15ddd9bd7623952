"""Read opaque prims in the renderer's form: geometry and materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding, from_error
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.geometry import (
    SHAPE,
    Context,
    Geometry,
    MeshGeometry,
)
from usdsplat.delegate.scene_delegate.materials import (
    BoundMaterial,
    MaterialReader,
    bound_material,
)
from usdsplat.delegate.scene_delegate.readings import Readings, Sources
from usdsplat.delegate.scene_delegate.shapes import ShapeGeometry
from usdsplat.delegate.scene_delegate.textures import Textures
from usdsplat.render.specs import MaterialSpec, MeshSpec
from usdsplat.schema.hints import is_shadow_catcher
from usdsplat.schema.values import integers, value, vectors


class MeshReader:
    """Reader of an opaque prim that reads only what has changed."""

    def __init__(self, path: str, textures: Textures, readings: Readings) -> None:
        self._path = path
        self._textures = textures
        self._readings = readings
        self._stale = DirtyBits.SURFACE
        self._geometry: Geometry | None = None
        self._primvars: dict[tuple[str, int], F32 | None] = {}
        self._primvar_problems: dict[tuple[str, int], UsdSplatError] = {}
        self._material_findings: list[Finding] = []
        self._looks: tuple[BoundMaterial, ...] = ()
        self._materials: tuple[str, ...] = ()
        """Path of the material of each look; "" without one."""
        self._look_of: I32 | None = None
        self.has_other_sources = False
        """Whether the last reading had different sources than the one before."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about parts that are not drawn as authored, although the prim is drawn."""
        geometry = self._geometry.problems if self._geometry else []
        left_out = (*geometry, *self._primvar_problems.values())
        return (*(from_error("left-out", why) for why in left_out), *self._material_findings)

    def read(self, prim: Usd.Prim, bits: DirtyBits, context: Context) -> MeshSpec | None:
        """Return the mesh, or None if it has no triangles.

        Raises:
            StageError: If the prim cannot be drawn.
        """
        self._stale |= bits
        self.has_other_sources = False
        geometry = self._geometry_of(prim)
        if self._stale & SHAPE:
            sources = Sources(prim.GetStage(), DirtyBits.POINTS)
            try:
                rebuilt = geometry.update(prim, self._stale & SHAPE, context, sources)
            finally:
                if self._stale & (SHAPE & ~DirtyBits.NORMALS):
                    self._put("points", sources)
            if rebuilt:
                self._stale |= DirtyBits.PRIMVAR | DirtyBits.MATERIAL_ID
            self._stale &= ~SHAPE
        if not len(geometry.triangles):
            return None
        if self._stale & DirtyBits.MATERIAL_ID:
            context.pulls["material"] += 1
            self._read_looks(prim, context, geometry)
        if self._stale & DirtyBits.PRIMVAR:
            self._primvars.clear()
            self._primvar_problems.clear()
        spec = self._assemble(prim, context, geometry)
        self._stale = DirtyBits.CLEAN
        return spec

    # --- private ---------------------------------------------------------------------------

    def _geometry_of(self, prim: Usd.Prim) -> Geometry:
        kind = MeshGeometry if prim.IsA(UsdGeom.Mesh) else ShapeGeometry
        if type(self._geometry) is not kind:
            self._geometry = kind(self._path)
            self._stale = DirtyBits.SURFACE
        assert self._geometry is not None
        return self._geometry

    def _put(self, aspect: str, sources: Sources) -> None:
        self.has_other_sources |= self._readings.put(self._path, aspect, sources)

    def _read_looks(self, prim: Usd.Prim, context: Context, geometry: Geometry) -> None:
        sources = Sources(prim.GetStage(), DirtyBits.MATERIAL_ID)
        reader = MaterialReader(context.time, self._textures, sources)
        self._material_findings = reader.findings
        try:
            materials = [bound_material(prim, sources)]
            look_of = np.zeros(len(geometry.triangles), np.int32)
            for subset in UsdGeom.Subset.GetGeomSubsets(
                UsdGeom.Imageable(prim), UsdGeom.Tokens.face, UsdShade.Tokens.materialBind
            ):
                sources.add(subset.GetPrim())
                faces = self._faces(subset, context.time)
                look_of[np.isin(geometry.faces, faces)] = len(materials)
                materials.append(bound_material(subset.GetPrim(), sources))
            used = np.unique(look_of)
            found = {number: reader.look(materials[number]) for number in used.tolist()}
            self._looks = tuple(found.values())
            paths = (materials[number] for number in found)
            self._materials = tuple(str(each.GetPath()) if each else "" for each in paths)
            self._look_of = np.searchsorted(used, look_of).astype(np.int32)
        finally:
            self._put("material", sources)

    def _faces(self, subset: UsdGeom.Subset, time: Usd.TimeCode) -> I32:
        where = f"{subset.GetPath()}.indices"
        try:
            return integers(where, value(subset.GetIndicesAttr(), time))
        except UsdSplatError as error:
            self._material_findings.append(from_error("left-out", error))
            return np.empty(0, np.int32)

    def _assemble(self, prim: Usd.Prim, context: Context, geometry: Geometry) -> MeshSpec:
        def primvar(name: str, width: int) -> F32 | None:
            key = (name, width)
            if key not in self._primvars:
                context.pulls["primvars"] += 1
                try:
                    self._primvars[key] = _primvar(prim, name, width, context.time, geometry)
                except UsdSplatError as error:
                    self._primvar_problems[key] = error
                    self._primvars[key] = None
            return self._primvars[key]

        wanted = {(look.colors, 3) for look in self._looks} | {
            (look.uvs, 2) for look in self._looks
        }
        for gone in self._primvar_problems.keys() - wanted:
            del self._primvar_problems[gone], self._primvars[gone]
        sided = prim.GetAttribute("doubleSided")
        # USD's fallback is single-sided, but usdview shows both sides if nothing is authored.
        doubled = not sided.HasAuthoredValue() or value(sided, context.time)
        assert self._look_of is not None
        return MeshSpec(
            points=geometry.points,
            triangles=geometry.triangles,
            faces=geometry.faces,
            normals=geometry.normals,
            colors=_joined(self._looks, self._look_of, lambda look: _colors(look, primvar)),
            uvs=_joined(
                self._looks,
                self._look_of,
                lambda look: _uvs(look, primvar, len(geometry.triangles)),
            ),
            materials=tuple(
                replace(_material(look, primvar), path=path)
                for look, path in zip(self._looks, self._materials, strict=True)
            ),
            material_of=self._look_of if len(self._looks) > 1 else None,
            double_sided=bool(doubled),
            is_catcher=is_shadow_catcher(prim),
        )


Primvar = Callable[[str, int], F32 | None]
"""Function (name, width) -> values at triangle corners, or None if the mesh has none."""


def _primvar(
    prim: Usd.Prim, name: str, width: int, time: Usd.TimeCode, geometry: Geometry
) -> F32 | None:
    """Read a primvar of the prim, own or inherited."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    where = f"{prim.GetPath()}.primvars:{name}"
    found = value(primvar.GetAttr(), time) if primvar else None
    if found is None:
        own = isinstance(geometry, ShapeGeometry) and width == 2
        return geometry.uvs if own and isinstance(geometry, ShapeGeometry) else None
    values = vectors(where, found if primvar.GetTypeName().isArray else [found], width)
    if primvar.GetElementSize() != 1:
        raise StageError(where, f"an elementSize of {primvar.GetElementSize()}", "1")
    indices = value(primvar.GetIndicesAttr(), time) if primvar.IsIndexed() else None
    rows = None if indices is None else integers(f"{where}:indices", indices)
    try:
        return geometry.corners(values, str(primvar.GetInterpolation()), rows)
    except StageError as error:
        raise StageError(where, error.found, error.expected) from None


def _joined(
    looks: tuple[BoundMaterial, ...], look_of: I32, corners: Callable[[BoundMaterial], F32 | None]
) -> F32 | None:
    """Return corner values of each triangle from its material; None if no material has any."""
    found = [corners(look) for look in looks]
    there = [each for each in found if each is not None]
    if not there:
        return None
    if all(each is there[0] for each in found):
        return there[0]
    joined = np.zeros_like(there[0])
    for number, each in enumerate(found):
        if each is not None:
            joined[look_of == number] = each[look_of == number]
    return joined


def _colors(look: BoundMaterial, primvar: Primvar) -> F32 | None:
    return primvar(look.colors, 3) if look.colors else None


def _uvs(look: BoundMaterial, primvar: Primvar, count: int) -> F32 | None:
    if look.spec.texture is None:
        return None
    found = primvar(look.uvs, 2) if look.uvs else None
    if found is None:
        found = np.zeros((count, 3, 2), np.float32)
    if look.transform is None:
        return found
    moved = found @ look.transform[:, :2].T + look.transform[:, 2]
    return moved.astype(np.float32)


def _material(look: BoundMaterial, primvar: Primvar) -> MaterialSpec:
    """Return the material, with its fallback colour if the mesh lacks the colour primvar."""
    if look.spec.uses_colors and _colors(look, primvar) is None:
        return replace(look.spec, diffuse=look.fallback, uses_colors=False)
    return look.spec
