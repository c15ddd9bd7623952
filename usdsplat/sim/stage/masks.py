"""Read masks: instances of SplatSimMaskAPI, and the parameters that they multiply."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import FormatError, StageError
from usdsplat.core.knobs import knobs
from usdsplat.images.texture import read_channel
from usdsplat.schema.values import value
from usdsplat.sim.level_sets import read_level_set
from usdsplat.sim.masks import IMPLICIT
from usdsplat.sim.parameters import (
    GROUPS,
    INSTANCED,
    MASK,
    NAMED,
    NAMESPACE,
    MaskParameters,
    camel,
)
from usdsplat.sim.specs import LevelSet, Mask, Picture, Surface
from usdsplat.sim.stage import fields
from usdsplat.sim.stage.affectors import AffectorReader
from usdsplat.sim.stage.curves import read_curves
from usdsplat.sim.stage.parameters import FRAME, REGION, instances, read
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space
from usdsplat.sim.stage.targets import related, unchanged_or

OLD = "deform"
"""Group with the parameter `mask`, the name of a primvar."""


Names = tuple[str, ...]


class MaskReader:
    """Reader of the masks of one simulation, for one field.

    Args:
        simulation: The SplatSim prim.
        field: The splat field.
        count: Number of its splats.
        space: The simulation's space.
        rigs: Skinning of the stage.
        affectors: Affectors of the simulation.
    """

    def __init__(
        self,
        simulation: Usd.Prim,
        field: Usd.Prim,
        count: int,
        space: Space,
        rigs: Rigs,
        affectors: Sequence[Usd.Prim],
    ) -> None:
        self._simulation, self._field, self._count = simulation, field, count
        self._space, self._rigs, self._affectors = space, rigs, affectors
        self._last: dict[str, Mask] = {}
        self._regions: dict[str, tuple[AffectorReader, ...]] = {}
        self._files: dict[tuple[str, str, str], F32 | LevelSet] = {}
        self._curves: dict[str, Surface] = {}

    @property
    def files(self) -> tuple[str, ...]:
        """Resolved paths of the files that masks are read from."""
        return tuple(sorted({path for path, _, _ in self._files}))

    def at(self, time: Usd.TimeCode) -> tuple[dict[str, Mask], dict[str, Names]]:
        """Return the masks at a time by name, and the parameters with the names of their masks.

        Raises:
            UsdSplatError: If something that a mask needs is missing or cannot be used.
        """
        masks = {name: self._mask(name, time) for name in instances(self._simulation, "mask")}
        masked: dict[str, Names] = {knob: (name,) for knob, name in self._bound(masks)}
        for name in instances(self._simulation, OLD):
            self._add_primvar(name, masks, masked, time)
        self._check(masks)
        return masks, masked

    # --- private ---------------------------------------------------------------------------

    def _mask(self, name: str, time: Usd.TimeCode) -> Mask:
        """Return one mask; the same object if nothing of it has changed."""
        lead = f"{NAMESPACE}:mask:{name}"
        p = read(self._simulation, MaskParameters, lead, time)
        prim = related(self._simulation, f"{lead}:{FRAME}")
        frame = self._space.from_prim(prim, time) if prim else np.eye(4)
        if not abs(np.linalg.det(frame[:3, :3])) > 0:
            where = f"{self._simulation.GetPath()}.{lead}:{FRAME}"
            raise StageError(where, "a prim with a singular transform", "an invertible one")
        parts: dict[str, Any] = {}
        if p.source == "primvar":
            parts["primvar"] = self._primvar(lead, p.primvar, "primvar", time)
        elif p.source == "affector":
            parts["regions"] = tuple(each.at(time) for each in self._readers(name))
        elif p.source == "texture":
            parts["picture"] = self._picture(lead, p, prim, time)
        elif p.source == "volume":
            parts["level_set"] = self._level_set(lead, p)
        elif p.source == "curves":
            parts["curves"] = self._segments(name, time)
        return self._kept(Mask(name=name, parameters=p, frame=frame, **parts))

    def _kept(self, mask: Mask) -> Mask:
        """Return the last mask of this name if it is equal, else this one."""
        last = self._last.get(mask.name)
        if last is not None and last.parameters == mask.parameters:
            if last.primvar is not None and mask.primvar is not None:
                is_equal = np.array_equal(last.primvar, mask.primvar)
                mask = replace(mask, primvar=last.primvar) if is_equal else mask
            is_same = (
                np.array_equal(last.frame, mask.frame)
                and last.primvar is mask.primvar
                and not mask.regions
                and _is_same(last.picture, mask.picture)
                and last.level_set is mask.level_set
                and last.curves is mask.curves
            )
            if is_same:
                return last
        self._last[mask.name] = mask
        return mask

    def _primvar(self, lead: str, name: str, knob: str, time: Usd.TimeCode) -> F32:
        """Return a primvar of the field, one number for each splat."""
        found = fields.per_splat(self._field, name, self._count, time) if name else None
        if found is None:
            raise fields.missing(self._simulation, f"{lead}:{knob}", name, self._field)
        return found

    def _readers(self, name: str) -> tuple[AffectorReader, ...]:
        """Return the readers of the affectors of a mask."""
        if name not in self._regions:
            prims = self._targets(name, "an affector")
            made = (AffectorReader(prim, self._space, self._rigs) for prim in prims)
            self._regions[name] = tuple(made)
        return self._regions[name]

    def _segments(self, name: str, time: Usd.TimeCode) -> Surface:
        """Return all curves of a mask."""
        parts = [
            read_curves(prim, time, self._space) for prim in self._targets(name, "BasisCurves")
        ]
        shifts = np.cumsum([0, *(len(each.points) for each in parts)])
        made = Surface(
            points=np.concatenate([each.points for each in parts]),
            triangles=np.concatenate(
                [
                    each.triangles + np.int32(shift)
                    for each, shift in zip(parts, shifts, strict=False)
                ]
            ),
        )
        self._curves[name] = unchanged_or(self._curves.get(name), made)
        return self._curves[name]

    def _targets(self, name: str, expected: str) -> list[Usd.Prim]:
        """Return the prims of the relationship region."""
        where = f"{NAMESPACE}:mask:{name}:{REGION}"
        relationship = self._simulation.GetRelationship(where)
        paths = relationship.GetForwardedTargets() if relationship else []
        stage = self._simulation.GetStage()
        prims = [stage.GetPrimAtPath(path.GetPrimPath()) for path in paths]
        missing = [str(path) for path, prim in zip(paths, prims, strict=True) if not prim]
        if not prims or missing:
            found = f"{missing[0]}, which does not exist" if missing else "no target"
            raise StageError(f"{self._simulation.GetPath()}.{where}", found, expected)
        return prims

    def _picture(
        self, lead: str, p: MaskParameters, frame: Usd.Prim | None, time: Usd.TimeCode
    ) -> Picture:
        """Return the texture of a mask."""
        path = self._file(lead, p.file, "a picture")
        key = (path, "texture", p.channel)
        if key not in self._files:
            self._files[key] = self._read(lead, lambda: read_channel(path, p.channel))
        pixels = self._files[key]
        assert isinstance(pixels, np.ndarray)
        to_clip = self._to_clip(lead, frame, time) if p.projection == "camera" else None
        return Picture(pixels=pixels, to_clip=to_clip)

    def _level_set(self, lead: str, p: MaskParameters) -> LevelSet:
        """Return the volume of a mask."""
        path = self._file(lead, p.file, "an OpenVDB file")
        key = (path, "volume", p.grid)
        if key not in self._files:
            self._files[key] = self._read(lead, lambda: read_level_set(path, p.grid))
        found = self._files[key]
        assert isinstance(found, LevelSet)
        return found

    def _read(self, lead: str, reading: Any) -> Any:
        """Read a file, and name the attribute in errors."""
        try:
            return reading()
        except FormatError as error:
            where = f"{self._simulation.GetPath()}.{lead}:file"
            raise StageError(where, f"{error.where}, {error.found}", error.expected) from error

    def _file(self, lead: str, path: str, expected: str) -> str:
        """Return the resolved path of the attribute `file`."""
        found = value(self._simulation.GetAttribute(f"{lead}:file"), Usd.TimeCode.Default())
        resolved = found.resolvedPath if isinstance(found, Sdf.AssetPath) else path
        if not resolved or not os.path.exists(resolved):
            where = f"{self._simulation.GetPath()}.{lead}:file"
            is_there = f"{path}, which does not exist" if path else "none"
            raise StageError(where, is_there, expected)
        return str(resolved)

    def _to_clip(self, lead: str, frame: Usd.Prim | None, time: Usd.TimeCode) -> F64:
        """Return the matrix from the simulation's space to the clip space of the frame's lens."""
        if frame is None or not frame.IsA(UsdGeom.Camera):
            where = f"{self._simulation.GetPath()}.{lead}:{FRAME}"
            raise StageError(where, "no Camera and projection camera", "a Camera")
        lens = UsdGeom.Camera(frame).GetCamera(time).frustum.ComputeProjectionMatrix()
        to_camera = np.linalg.inv(self._space.from_prim(frame, time))
        return np.asarray(np.array(lens, np.float64).T @ to_camera)

    def _add_primvar(
        self, name: str, masks: dict[str, Mask], masked: dict[str, Names], time: Usd.TimeCode
    ) -> None:
        """Add the mask that a deformer's parameter `mask` names by a primvar."""
        lead = f"{NAMESPACE}:{OLD}:{name}"
        primvar = value(self._simulation.GetAttribute(f"{lead}:{MASK}"), Usd.TimeCode.Default())
        if not primvar:
            return
        knob, own = f"{OLD}:{name}:weight", f"{IMPLICIT}{OLD}:{name}"
        found = self._primvar(lead, str(primvar), MASK, time)
        p = MaskParameters(source="primvar", primvar=str(primvar), clamp=False)
        masks[own] = self._kept(Mask(name=own, parameters=p, frame=np.eye(4), primvar=found))
        masked[knob] = (*masked.get(knob, ()), own)

    def _bound(self, masks: Mapping[str, Mask]) -> Iterator[tuple[str, str]]:
        """Yield parameters with the names of their masks."""
        for group, cls in {**GROUPS, **INSTANCED}.items():
            names = [item.name for item in knobs(cls) if item.takes_mask]
            if not names or group == "affector":
                continue
            leads = [group]
            if group in NAMED:
                leads = [f"{group}:{each}" for each in instances(self._simulation, group)]
            for knob in (f"{lead}:{camel(name)}" for lead in leads for name in names):
                yield from self._binding(self._simulation, knob, knob, masks)
        amount = "affector:amount"
        for prim in self._affectors:
            yield from self._binding(prim, amount, f"{prim.GetPath()}.{amount}", masks)

    def _binding(
        self, prim: Usd.Prim, knob: str, name: str, masks: Mapping[str, Mask]
    ) -> Iterator[tuple[str, str]]:
        """Yield a parameter with the name of its mask, if it has one."""
        where = f"{NAMESPACE}:{knob}:{MASK}"
        attribute = prim.GetAttribute(where)
        if not attribute or not attribute.HasAuthoredValue():
            return
        found = str(value(attribute, Usd.TimeCode.Default()) or "")
        if found and found not in masks:
            known = ", ".join(each for each in masks if not each.startswith(IMPLICIT)) or "none"
            expected = f"a mask of {self._simulation.GetPath()}: {known}"
            raise StageError(f"{prim.GetPath()}.{where}", repr(found), expected)
        if found:
            yield name, found

    def _check(self, masks: Mapping[str, Mask]) -> None:
        """Reject inputs that do not exist, and masks that are their own input."""
        for name, mask in masks.items():
            if mask.parameters.source != "masks":
                continue
            where = f"{self._simulation.GetPath()}.{NAMESPACE}:mask:{name}:inputs"
            if not mask.parameters.inputs:
                raise StageError(where, "no names", "the names of masks")
            seen: set[str] = set()
            todo: list[str] = [name]
            while todo:
                for each in masks[todo.pop()].parameters.inputs:
                    if each not in masks:
                        raise StageError(where, repr(each), f"one of {', '.join(masks)}")
                    if each == name:
                        raise StageError(where, f"{name} among its own inputs", "other masks")
                    if each not in seen and masks[each].parameters.source == "masks":
                        todo.append(each)
                    seen.add(each)


def _is_same(last: Picture | None, now: Picture | None) -> bool:
    """Return whether two pictures, or none, are equal."""
    if last is None or now is None:
        return last is now
    if last.to_clip is None or now.to_clip is None:
        return last.pixels is now.pixels and last.to_clip is now.to_clip
    return last.pixels is now.pixels and np.array_equal(last.to_clip, now.to_clip)
