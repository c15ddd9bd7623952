"""The resident splats of one engine. It has not heard of USD."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.extent import extent
from usdsplat.delegate.draw_list import DrawList, draw_list
from usdsplat.delegate.specs import FieldSpec, InstanceSpec

SUBJECT = 0.004
"""Part of the splats, at either end of each axis, that may be stray ones far from the subject."""

Box = tuple[F64, F64]
Drawn = tuple[str, "Field", InstanceSpec]
"""Path of a field, the field, and one of its instances."""


@dataclass(slots=True)
class Field:
    """One range of splats and where it is seen."""

    spec: FieldSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    local: Box | None = None
    """Bounds in its own space, conservative; computed when first asked for."""
    subject: Box | None = None
    """Bounds of the centres without strays; computed when first asked for."""


def matrix(numbers: tuple[float, ...]) -> F64:
    """The 4x4 of a `specs.Matrix`."""
    return np.array(numbers, np.float64).reshape(4, 4)


def _place(box: Box, instances: tuple[InstanceSpec, ...]) -> Box:
    """The box around all instances of a box."""
    m = np.array([each.transform for each in instances]).reshape(-1, 4, 4)
    center = m[:, :3, :3] @ (0.5 * (box[0] + box[1])) + m[:, :3, 3]
    half = np.abs(m[:, :3, :3]) @ (0.5 * (box[1] - box[0]))
    return (center - half).min(axis=0), (center + half).max(axis=0)


def _extent(spec: FieldSpec) -> Box | None:
    """Bounds of what a cloud can touch, in its own space; None when it has no finite splat."""
    box = extent(spec.cloud)
    return None if box is None else (box[0], box[1])


def _subject(spec: FieldSpec) -> Box | None:
    """Bounds of nearly all centres of a cloud, strays left out."""
    positions = spec.cloud.positions
    positions = positions[np.isfinite(positions).all(axis=1)]
    if len(positions) == 0:
        return None
    low, high = np.quantile(
        positions[:: max(1, len(positions) // 100_000)], (SUBJECT, 1 - SUBJECT), axis=0
    )
    return low.astype(np.float64), high.astype(np.float64)


class RenderScene:
    """Fields by prim path, each a resident range of splats with its transforms.

    Nothing here is shared between scenes, and `close` lets go of everything.
    """

    def __init__(self) -> None:
        self._fields: dict[str, Field] = {}
        self._drawn: list[Drawn] | None = None
        self._draw_list: DrawList | None = None

    def set_field(self, path: str, spec: FieldSpec) -> None:
        """Add the field at `path`, or replace its splats."""
        self._forget_order()
        field = self._fields.get(path)
        if field is None:
            self._fields[path] = Field(spec)
        else:
            field.spec, field.local, field.subject = spec, None, None

    def set_instances(self, path: str, instances: tuple[InstanceSpec, ...]) -> None:
        """Say where the field at `path` is seen."""
        self._forget_order()
        self._fields[path].instances = instances

    def set_visible(self, path: str, visible: bool) -> None:
        """Show or hide the field at `path`."""
        self._forget_order()
        self._fields[path].visible = visible

    def remove(self, path: str) -> None:
        """Forget the field at `path`."""
        self._forget_order()
        del self._fields[path]

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of all fields, sorted."""
        return tuple(sorted(self._fields))

    @property
    def splat_count(self) -> int:
        """Splats held; instances count once."""
        return sum(len(field.spec.cloud) for field in self._fields.values())

    def visible_fields(self) -> list[Field]:
        """Fields that are drawn at least once."""
        return [
            field
            for field in self._fields.values()
            if field.visible and field.instances and len(field.spec.cloud)
        ]

    def drawn(self) -> list[Drawn]:
        """Each visible appearance, in the order that breaks ties of depth: by path, then index."""
        if self._drawn is None:
            seen = [
                (path, field, instance)
                for path, field in self._fields.items()
                if field.visible and len(field.spec.cloud)
                for instance in field.instances
            ]
            self._drawn = sorted(seen, key=lambda item: (item[2].path, item[2].index, item[0]))
        return self._drawn

    def draw_list(self) -> DrawList:
        """What is drawn, laid out for the kernels; it stays as it is until the next edit."""
        if self._draw_list is None:
            self._draw_list = draw_list(self.drawn())
        return self._draw_list

    def bounds(self) -> Box | None:
        """Lowest and highest corner in the world of all that may be seen, or None if nothing is."""
        return self._union("local", _extent)

    def subject(self) -> Box | None:
        """Like `bounds`, of splat centres, without the few that lie far from the others."""
        return self._union("subject", _subject)

    def _union(self, name: str, measure: Any) -> Box | None:
        boxes = []
        for field in self.visible_fields():
            if getattr(field, name) is None:
                setattr(field, name, measure(field.spec))
            box = getattr(field, name)
            if box is not None:
                boxes.append(_place(box, field.instances))
        if not boxes:
            return None
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def close(self) -> None:
        """Let go of all arrays."""
        self._forget_order()
        self._fields.clear()

    def _forget_order(self) -> None:
        self._drawn = self._draw_list = None
