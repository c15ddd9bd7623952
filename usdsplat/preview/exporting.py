"""Export the visible splats of a stage to a file of any format, as `usdsplat convert` does."""

from __future__ import annotations

from pathlib import Path

from usdsplat import formats
from usdsplat.core.findings import Finding
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.files import SUFFIXES, is_usd
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport
from usdsplat.preview.document import Document
from usdsplat.preview.saving import check_not_read
from usdsplat.preview.values import ViewState


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that can be written."""
    return (*formats.suffixes_written(), *SUFFIXES)


def export_seen(document: Document, state: ViewState, path: Path | str) -> str:
    """Write the visible splats, with the edits of the session; a task for a session.

    A capture has the visible fields of the purposes that the viewport shows, at its time and in
    world space; crops and grades are not applied to it, as captures have none. A USD file is the
    whole stage in one layer, which keeps them, and its animation.

    Args:
        document: Document of the stage.
        state: State of the viewport.
        path: A file of a format that `formats` writes, or a USD file.

    Returns:
        A sentence about the result, for the user.

    Raises:
        UnknownFormatError: If the suffix is another one.
        OutputError: If the file cannot be written, or is read by the stage.
        StageError: If the stage has no visible splats.
    """
    path = Path(path)
    check_not_read(document, (path,))
    if document.simulation is not None:
        document.simulation.author()
    if is_usd(path):
        packed = repack(document.stage, path, form="float", flatten=True)
        return _sentence(path, packed.splats, packed.findings)
    reading = StageReading(time=state.time, purposes=state.purposes)
    written = export_stage(document.stage, path, reading)
    assert isinstance(written, ExportReport)
    return _sentence(path, written.splats, written.findings)


def _sentence(path: Path, splats: int, findings: tuple[Finding, ...]) -> str:
    told = "; ".join(found.told for found in findings)
    return f"Wrote {path.name}, {splats:,} splats{f'; {told}' if told else ''}"
