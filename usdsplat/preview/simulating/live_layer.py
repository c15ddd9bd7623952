"""Frames of a running simulation: values while it plays, and an anonymous sublayer of the session
layer.

A frame is kept as it was computed, and pictures at its time are drawn from it. All frames are
authored when the simulation pauses or ends, or when a picture or a recording needs the stage at
another time. Like a bake, the layer holds only attributes that the simulation changes, sampled at
the frames' times, so that one can go back in time; both ways give the same picture, to the bit. If
values and samples together exceed a memory budget, the oldest frames are dropped. Unlike a bake it
has no velocities.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.system_memory import free
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.products.live import LiveHistory
from usdsplat.schema import stock, tokens
from usdsplat.schema.vt import as_float32, to_vt
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.bake_dense import KINDS, stored
from usdsplat.sim.stage.plan import ARRAYS, BakedField, plan
from usdsplat.sim.stage.sample_layer import SampleLayer, sampled
from usdsplat.sim.stage.trees import author_replacement
from usdsplat.sim.state import Frame

Array = npt.NDArray[Any]
_Type = Sdf.ValueTypeNames

BUDGET = 2_000_000_000
"""Maximum memory of frames [byte]."""
SHARE = 0.25
"""Maximum fraction of the free memory."""
_PARAMETERS = BakeParameters(mode="dense", velocities=False)
_HARMONICS = (tokens.SH_COEFFICIENTS, tokens.SH_COEFFICIENTS_HALF)
_KINDS = {
    **KINDS,
    tokens.EXTENT: (_Type.Float3Array, Vt.Vec3fArray),
    tokens.IDS: (_Type.Int64Array, Vt.Int64Array),
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Value:
    """An attribute's value at a frame."""

    path: str
    name: str
    kind: Sdf.ValueTypeName
    value: Any
    """Value as a Vt array."""
    bytes: int = 0
    """Memory in addition to earlier frames [byte]."""
    elements: int = 1
    """Number of array elements per splat."""


class LiveLayer:
    """The frames of all fields of a simulation.

    `put` belongs to the simulation's thread; all else is for whoever holds the stage's lock.

    Args:
        stage: Stage whose session layer gets the new sublayer, which is empty at first.
        fields: Simulated fields.
        budget: Maximum memory of frames [byte]; None is `budget_now`. At least two frames are kept.

    Raises:
        StageError: If a field cannot be written.
    """

    def __init__(
        self, stage: Usd.Stage, fields: Sequence[BakedField], *, budget: float | None = None
    ) -> None:
        self._stage = stage
        self._budget = budget_now() if budget is None else budget
        self._plans = {field.path: plan(stage, field, _PARAMETERS) for field in fields}
        self._sampled = {
            field.path: frozenset(field.writes)
            if field.is_fixed
            else frozenset(self._plans[field.path].names)
            for field in fields
        }
        self._counted = {field.path: not field.is_fixed for field in fields}
        self._last: dict[tuple[str, str], tuple[Array, Any]] = {}
        self._moving = frozenset(path for path, said in self._plans.items() if said.moves)
        self._values = LiveHistory({field.path: field.rest for field in fields})
        self._shown: tuple[LiveClouds, LiveClouds] | None = None
        """The value that was drawn last: as it was put, and as it is drawn."""
        self._times: deque[float] = deque()
        self._sizes: deque[int] = deque()
        self._size = 0
        self._has_begun = False
        self._layer = Sdf.Layer.CreateAnonymous("live.usda")
        self._layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()
        stage.GetSessionLayer().subLayerPaths.insert(0, self._layer.identifier)

    @property
    def identifier(self) -> str:
        """Identifier of the layer."""
        return str(self._layer.identifier)

    @property
    def frames(self) -> tuple[float, float] | None:
        """First and last available frame [time code]."""
        times = (*self._times, *self._values.times)
        return (times[0], times[-1]) if times else None

    @property
    def size(self) -> int:
        """Memory of all frames [byte]."""
        return self._size + self._values.bytes

    @property
    def is_over(self) -> bool:
        """Whether there are frames to be dropped."""
        return self.size > self._budget

    @property
    def is_empty(self) -> bool:
        """Whether nothing was authored yet."""
        return not self._has_begun

    def put(self, time: float, frames: Mapping[str, Frame]) -> None:
        """Keep a frame of all fields as a value; needs no lock.

        Args:
            time: Time of the frame, after the existing ones [time code].
            frames: By path of the field.
        """
        clouds = {path: self._kept(path, each.cloud) for path, each in frames.items()}
        self._values.put(LiveClouds(time=time, clouds=clouds, moving=self._moving))

    def shown_at(self, time: float | None) -> LiveClouds | None:
        """Return what to draw in place of the stage at a time; None if the stage has it.

        Frames are authored if the stage needs them at this time.
        """
        if time is None or not self._values.times:
            return None
        found = self._values.at(time)
        if found is None or not self._counts():
            if not self._times or time > self._times[-1]:
                self.author()
            return None
        if self._shown is None or self._shown[0] is not found:
            clouds = {path: self._drawn(path, each) for path, each in found.clouds.items()}
            self._shown = found, replace(found, clouds=clouds)
        return self._shown[1]

    def author(self) -> None:
        """Author all frames that are still values, and release these."""
        part, self._shown = SampleLayer(self._layer), None
        with Sdf.ChangeBlock():
            for frame in self._values.take():
                values = [
                    value
                    for path, cloud in frame.live.clouds.items()
                    for value in self._made(path, cloud)
                ]
                if not self._has_begun:
                    self._begin(part, values)
                for each in values:
                    name = f"{each.path}.{each.name}"
                    self._layer.SetTimeSample(name, frame.live.time, each.value)
                self._times.append(frame.live.time)
                self._sizes.append(sum(each.bytes for each in values))
                self._size += self._sizes[-1]
        self.trim()

    def trim(self) -> None:
        """Drop the oldest frames beyond the budget; two are kept in any case."""
        while self.is_over and len(self._times) + len(self._values.times) > 2:
            if self._times:
                self._forget()
            else:
                self._values.forget()

    def remove(self) -> None:
        """Remove the layer from the stage; requires its lock."""
        self._last.clear()
        for _ in self._values.take():
            pass
        while self._times:
            self._forget()  # one by one, so that other threads can run
        self._layer.Clear()
        session = self._stage.GetSessionLayer()
        if self.identifier in list(session.subLayerPaths):
            session.subLayerPaths.remove(self.identifier)

    # --- private ---------------------------------------------------------------------------

    def _kept(self, path: str, cloud: SplatCloud) -> SplatCloud:
        """Return a frame with the capture's own arrays where it is the same."""
        rest = self._plans[path].rest
        kept = {name: getattr(rest, name) for name in ARRAYS if name not in self._sampled[path]}
        if not self._counted[path]:
            kept["ids"] = rest.ids
        return replace(cloud, velocities=None, **kept)

    def _drawn(self, path: str, cloud: SplatCloud) -> SplatCloud:
        """Return a frame as it would be read from the layer."""
        said, halves = self._plans[path], tokens.HALF_OF.values()
        found: dict[str, Any] = {
            array: as_float32(stored(name, getattr(cloud, array)).astype(np.float16))
            for array, name in said.names.items()
            if name in halves
        }
        turned = found.get("rotations", cloud.rotations)
        return replace(cloud, **{**found, "rotations": stock.unit(turned)})

    def _counts(self) -> bool:
        """Return whether no opinion on the stage is stronger than this layer."""
        for path, said in self._plans.items():
            prim = self._stage.GetPrimAtPath(path)
            for array, name in said.names.items():
                if array in self._sampled[path]:
                    stack = prim.GetAttribute(name).GetPropertyStack() if prim else ()
                    if not stack or stack[0].layer != self._layer:
                        return False
        return True

    def _made(self, path: str, cloud: SplatCloud) -> list[Value]:
        """Convert a field's frame to USD values; this takes most of the time."""
        said = self._plans[path]
        found = [
            self._value(path, name, getattr(cloud, array))
            for array, name in said.names.items()
            if array in self._sampled[path]
        ]
        if said.moves:
            box = schema.compute_extent(cloud, slack=said.keeping.slack)
            found.append(self._value(path, tokens.EXTENT, box))
        if self._counted[path] and cloud.ids is not None:
            found.append(self._value(path, tokens.IDS, cloud.ids))
        return found

    def _value(self, path: str, name: str, value: Array) -> Value:
        """Convert a value to USD; reuse that of the last frame for an identical array."""
        kind, vt = _KINDS[name]
        elements = value.shape[1] if value.ndim == 3 else 1
        last = self._last.get((path, name))
        if last is not None and last[0] is value:
            return Value(path=path, name=name, kind=kind, value=last[1], elements=elements)
        made = to_vt(stored(name, _rows(value)), vt)
        if value.ndim == 3:
            self._last[path, name] = value, made
        size = np.asarray(made).nbytes
        return Value(path=path, name=name, kind=kind, value=made, bytes=size, elements=elements)

    def _begin(self, part: SampleLayer, values: Sequence[Value]) -> None:
        """Write constant attributes, and declare the varying ones."""
        self._has_begun = True
        for path, said in self._plans.items():
            part.prim(path, said.retype)
            if said.retype:
                degree = part.attribute(path, tokens.SH_DEGREE, _Type.Int, uniform=True)
                degree.default = said.rest.sh_degree
            if said.rasterize_mode:
                author_replacement(part, path, said.rasterize_mode, said.lod_root)
            if said.block_velocities:
                speeds = part.attribute(path, tokens.VELOCITIES, _Type.Vector3fArray)
                speeds.default = Sdf.ValueBlock()
            for array in sorted(said.names.keys() - self._sampled[path]):
                each = self._value(path, said.names[array], getattr(said.rest, array))
                _declared(part, each).default = each.value
        for each in values:
            spec = _declared(part, each)
            if self._plans[each.path].retype and each.name == tokens.POSITIONS:
                spec.default = Sdf.ValueBlock()  # other types' arrays have no default value

    def _forget(self) -> None:
        """Remove the oldest frame."""
        time = self._times.popleft()
        self._size -= self._sizes.popleft()
        for path in sampled(self._layer):
            self._layer.EraseTimeSample(path, time)


def budget_now() -> float:
    """Return `BUDGET`, or a fraction of the free memory if that is less."""
    known = free()
    return min(BUDGET, SHARE * known) if known else BUDGET


def _rows(value: Array) -> Array:
    """Return an array as USD has it: harmonics as rows of colours."""
    return value.reshape(-1, 3) if value.ndim == 3 else value


def _declared(part: SampleLayer, value: Value) -> Sdf.AttributeSpec:
    """Declare the attribute of a value."""
    spec = part.attribute(value.path, value.name, value.kind)
    if value.name in _HARMONICS and not spec.HasInfo("interpolation"):
        spec.SetInfo("elementSize", value.elements)
        spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
    return spec
