"""Export the visible splats of a stage to a file of any format, as `usdsplat convert` does."""

from __future__ import annotations

from pathlib import Path

from pxr import Usd

from usdsplat import formats
from usdsplat.core.errors import UnknownFormatError
from usdsplat.core.findings import Finding
from usdsplat.images.background import NAMES
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.files import PAGE_SUFFIX, SUFFIXES, is_page, is_usd
from usdsplat.interchange.options import ExportOptions, StageReading
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.saving import check_not_read
from usdsplat.preview.stage_model.cameras import author_view
from usdsplat.preview.values import ViewState
from usdsplat.products.page import PageRequest, write_page
from usdsplat.sim.stage.twins import twin


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that can be written."""
    return (*formats.suffixes_written(), *SUFFIXES, PAGE_SUFFIX)


def export_seen(document: Document, state: ViewState, path: Path | str) -> str:
    """Write the visible splats, with the edits of the session; a task for a session.

    A capture has the visible fields of the purposes that the viewport shows, at its time and in
    world space; crops and grades are not applied to it, as captures have none. A USD file is the
    whole stage in one layer, which keeps them, and its animation. A page for browsers is seen by
    the camera of the viewport.

    Args:
        document: Document of the stage.
        state: State of the viewport.
        path: A file of a format that `formats` writes, a USD file, or a page.

    Returns:
        A sentence about the result, for the user.

    Raises:
        UnknownFormatError: If the suffix is another one.
        OutputError: If the file cannot be written, or is read by the stage.
        StageError: If the stage has no visible splats.
    """
    path = Path(path)
    if not str(path).lower().endswith(suffixes()):
        expected = f"one of {', '.join(suffixes())}"
        raise UnknownFormatError(str(path), f"suffix {path.suffix!r}", expected)
    check_not_read(document, (path,))
    if document.simulation is not None:
        document.simulation.author()
    if is_usd(path):
        packed = repack(document.stage, path, form="float", flatten=True)
        return _sentence(path, packed.splats, packed.findings)
    if is_page(path):
        return _page(document, state, path)
    reading = StageReading(time=state.time, purposes=state.purposes)
    written = export_stage(document.stage, path, reading)
    assert isinstance(written, ExportReport)
    return _sentence(path, written.splats, written.findings)


def _page(document: Document, state: ViewState, path: Path) -> str:
    """Write a page that begins with the view."""
    camera, (width, height) = state.camera, state.size
    bounds = document.bounds()
    with document.lock:
        stage = twin(document.stage)  # with one more camera, and not drawn by us
        if isinstance(camera, FreeCamera):
            spec = camera.spec(aspect=width / height, bounds=bounds)
            with Usd.EditContext(stage, stage.GetSessionLayer()):
                camera = author_view(stage, spec)
        name = path.name if document.path is None else document.path.stem
        background = state.display.background
        request = PageRequest(
            camera=camera,
            resolution=state.size,
            purposes=state.purposes,
            title=name,
            background=background if background in NAMES else None,
        )
        written = write_page(stage, path, request=request, export=ExportOptions(time=state.time))
    return f"{_sentence(path, written.splats, written.findings)}: a page for browsers"


def _sentence(path: Path, splats: int, findings: tuple[Finding, ...]) -> str:
    told = "; ".join(found.told for found in findings)
    return f"Wrote {path.name}, {splats:,} splats{f'; {told}' if told else ''}"
