"""What a conversion did, for people who must trust it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """A capture on a stage."""

    source: str
    """The file; several with + between."""
    target: str
    """The USD file, or "" when it went onto a stage in memory."""
    prim_path: str
    """Where the field is."""
    splats: int
    degree: int
    """Of the harmonics, 0 to 4."""
    form: str
    """"float", "half" or "packed"."""
    format: str
    """The capture's, such as "SPZ 2"."""
    frame: str
    """Where x, y and z of the capture point (`core.axes`), as taken."""
    axes: str
    """How they became the stage's axes, one sentence."""
    meters_per_unit: float
    """Of the stage."""
    cameras: tuple[str, ...] = ()
    """Where the cameras of the photographs are."""
    edits: tuple[str, ...] = ()
    """What was done to the splats before, in this order."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Field of the cloud -> how far it may be from the original; what is not listed is exact."""
    notes: tuple[str, ...] = ()
    """What a careful reader would want to be told, a sentence each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceImportReport(ImportReport):
    """A sequence of captures on a stage; `splats` are those of all frames together."""

    frames: tuple[float, ...]
    """Time codes, ascending."""
    counts: tuple[int, ...]
    """Splats of each frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """Splats of a stage, or of another capture, as a capture file."""

    source: str
    target: str
    prim_paths: tuple[str, ...]
    """The fields, one for each appearance, those of point instances once; empty when the source is
    a capture."""
    splats: int
    degree: int
    frame: str
    """Where x, y and z of the written file point."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Field of the cloud -> how far it may be from the original, or, of a stage, from what
    that says; what is not listed is exact."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceExportReport(ExportReport):
    """A stage as a sequence of captures; `splats` are those of all frames together."""

    frames: tuple[float, ...]
    """Time codes, ascending."""
    counts: tuple[int, ...]
    """Splats of each frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitReport:
    """Fields of a stage as capture files, one for each."""

    source: str
    target: str
    """The file whose name the others have, each with the name of its prim."""
    parts: tuple[ExportReport, ...]
    notes: tuple[str, ...] = ()
    """About the stage; parts have their own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RepackReport:
    """A stage whose fields have another form."""

    source: str
    target: str
    prim_paths: tuple[str, ...]
    """The fields that were rewritten."""
    samples: int
    """Clouds that were rewritten: one for each field and time sample."""
    splats: int
    """In all those clouds together."""
    form: str
    notes: tuple[str, ...] = ()
