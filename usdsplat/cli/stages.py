"""Open what a command is pointed at: a stage as its user wants it, or a capture as a stage."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from pxr import Usd

from usdsplat.cli import console
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.files import composition_remarks, is_usd
from usdsplat.interchange.opening import open_as_asked, open_capture


def open_stage_or_capture(
    path: Path,
    options: StageOptions,
    *,
    axes: str | None = None,
    keep: tuple[str, ...] = (),
    progress: Progress = silent,
) -> Usd.Stage:
    """Open a stage as `open_stage` does, or import a capture onto a stage in memory.

    Args:
        path: A file that USD reads, or a capture.
        options: As for `open_stage`; none for a capture.
        axes: Where x, y and z of a capture point; None believes the file.
        keep: As for `open_stage`.
        progress: Told about reading a capture.

    Raises:
        UsageError: If options for stages are given for a capture or the other way around, and as
            `open_stage` does.
        FormatError: If a capture is not what it claims to be.
    """
    if is_usd(path):
        if axes is not None:
            raise UsageError("--axes", "a stage, which says where its axes point", "a capture")
        return open_stage(path, options, keep=keep)
    check_no_stage_options(path, options)
    return open_capture(path, axes=axes, progress=progress)


def check_no_stage_options(path: Path, options: StageOptions) -> None:
    """Refuse what does nothing for a capture.

    Raises:
        UsageError: If an option was given, the first of them named.
    """
    for item in fields(options):
        if getattr(options, item.name) != item.default:
            flag = f"--{item.name.replace('_', '-')}"
            raise UsageError(flag, f"a capture, {path}", "a stage")


def open_stage(path: Path, options: StageOptions, *, keep: tuple[str, ...] = ()) -> Usd.Stage:
    """Open a stage; the file, and the session layer that was given, are only read.

    What it could not be composed of is remarked on, a sentence each.

    Args:
        path: A file that USD reads.
        options: What to load of it, and how.
        keep: Paths of prims that are loaded whatever the mask is, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or has no prim, variant or layer of a given name.
        UsageError: If an option cannot be understood.
    """
    stage = open_as_asked(
        path,
        variants=options.variant,
        mute=options.mute,
        mask=options.mask,
        session_layer=options.session_layer,
        keep=keep,
    )
    for remark in composition_remarks(stage):
        console.remark(remark)
    return stage
