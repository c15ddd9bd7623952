"""Masks: numbers that multiply parameters, splat by splat.

All masks that parameters use are evaluated at the start of a substep and kept in the state's
memory. So they follow births and deaths, children have their parents' values until the next
substep, and a resumed simulation continues with the same bits. Those of target poses are evaluated
at rest positions, since a target must not depend on where splats are.

A stage reads a parameter's factor by `Masks.factor`, for which the parameter is declared with
`takes_mask`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.core.knobs import knobs
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import drivers
from usdsplat.kernels.sim import masks as kernels
from usdsplat.sim.closest import Triangles
from usdsplat.sim.falloff import falloff
from usdsplat.sim.fields import Fields
from usdsplat.sim.level_sets import filled
from usdsplat.sim.parameters import MaskParameters, camel
from usdsplat.sim.specs import LevelSet, Mask, Moment, Picture, Surface
from usdsplat.sim.state import State

KEPT = "mask:"
"""Lead of masks in `State.memory`, float32, shape (n,)."""
AT_REST = "@rest"
"""End of the names of masks that are evaluated at rest positions although they ask for others."""
ROWS = "mask-rows"
"""In `State.memory`: row of the capture whose primvars a splat has, int32, shape (n,)."""
FOREIGN = -1
"""Row of splats that are not of the capture, and have none of its primvars."""
IMPLICIT = ":"
"""Lead of the names of masks that are made of other attributes than those of SplatSimMaskAPI; they
are not limited to the ranges of parameters."""
ROLE = f"{IMPLICIT}affectors"
"""Name of the mask that affectors of the role mask make together."""
OF_ROLE = ("growth:rate", "growth:birthRate", "sim:contact")
"""Parameters that the mask of the role multiplies."""
_TARGETS = ("deform:", "skin:", "conform:")
"""Parameters of target poses."""

_EASES = {"linear": drivers.LINEAR, "smooth": drivers.SMOOTH, "smoother": drivers.SMOOTHER}
_PROJECTIONS = {
    "planar": kernels.PLANAR, "spherical": kernels.SPHERICAL, "camera": kernels.CAMERA,
}  # fmt: skip
_WRAPS = {"black": kernels.BLACK, "clamp": kernels.CLAMP, "repeat": kernels.REPEAT}
_OPERATIONS = {
    "multiply": kernels.MULTIPLY, "max": kernels.MAX, "min": kernels.MIN, "add": kernels.ADD,
    "subtract": kernels.SUBTRACT,
}  # fmt: skip
_STEADY = ("primvar", "noise", "axis", "texture", "volume", "curves", "masks")
"""Sources whose values depend only on rest positions and the stage, not on the simulation."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sites:
    """Where masks are evaluated: splats, or other points."""

    rest: F32
    """Positions at rest [unit], shape (n, 3)."""
    current: F32
    """Positions for masks that ask for the current ones [unit], shape (n, 3)."""
    uv: F32
    """Pattern, shape (n, 2)."""
    ages: F32
    """[s], shape (n,)."""
    rows: I32 | None
    """Row of the capture of each, or FOREIGN, shape (n,); None where they are the capture's."""
    seconds: float
    """Time since the simulation's start [s]."""

    def positions(self, mask: Mask) -> F32:
        """Return the positions that a mask asks for."""
        return self.rest if mask.parameters.at == "rest" else self.current


class Masks:
    """The masks of one field.

    Args:
        device: Runs the kernels.
        is_fixed: Whether splats at rest never move, and none are born or die.
    """

    def __init__(self, device: Device, *, is_fixed: bool) -> None:
        self._device, self._is_fixed = device, is_fixed
        self._fields: dict[str, Fields] = {}
        self._curves: dict[str, tuple[Surface, Triangles]] = {}
        self._filled: dict[str, tuple[LevelSet, LevelSet]] = {}
        self._kept: dict[str, tuple[tuple[Mask, ...], F32]] = {}

    def begin(self, state: State, moment: Moment) -> None:
        """Evaluate the masks of a capture at rest, before its first substep."""
        masks, _ = self._all(moment)
        if not self._is_fixed and any(each.primvar is not None for each in masks.values()):
            state.memory[ROWS] = np.arange(len(state), dtype=np.int32)
        self.update(state, moment, 0.0)

    def update(self, state: State, moment: Moment, seconds: float) -> None:
        """Evaluate all masks that parameters use, and keep them in the state's memory.

        Args:
            state: The splats.
            moment: Values of the stage.
            seconds: Time since the simulation's start [s].
        """
        masks, masked = self._all(moment)
        wanted = {_key(masks, masks[n], knob): n for knob, names in masked.items() for n in names}
        for key, name in wanted.items():
            every = tuple(_closure(masks, masks[name]))
            kept = self._kept.get(key)
            if kept is None or not self._is_fixed or not _is_same(kept[0], every):
                sites = _sites(state, seconds, at_rest=key.endswith(AT_REST))
                kept = self._kept[key] = (every, self.values(masks, name, sites))
            state.memory[KEPT + key] = kept[1]

    def append_joined(self, state: State, count: int) -> None:
        """Let the last `count` rows of a state, which are of another capture, have no primvars of
        this one: masks of source primvar are 1 there."""
        if ROWS in state.memory:
            state.memory[ROWS][len(state) - count :] = FOREIGN

    def factor(
        self, state: State, moment: Moment, knob: str, parameters: object = None
    ) -> F32 | None:
        """Return the factor of a parameter, shape (n,); None where nothing masks it.

        The parameter times the factor is within the parameter's range.

        Args:
            state: Holds the masks since the last `update`.
            moment: Values of the stage.
            knob: Name of the parameter, such as "growth:rate" or "deform:bend:weight".
            parameters: The parameter's group; None takes it from `moment.parameters`.
        """
        masks, masked = self._all(moment)
        if knob not in masked:
            return None
        group, *_, last = knob.split(":")
        owner = getattr(moment.parameters, group) if parameters is None else parameters
        found: F32 | None = None
        for name in masked[knob]:
            kept: F32 = state.memory[KEPT + _key(masks, masks[name], knob)]
            if not name.startswith(IMPLICIT):
                kept = _limited(kept, owner, last)
            found = kept if found is None else found * kept
        return found

    def values(self, masks: Mapping[str, Mask], name: str, sites: Sites) -> F32:
        """Return a mask at sites, shape (n,).

        Args:
            masks: The masks by name; its inputs are among them.
            name: Name of the mask.
            sites: Where to evaluate it.
        """
        mask = masks[name]
        p = mask.parameters
        found = self._source(masks, mask, sites)
        is_plain = (p.in_min, p.in_max) == (p.out_min, p.out_max) and p.ease == "linear"
        if is_plain and not (p.clamp or p.invert):
            return found
        low, high = (p.out_max, p.out_min) if p.invert else (p.out_min, p.out_max)
        f = np.float32
        self._device.run(
            kernels.remap,
            f(p.in_min),
            f(p.in_max),
            _EASES[p.ease],
            p.clamp,
            f(low),
            f(high),
            found,
        )
        return found

    # --- private ---------------------------------------------------------------------------

    def _all(self, moment: Moment) -> tuple[dict[str, Mask], dict[str, tuple[str, ...]]]:
        """Return all masks by name, and parameters with the names of their masks; with the mask
        that affectors of the role mask make."""
        masks = dict(moment.masks)
        masked = dict(moment.masked)
        inside = tuple(
            each
            for each in moment.affectors
            if each.parameters.role == "mask" and each.parameters.enabled
        )
        if inside:
            own = MaskParameters(source="affector", at="current")
            masks[ROLE] = Mask(name=ROLE, parameters=own, frame=np.eye(4), regions=inside)
            for knob in OF_ROLE:
                masked[knob] = (*masked.get(knob, ()), ROLE)
        return masks, masked

    def _source(self, masks: Mapping[str, Mask], mask: Mask, sites: Sites) -> F32:
        """Return the values of a source before they are remapped, in a new array."""
        p, source = mask.parameters, mask.parameters.source
        if source == "masks":
            return self._combined(masks, mask, sites)
        if source == "affector":
            return self._inside(mask, sites)
        if source in ("u", "v"):
            return sites.uv[:, "uv".index(source)].copy()
        if source == "age":
            return sites.ages.copy()
        points = sites.positions(mask)
        out = np.empty(len(points), np.float32)
        if source == "primvar" and mask.primvar is not None:
            out[:] = mask.primvar if sites.rows is None else mask.primvar[sites.rows]
            if sites.rows is not None:
                out[sites.rows == FOREIGN] = 1
        elif source == "noise":
            shape = np.linalg.inv(mask.frame)[:3] / p.size
            time, seed = float(p.speed * sites.seconds), np.uint32(p.seed)
            self._device.run(kernels.noise, points, shape, time, seed, out)
        elif source == "axis":
            shape = np.linalg.inv(mask.frame)[:3]
            self._device.run(kernels.measure, points, shape, "XYZ".index(p.axis), out)
        elif mask.picture is not None:
            self._project(mask, mask.picture, points, out)
        elif mask.level_set is not None:
            self._measure(mask, mask.level_set, points, out)
        elif mask.curves is not None:
            self._follow(mask, mask.curves, points, out)
        else:
            out[:] = 0
        return out

    def _combined(self, masks: Mapping[str, Mask], mask: Mask, sites: Sites) -> F32:
        """Combine the inputs of a mask in their order."""
        first, *others = mask.parameters.inputs
        found = self.values(masks, first, sites)
        for other in others:
            operation = _OPERATIONS[mask.parameters.operation]
            self._device.run(kernels.combine, operation, self.values(masks, other, sites), found)
        return found

    def _inside(self, mask: Mask, sites: Sites) -> F32:
        """Return the largest weight of affectors."""
        points = sites.positions(mask)
        found = np.zeros(len(points), np.float32)
        for each in mask.regions:
            if not each.parameters.enabled:
                continue
            meshes = self._fields.setdefault(each.path, Fields(self._device))
            weight = falloff(self._device, each, points, fields=meshes)
            part = np.clip(np.float32(each.parameters.amount) * weight, 0, 1)
            np.maximum(found, part, out=found)
        return found

    def _project(self, mask: Mask, picture: Picture, points: F32, out: F32) -> None:
        p = mask.parameters
        to_frame = picture.to_clip if picture.to_clip is not None else np.linalg.inv(mask.frame)
        self._device.run(
            kernels.project, points, np.ascontiguousarray(to_frame), _PROJECTIONS[p.projection],
            picture.pixels, _WRAPS[p.wrap], out,
        )  # fmt: skip

    def _measure(self, mask: Mask, level_set: LevelSet, points: F32, out: F32) -> None:
        kept = self._filled.get(mask.name)
        if kept is None or kept[0] is not level_set:
            kept = self._filled[mask.name] = (level_set, filled(self._device, level_set))
        to_grid = level_set.to_grid @ np.linalg.inv(mask.frame)
        size = np.float32(1 / np.cbrt(abs(np.linalg.det(to_grid[:3, :3]))))
        shape = np.ascontiguousarray(to_grid[:3])
        self._device.run(kernels.distance, points, shape, kept[1].voxels, size, out)
        self._fade(mask, out)

    def _follow(self, mask: Mask, curves: Surface, points: F32, out: F32) -> None:
        kept = self._curves.get(mask.name)
        if kept is None or kept[0] is not curves:
            kept = self._curves[mask.name] = (curves, Triangles(self._device, curves))
        p = mask.parameters
        reach = max(p.radius + p.falloff, 0.0) * 1.001
        squared = kept[1].closest(points, within=reach).squared
        np.sqrt(squared, out=out)
        self._fade(mask, out)

    def _fade(self, mask: Mask, distances: F32) -> None:
        p = mask.parameters
        self._device.run(kernels.fade, np.float32(p.radius), np.float32(p.falloff), distances)


def _sites(state: State, seconds: float, *, at_rest: bool) -> Sites:
    """Return the splats of a state as sites."""
    return Sites(
        rest=state.rest_positions,
        current=state.rest_positions if at_rest else state.positions,
        uv=state.uv,
        ages=(seconds - state.births.astype(np.float64)).astype(np.float32),
        rows=state.memory.get(ROWS),
        seconds=seconds,
    )


def _closure(masks: Mapping[str, Mask], mask: Mask) -> Iterator[Mask]:
    """Yield a mask and its inputs."""
    yield mask
    if mask.parameters.source == "masks":
        for name in mask.parameters.inputs:
            yield from _closure(masks, masks[name])


def _key(masks: Mapping[str, Mask], mask: Mask, knob: str) -> str:
    """Return the name under which the mask of a parameter is kept."""
    is_moved = any(each.parameters.at != "rest" for each in _closure(masks, mask))
    return mask.name + AT_REST if is_moved and knob.startswith(_TARGETS) else mask.name


def _is_same(before: tuple[Mask, ...], now: tuple[Mask, ...]) -> bool:
    """Return whether the values of a mask are those of the last substep, if no splat has moved at
    rest: the masks are the same objects and depend on nothing that changes."""
    return len(before) == len(now) and all(
        old is new and _is_steady(new) for old, new in zip(before, now, strict=True)
    )


def _is_steady(mask: Mask) -> bool:
    """Return whether the values of a mask are the same while its object is."""
    p = mask.parameters
    return p.source in _STEADY and p.at == "rest" and not (p.source == "noise" and p.speed)


def _limited(factor: F32, parameters: object, name: str) -> F32:
    """Limit a factor, so that a parameter times it is within the parameter's range."""
    item = next(each for each in knobs(type(parameters)) if camel(each.name) == name)
    value = getattr(parameters, item.name)
    if item.range is None or not isinstance(value, float) or value == 0:
        return factor
    low, high = sorted((item.range[0] / value, item.range[1] / value))
    if math.isinf(low) and math.isinf(high):
        return factor
    return np.clip(factor, np.float32(low), np.float32(high))
