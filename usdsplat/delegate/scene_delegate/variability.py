"""What may differ from one time code to another, found once and kept until an edit."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.population import Level, Population
from usdsplat.delegate.scene_delegate.volumes import SIZES, Crop


def varying_bits(population: Population, path: str) -> DirtyBits:
    """What of the field, instancer or camera at `path` a change of time makes dirty."""
    if path in population.instancers:
        varies = _instancer_varies(population.instancers[path])
        return DirtyBits.INSTANCER if varies else DirtyBits.CLEAN
    if path in population.cameras:
        prim = population.cameras[path]
        lens = DirtyBits.PARAMS if _lens_varies(prim) else DirtyBits.CLEAN
        return lens | _placing_varies((Level(prim=prim, root=None),))
    entry = population.fields[path]
    varies = schema.is_time_varying(entry.source) or schema.is_grade_varying(entry.source)
    data = DirtyBits.PRIMVAR if varies else DirtyBits.CLEAN
    levels = (level for appearance in entry.appearances for level in appearance.levels)
    crop = DirtyBits.CATEGORIES if _crop_varies(entry.crop) else DirtyBits.CLEAN
    return data | crop | _placing_varies(levels)


def _crop_varies(crop: Crop) -> bool:
    """Whether a volume may move or be resized."""
    prims = [volume.prim for volume in crop.volumes]
    sizes = (prim.GetAttribute(name) for prim in prims for name in SIZES)
    if any(attribute and attribute.ValueMightBeTimeVarying() for attribute in sizes):
        return True
    return bool(
        _placing_varies(Level(prim=prim, root=None) for prim in prims) & DirtyBits.TRANSFORM
    )


def _placing_varies(levels: Iterable[Level]) -> DirtyBits:
    """Whether anything that moves or hides the levels may vary."""
    bits = DirtyBits.CLEAN
    for prim in {prim for level in levels for prim in level.lineage()}:
        xformable = UsdGeom.Xformable(prim)
        if xformable and xformable.TransformMightBeTimeVarying():
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
        return True  # USD moves instances on from their last sample
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
