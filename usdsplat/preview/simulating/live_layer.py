"""Frames of a running simulation on a stage: an anonymous sublayer of the session layer.

Like a bake, it holds only attributes that the simulation changes, sampled at the frames' times, so
that one can go back in time. If that exceeds a memory budget, the oldest frames are dropped. Unlike
a bake it has no velocities, and large harmonics are stored as half: they take most of the memory,
and USD fills its arrays while holding the GIL.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat import schema
from usdsplat.render.memory import free
from usdsplat.schema import tokens
from usdsplat.schema.vt import to_vt
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage.bake_dense import KINDS, stored
from usdsplat.sim.stage.plan import BakedField, Plan, plan
from usdsplat.sim.stage.sample_layer import SampleLayer, sampled
from usdsplat.sim.stage.trees import author_replacement
from usdsplat.sim.state import Frame

Array = npt.NDArray[Any]
_Type = Sdf.ValueTypeNames

BUDGET = 2_000_000_000
"""Maximum memory of frames [byte]."""
SHARE = 0.25
"""Maximum fraction of the free memory."""
LARGE = 64_000_000
"""Size from which harmonics are stored as half [byte]."""
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
    """The live layer of all fields of a simulation.

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
        self._plans = {field.path: _plan(stage, field) for field in fields}
        self._sampled = {
            field.path: frozenset(field.writes)
            if field.is_fixed
            else frozenset(self._plans[field.path].names)
            for field in fields
        }
        self._counted = {field.path: not field.is_fixed for field in fields}
        self._last: dict[tuple[str, str], tuple[Array, Any]] = {}
        self._times: deque[float] = deque()
        self._sizes: deque[int] = deque()
        self._size = 0
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
        return (self._times[0], self._times[-1]) if self._times else None

    @property
    def size(self) -> int:
        """Memory of all frames [byte]."""
        return self._size

    def made(self, path: str, frame: Frame) -> list[Value]:
        """Convert a field's frame to USD values; needs no lock, and takes most of the time."""
        said, cloud = self._plans[path], frame.cloud
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

    def write(self, time: float, values: Sequence[Value]) -> None:
        """Write a frame of all fields; requires the stage's lock.

        Args:
            time: Time of the frame, after the existing ones [time code].
            values: Result of `made`.
        """
        part = SampleLayer(self._layer)
        with Sdf.ChangeBlock():
            if not self._times:
                self._begin(part, values)
            for each in values:
                self._layer.SetTimeSample(f"{each.path}.{each.name}", time, each.value)
        self._times.append(time)
        self._sizes.append(sum(each.bytes for each in values))
        self._size += self._sizes[-1]
        while self._size > self._budget and len(self._times) > 2:
            self._forget()

    def remove(self) -> None:
        """Remove the layer from the stage; requires its lock."""
        self._last.clear()
        while self._times:
            self._forget()  # one by one, so that other threads can run
        self._layer.Clear()
        session = self._stage.GetSessionLayer()
        if self.identifier in list(session.subLayerPaths):
            session.subLayerPaths.remove(self.identifier)

    # --- private ---------------------------------------------------------------------------

    def _value(self, path: str, name: str, value: Array) -> Value:
        """Convert a value to USD; reuse that of the last frame for an identical array."""
        kind, vt = _KINDS[name]
        elements = value.shape[1] if value.ndim == 3 else 1
        last = self._last.get((path, name))
        if last is not None and last[0] is value:
            return Value(path=path, name=name, kind=kind, value=last[1], elements=elements)
        rows = stored(name, value.reshape(-1, 3) if value.ndim == 3 else value)
        made = to_vt(rows, vt)
        if value.ndim == 3:
            self._last[path, name] = value, made
        size = np.asarray(made).nbytes
        return Value(path=path, name=name, kind=kind, value=made, bytes=size, elements=elements)

    def _begin(self, part: SampleLayer, values: Sequence[Value]) -> None:
        """Write constant attributes, and declare the varying ones."""
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
            if each.name == tokens.SH_COEFFICIENTS_HALF:
                # An empty array disables the full-precision attribute.
                kind, vt = KINDS[tokens.SH_COEFFICIENTS]
                part.attribute(each.path, tokens.SH_COEFFICIENTS, kind).default = vt()

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


def _plan(stage: Usd.Stage, field: BakedField) -> Plan:
    """Return the plan of a bake for a field, with large varying harmonics as half."""
    found = plan(stage, field, _PARAMETERS)
    changes = "sh" in field.writes or not field.is_fixed
    if changes and "sh" in found.names and field.rest.sh.nbytes > LARGE:
        return replace(found, names={**found.names, "sh": tokens.SH_COEFFICIENTS_HALF})
    return found


def _declared(part: SampleLayer, value: Value) -> Sdf.AttributeSpec:
    """Declare the attribute of a value."""
    spec = part.attribute(value.path, value.name, value.kind)
    if value.name in _HARMONICS and not spec.HasInfo("interpolation"):
        spec.SetInfo("elementSize", value.elements)
        spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
    return spec
