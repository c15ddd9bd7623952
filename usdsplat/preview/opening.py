"""Open a stage or a capture to be looked at, and read it again when its files have changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from usdsplat.core.progress import Progress, silent
from usdsplat.preview.document import Document
from usdsplat.preview.values import Event


def open_document(
    path: Path | str,
    *,
    publish: Callable[[Event], None] = lambda event: None,
    device: str = "auto",
    threads: int | None = None,
    variants: tuple[str, ...] = (),
    mute: tuple[str, ...] = (),
    mask: tuple[str, ...] = (),
    session_layer: Path | None = None,
    frame: str | None = None,
    progress: Progress = silent,
) -> Document:
    """Open a stage, or any capture onto a stage in memory; no file is ever written.

    Args:
        path: Of a file that USD reads, or of a capture.
        publish: Told what happens to the document.
        device, threads: As `Engine` takes them.
        variants: Selections, each "/Prim:set=name".
        mute: Regular expressions; layers in whose identifier one is found are left out.
        mask: Paths of the prims to load, and nothing else.
        session_layer: A layer of opinions stronger than the stage's own, weaker than a user's.
        frame: Where x, y and z of a capture point; None believes the file.
        progress: Told about reading a capture.

    Raises:
        UsageError: If an option cannot be understood, or is not for such a file.
        StageError: If USD cannot read it, or has no prim, variant or layer of a given name.
        FormatError: If a capture is not what it claims to be.
        BackendError: If the device is not usable here.
    """
    raise NotImplementedError


def reload(document: Document) -> tuple[str, ...]:
    """Read again what has changed on disk; a user's edits stay. Returns the names of the files.

    A capture is imported anew onto the same stage.

    Raises:
        UsdSplatError: If a file cannot be read; everything stays as it was.
    """
    raise NotImplementedError


def changed_files(document: Document) -> tuple[str, ...]:
    """Names of the files that are other on disk than when they were read, or gone."""
    raise NotImplementedError
