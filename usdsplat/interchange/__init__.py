"""Convert captures to stages and back, with axes, unit, colour space and provenance."""

from __future__ import annotations

from usdsplat.interchange.cameras import CameraReport, import_cameras
from usdsplat.interchange.converting import convert
from usdsplat.interchange.exporting import export_capture, export_each, export_stage
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import (
    ExportOptions,
    ImportOptions,
    SequenceOptions,
    StageReading,
)
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import (
    ExportReport,
    ImportReport,
    RepackReport,
    SequenceExportReport,
    SequenceImportReport,
    SplitReport,
)
from usdsplat.interchange.sequence_exporting import export_sequence
from usdsplat.interchange.sequences import import_sequence
from usdsplat.interchange.tree_reading import TreeChoice, ViewChoice

__all__ = [
    "CameraReport",
    "ExportOptions",
    "ExportReport",
    "ImportOptions",
    "ImportReport",
    "RepackReport",
    "SequenceExportReport",
    "SequenceImportReport",
    "SequenceOptions",
    "SplitReport",
    "StageReading",
    "TreeChoice",
    "ViewChoice",
    "convert",
    "export_capture",
    "export_each",
    "export_sequence",
    "export_stage",
    "import_cameras",
    "import_capture",
    "import_sequence",
    "repack",
]
