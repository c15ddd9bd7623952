"""Reports of conversions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from usdsplat.core.findings import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """Report of the import of a capture."""

    source: str
    """Source file; several are joined by +."""
    target: str
    """Target USD file, or "" for a stage in memory."""
    prim_path: str
    """Path of the field."""
    splats: int
    degree: int
    """Degree of the harmonics, 0 to 4."""
    form: str
    """"float", "half" or "packed"."""
    format: str
    """Format of the capture, such as "SPZ 2"."""
    frame: str
    """Axes of the capture (`core.axes`), as used."""
    frame_source: str
    """Source of the axes: "given", "file", "evidence" or "assumed"."""
    axes: str
    """Change of axes, one sentence."""
    meters_per_unit: float
    """Unit of the stage."""
    cameras: tuple[str, ...] = ()
    """Paths of the cameras of the photographs."""
    edits: tuple[str, ...] = ()
    """Edits in order."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Maximum error by field of the cloud; fields that are not listed are exact."""
    notes: tuple[str, ...] = ()
    """Findings that a user should know, one sentence each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceImportReport(ImportReport):
    """Report of the import of a sequence; `splats` is the sum over all frames."""

    frames: tuple[float, ...]
    """Time codes, ascending."""
    counts: tuple[int, ...]
    """Splats of each frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportReport:
    """Report of the export to a capture file."""

    source: str
    target: str
    prim_paths: tuple[str, ...]
    """Paths of the fields, one for each appearance, those of point instances once; empty if the
    source is a capture."""
    splats: int
    degree: int
    frame: str
    """Axes of the written file."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Maximum error by field of the cloud, relative to the original, or to the stage if that is the
    source; fields that are not listed are exact."""
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    """What the source asks for and does not get."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceExportReport(ExportReport):
    """Report of the export to a sequence; `splats` is the sum over all frames."""

    frames: tuple[float, ...]
    """Time codes, ascending."""
    counts: tuple[int, ...]
    """Splats of each frame."""
    frame_notes: tuple[tuple[str, ...], ...]
    """Notes on each frame. `notes` lists each different note once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitReport:
    """Report of the export of each field to a separate file."""

    source: str
    target: str
    """Target name; each file adds the name of its prim."""
    parts: tuple[ExportReport, ...]
    notes: tuple[str, ...] = ()
    """Notes on the stage; parts have their own."""
    findings: tuple[Finding, ...] = ()
    """What the source asks for and does not get."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RepackReport:
    """Report of the conversion of fields to another storage form."""

    source: str
    target: str
    prim_paths: tuple[str, ...]
    """Paths of the rewritten fields."""
    variants: int
    """Number of rewritten combinations of variants: one for each field whose data depends on no
    variant."""
    samples: int
    """Number of rewritten clouds: one for each field, combination of variants and time sample."""
    splats: int
    """Number of splats in all these clouds."""
    form: str
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    """What the source asks for and does not get."""
