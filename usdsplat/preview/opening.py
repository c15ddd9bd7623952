"""Open a stage or a capture to be looked at, and read it again when its files have changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

from usdsplat.core.errors import UsageError
from usdsplat.interchange import opening
from usdsplat.interchange.files import composition_remarks, is_usd, layer_files
from usdsplat.preview.document import Document
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.sources import Sources, files_of_capture
from usdsplat.preview.values import Busy, Event, Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class StageLoading:
    """What of a stage is composed and loaded."""

    variants: tuple[str, ...] = ()
    """Selections, each "/Prim:set=name"."""
    mute: tuple[str, ...] = ()
    """Regular expressions; layers in whose identifier one is found are left out."""
    mask: tuple[str, ...] = ()
    """Paths of the prims to load, and nothing else; none for all."""
    session_layer: Path | None = None
    """A layer of opinions stronger than the stage's own, weaker than a user's."""


class _Telling:
    """A progress that says what is going on, once for each piece of work."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self._publish = publish
        self._label = ""

    def step(self, label: str, done: int, total: int) -> None:
        if label != self._label:
            self._label = label
            self._publish(Busy(what=label))

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
    """Open a stage, or any capture onto a stage in memory; no file is ever written.

    A user's edits go to a session layer that is the document's own. What a stage could not be
    composed of is published as a `Problem`, a sentence each.

    Args:
        path: Of a file that USD reads, or of a capture.
        publish: Told what happens to the document, first how its reading goes.
        device, threads: As `Engine` takes them.
        loading: What of a stage is composed; a capture takes the default only.
        axes: Where x, y and z of a capture point; None believes the file.

    Raises:
        UsageError: If an option cannot be understood, or is not for such a file.
        StageError: If USD cannot read it, or has no prim, variant or layer of a given name.
        FormatError: If a capture is not what it claims to be.
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
            raise UsageError("--axes", "a stage, which says where its axes point", "a capture")
        stage = opening.open_as_asked(
            path,
            variants=loading.variants,
            mute=loading.mute,
            mask=loading.mask,
            session_layer=loading.session_layer,
        )
        sources.note(layer_files(stage))
        for remark in composition_remarks(stage):
            publish(Problem(sentence=remark))
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
    """Return a document of a stage that is open already, with what simulates it.

    Args:
        stage: Stays whosever it is.
        path: Where it came from, if from a file.
        publish, device, threads: As in `open_document`.

    Raises:
        BackendError: If the device is not usable here.
    """
    document = Document(stage, path=path, device=device, threads=threads, publish=publish)
    document.simulation = Runner(document, device=device, threads=threads)
    return document


def reload(document: Document) -> tuple[str, ...]:
    """Read again what has changed on disk; a user's edits stay. Returns the names of the files.

    A capture is imported anew onto the same stage. A camera that frames everything frames anew.

    Raises:
        UsageError: If a simulation is being recorded, which reads the same layers.
        UsdSplatError: If a file cannot be read; everything stays as it was.
    """
    if document.simulation is not None and document.simulation.is_recording:
        raise UsageError("reload", "a simulation that is being recorded", "its end, or a Reset")
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
        if sources is not None:
            sources.forget()
            sources.note(layer_files(document.stage))
    document.frame_anew()
    return tuple(path.name for path in changed)


def changed_files(document: Document) -> tuple[str, ...]:
    """Names of the files that are other on disk than when they were read, or gone."""
    return tuple(path.name for path in _changed(document))


def _changed(document: Document) -> tuple[Path, ...]:
    sources = document.sources
    if sources is None:
        return ()
    if not sources.is_capture:
        sources.note(layer_files(document.stage))  # others may be in use by now
    return sources.changed()


def _import(path: Path, axes: str | None, publish: Callable[[Event], None]) -> opening.Stage:
    """A stage in memory that holds a capture."""
    telling = _Telling(publish)
    try:
        return opening.open_capture(path, axes=axes, progress=telling)
    finally:
        telling.end()


def _check_loading(path: Path, loading: StageLoading) -> None:
    """Refuse what does nothing for a capture."""
    for item in fields(loading):
        if getattr(loading, item.name):
            flag = f"--{item.name.removesuffix('s').replace('_', '-')}"
            raise UsageError(flag, f"a capture, {path}", "a stage")
