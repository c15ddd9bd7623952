"""What one prim says, in rows: properties at a time, metadata, and where it all comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pxr import Usd

from usdsplat.preview.knob_model import Editor

PropertyKind = Literal["computed", "attribute", "connection", "relationship"]
Source = Literal["none", "fallback", "default", "time samples", "value clips", "computed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PropertyRow:
    """One property, or something that is computed of a prim."""

    name: str
    kind: PropertyKind
    type_name: str
    """Such as "point3f[]"; "" for what has none."""
    text: str
    """The value at the time; of an array its count and its first elements."""
    source: Source
    samples: int = 0
    """Time samples that are authored."""
    layer: str = ""
    """Name of the layer with the strongest opinion; "" where there is none."""
    is_custom: bool = False
    is_edited: bool = False
    """Whether the session layer has an opinion of it."""
    editor: Editor | None = None
    """How it may be changed; None for what `Edits.set_value` is not for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetadataRow:
    """One field of a prim itself."""

    name: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcRow:
    """One opinion about a prim, the strongest first."""

    kind: str
    """How it comes in: "root", "reference", "payload", "variant", "inherit", ..."""
    path: str
    """Of the prim spec in its layer."""
    layer: str
    """Name of the layer."""
    identifier: str
    """The whole name of the layer, a file where it has one."""
    has_specs: bool
    """Whether the layer says anything there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRow:
    """One layer of the stage's stack, the strongest first."""

    name: str
    identifier: str
    depth: int
    """Below how many layers it is stacked."""
    is_muted: bool
    is_dirty: bool
    is_session: bool


def properties(
    stage: Usd.Stage, path: str, *, time: float | None = None
) -> tuple[PropertyRow, ...]:
    """Everything that a prim says at a time: what is computed first, then properties by name.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError


def metadata(stage: Usd.Stage, path: str) -> tuple[MetadataRow, ...]:
    """The fields of a prim, by name.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError


def composition(stage: Usd.Stage, path: str) -> tuple[ArcRow, ...]:
    """Where a prim's opinions come from, the strongest first.

    Raises:
        StageError: If there is no such prim.
    """
    raise NotImplementedError


def layer_stack(stage: Usd.Stage) -> tuple[LayerRow, ...]:
    """The stage's own layers, the strongest first."""
    raise NotImplementedError
