"""Open a stage or a capture for the preview, and reload it when its files have changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

from usdsplat.core.errors import UsageError
from usdsplat.interchange import opening
from usdsplat.interchange.files import is_usd, layer_files
from usdsplat.preview.document import Document
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.sources import Sources, files_of_capture
from usdsplat.preview.values import Busy, Event, Problem
from usdsplat.schema.composition import composition_findings


@dataclass(frozen=True, slots=True, kw_only=True)
class StageLoading:
    """Options for composing and loading a stage."""

    variants: tuple[str, ...] = ()
    """Variant selections, each "/Prim:set=name"."""
    mute: tuple[str, ...] = ()
    """Regular expressions; layers whose identifier matches one are muted."""
    mask: tuple[str, ...] = ()
    """Paths of the prims to load; empty for all."""
    session_layer: Path | None = None
    """A layer of opinions stronger than the stage's own and weaker than the user's edits."""


class _Telling:
    """Progress receiver that publishes each new task, and then each percent of it."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self._publish = publish
        self._label, self._percent = "", 0

    def step(self, label: str, done: int, total: int) -> None:
        percent = 100 * done // max(total, 1)
        if (label, percent) != (self._label, self._percent):
            self._label, self._percent = label, percent
            self._publish(Busy(what=label, done=done, total=total))

    def end(self) -> None:
        if self._label:
            self._publish(Busy(what=""))


def open_document(
    path: Path | str,
    *,
    publish: Callable[[Event], None] = lambda event: None,
    device: str = "auto",
    threads: int | None = None,
    loading: StageLoading = StageLoading(),
    axes: str | None = None,
) -> Document:
    """Open a stage, or a capture as a stage in memory. No file is ever written.

    The user's edits go to a session layer of the document. Everything that could not be composed is
    published as a `Problem`, one sentence each.

    Args:
        path: A file that USD reads, or a capture.
        publish: Receives the document's events, first the progress of reading.
        device, threads: See `Engine`.
        loading: Options for composing a stage; not allowed for a capture.
        axes: Directions of a capture's x, y and z; None takes those of the file.

    Raises:
        UsageError: If an option is invalid, or does not apply to such a file.
        StageError: If USD cannot read the file, or it has no prim, variant or layer of a given
            name.
        FormatError: If a capture is damaged or of another format.
        BackendError: If the device is not usable here.
    """
    path = Path(path)
    sources = Sources(path, is_capture=not is_usd(path), axes=axes)
    if sources.is_capture:
        _check_loading(path, loading)
        sources.note(files_of_capture(path))
        stage = _import(path, axes, publish)
    else:
        if axes is not None:
            raise UsageError("--axes", "a stage, which defines its own axes", "a capture")
        stage = opening.open_as_asked(
            path,
            variants=loading.variants,
            mute=loading.mute,
            mask=loading.mask,
            session_layer=loading.session_layer,
        )
        sources.note(layer_files(stage))
        for found in composition_findings(stage):
            publish(Problem(sentence=found.told))
    document = document_of(stage, path=path, device=device, threads=threads, publish=publish)
    document.sources = sources
    return document


def document_of(
    stage: opening.Stage,
    *,
    path: Path | None = None,
    publish: Callable[[Event], None] = lambda event: None,
    device: str = "auto",
    threads: int | None = None,
) -> Document:
    """Return a document of an open stage, with a runner for its simulations.

    Args:
        stage: The stage; the caller keeps its ownership.
        path: File of the stage, if it has one.
        publish, device, threads: See `open_document`.

    Raises:
        BackendError: If the device is not usable here.
    """
    document = Document(stage, path=path, device=device, threads=threads, publish=publish)
    document.simulation = Runner(document, device=device, threads=threads)
    return document


def reload(document: Document) -> tuple[str, ...]:
    """Reload files that have changed on disk, and return their names. The user's edits stay.

    A capture is imported again onto the same stage. A camera that frames everything is updated.

    Raises:
        UsageError: If a simulation is being recorded, as it reads the same layers.
        UsdSplatError: If a file cannot be read; then nothing changes.
    """
    if document.simulation is not None and document.simulation.is_recording:
        raise UsageError(
            "reload",
            "a simulation that is being recorded",
            "no recording; wait for its end, or Reset",
        )
    sources = document.sources
    changed = _changed(document)
    if sources is not None and sources.is_capture:
        if changed:
            files = files_of_capture(sources.path)
            fresh = _import(sources.path, sources.axes, document.publish)
            document.stage.GetRootLayer().TransferContent(fresh.GetRootLayer())
            sources.forget()
            sources.note(files)
    else:
        opening.reload(document.stage, changed)
        document.edits.follow_rate()
        if sources is not None:
            sources.forget()
            sources.note(layer_files(document.stage))
    document.frame_anew()
    return tuple(path.name for path in changed)


def changed_files(document: Document) -> tuple[str, ...]:
    """Return the names of the files that were changed or deleted on disk since they were read."""
    return tuple(path.name for path in _changed(document))


def _changed(document: Document) -> tuple[Path, ...]:
    sources = document.sources
    if sources is None:
        return ()
    if not sources.is_capture:
        sources.note(layer_files(document.stage))  # the stage may use other files by now
    return sources.changed()


def _import(path: Path, axes: str | None, publish: Callable[[Event], None]) -> opening.Stage:
    """Return a stage in memory with a capture."""
    telling = _Telling(publish)
    try:
        return opening.open_capture(path, axes=axes, progress=telling)
    finally:
        telling.end()


def _check_loading(path: Path, loading: StageLoading) -> None:
    """Reject options that have no effect on a capture."""
    for item in fields(loading):
        if getattr(loading, item.name):
            flag = f"--{item.name.removesuffix('s').replace('_', '-')}"
            raise UsageError(flag, f"a capture, {path}", "a stage")
