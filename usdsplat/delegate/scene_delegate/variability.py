"""Determine what may vary over time; cached until an edit."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.dependencies import inherited_by_mesh, mesh_bits
from usdsplat.delegate.scene_delegate.points import are_points_varying, is_points
from usdsplat.delegate.scene_delegate.population import Level, Population, RprimEntry
from usdsplat.delegate.scene_delegate.readings import Readings
from usdsplat.delegate.scene_delegate.volumes import SIZES, Crop
from usdsplat.schema.stage_values import may_move


def varying_bits(population: Population, readings: Readings, path: str) -> DirtyBits:
    """Return the bits of a prim of the index that a change of time makes dirty."""
    if path in population.instancers:
        varies = _instancer_varies(population.instancers[path])
        return DirtyBits.INSTANCER if varies else DirtyBits.CLEAN
    if path in population.cameras:
        prim = population.cameras[path]
        lens = DirtyBits.PARAMS if _lens_varies(prim) else DirtyBits.CLEAN
        return lens | _placing_varies((Level(prim=prim, root=None),))
    if path in population.lights:
        prim = population.lights[path]
        varies = any(each.ValueMightBeTimeVarying() for each in prim.GetAuthoredAttributes())
        shines = DirtyBits.PARAMS if varies else DirtyBits.CLEAN
        return shines | _placing_varies((Level(prim=prim, root=None),))
    if path in population.meshes:
        return _mesh_varies(population.meshes[path], readings, path)
    entry = population.fields[path]
    if is_points(entry.source):
        varies = are_points_varying(entry.prim)
    elif entry.is_tree:
        varies = schema.is_grade_varying(entry.prim)
    else:
        varies = schema.is_time_varying(entry.source) or schema.is_grade_varying(entry.prim)
    data = DirtyBits.PRIMVAR if varies else DirtyBits.CLEAN
    levels = (level for appearance in entry.appearances for level in appearance.levels)
    crop = DirtyBits.CATEGORIES if _crop_varies(entry.crop) else DirtyBits.CLEAN
    return data | crop | _placing_varies(levels)


def _crop_varies(crop: Crop) -> bool:
    """Return whether a volume may move or change size."""
    prims = [volume.prim for volume in crop.volumes]
    sizes = (prim.GetAttribute(name) for prim in prims for name in SIZES)
    if any(attribute and attribute.ValueMightBeTimeVarying() for attribute in sizes):
        return True
    return bool(
        _placing_varies(Level(prim=prim, root=None) for prim in prims) & DirtyBits.TRANSFORM
    )


def _mesh_varies(entry: RprimEntry, readings: Readings, path: str) -> DirtyBits:
    """Return the bits of a mesh that may vary, by its sources."""
    stage = entry.prim.GetStage()
    bits = _placing_varies(level for each in entry.appearances for level in each.levels)
    prim = entry.prim
    while prim and not prim.IsPseudoRoot():
        for attribute in prim.GetAuthoredAttributes():
            name = attribute.GetName()
            own = mesh_bits(name) if prim == entry.prim else inherited_by_mesh(name)
            if own & ~bits and attribute.ValueMightBeTimeVarying():
                bits |= own
        prim = prim.GetParent()
    velocities = entry.prim.GetAttribute("velocities")
    if velocities and velocities.HasAuthoredValue():
        bits |= DirtyBits.POINTS  # USD extrapolates points from their last sample
    for sources in readings.sources(path):
        if sources.bits & ~bits and any(map(_varies, map(stage.GetPrimAtPath, sources.read))):
            bits |= sources.bits
        if any(map(may_move, map(stage.GetPrimAtPath, sources.placed))):
            bits |= DirtyBits.TRANSFORM
    return bits


def _varies(prim: Usd.Prim) -> bool:
    return bool(prim) and any(
        each.ValueMightBeTimeVarying() for each in prim.GetAuthoredAttributes()
    )


def _placing_varies(levels: Iterable[Level]) -> DirtyBits:
    """Return whether transforms or visibility of the levels may vary."""
    bits = DirtyBits.CLEAN
    for prim in {prim for level in levels for prim in level.lineage()}:
        if may_move(prim):
            bits |= DirtyBits.TRANSFORM
        imageable = UsdGeom.Imageable(prim)
        if imageable and imageable.GetVisibilityAttr().ValueMightBeTimeVarying():
            bits |= DirtyBits.VISIBILITY
    return bits


def _instancer_varies(prim: Usd.Prim) -> bool:
    instancer = UsdGeom.PointInstancer(prim)
    motion = (
        instancer.GetVelocitiesAttr(),
        instancer.GetAccelerationsAttr(),
        instancer.GetAngularVelocitiesAttr(),
    )
    if any(attribute.HasAuthoredValue() for attribute in motion):
        return True  # USD extrapolates instances from their last sample
    arrays = (
        instancer.GetProtoIndicesAttr(),
        instancer.GetPositionsAttr(),
        instancer.GetOrientationsAttr(),
        instancer.GetOrientationsfAttr(),
        instancer.GetScalesAttr(),
        instancer.GetIdsAttr(),
        instancer.GetInvisibleIdsAttr(),
    )
    return any(attribute.ValueMightBeTimeVarying() for attribute in arrays)


def _lens_varies(prim: Usd.Prim) -> bool:
    camera = UsdGeom.Camera(prim)
    lens = (
        camera.GetProjectionAttr(),
        camera.GetHorizontalApertureAttr(),
        camera.GetVerticalApertureAttr(),
        camera.GetHorizontalApertureOffsetAttr(),
        camera.GetVerticalApertureOffsetAttr(),
        camera.GetFocalLengthAttr(),
        camera.GetClippingRangeAttr(),
        camera.GetFStopAttr(),
        camera.GetFocusDistanceAttr(),
        camera.GetShutterOpenAttr(),
        camera.GetShutterCloseAttr(),
        camera.GetExposureAttr(),
        camera.GetExposureIsoAttr(),
        camera.GetExposureTimeAttr(),
        camera.GetExposureFStopAttr(),
        camera.GetExposureResponsivityAttr(),
    )
    return any(attribute.ValueMightBeTimeVarying() for attribute in lens)
