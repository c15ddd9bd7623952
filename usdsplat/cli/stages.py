"""Open the input of a command: a stage with the user's options, or a capture as a stage."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from pxr import Usd

from usdsplat.cli.reporting import Reporter
from usdsplat.cli.stage_options import StageOptions
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.files import is_usd
from usdsplat.interchange.opening import open_as_asked, open_capture
from usdsplat.schema.composition import composition_findings
from usdsplat.sim.stage.bake_findings import bake_findings


def open_stage_or_capture(
    path: Path,
    options: StageOptions,
    reporter: Reporter,
    *,
    axes: str | None = None,
    keep: tuple[str, ...] = (),
    progress: Progress = silent,
) -> Usd.Stage:
    """Open a stage, see `open_stage`, or import a capture onto a stage in memory.

    Args:
        path: A file that USD reads, or a capture.
        options: See `open_stage`; all defaults for a capture.
        reporter: See `open_stage`.
        axes: Directions of a capture's x, y and z; None chooses them.
        keep: See `open_stage`.
        progress: Receives the progress of reading a capture.

    Raises:
        UsageError: If options for stages are given for a capture or vice versa, and see
            `open_stage`.
        FormatError: If a capture is damaged or of another format.
    """
    if is_usd(path):
        if axes is not None:
            raise UsageError("--axes", "a stage, which defines its own axes", "a capture")
        return open_stage(path, options, reporter, keep=keep)
    check_no_stage_options(path, options)
    return open_capture(path, axes=axes, progress=progress)


def check_no_stage_options(path: Path, options: StageOptions) -> None:
    """Raise an error for stage options, which have no effect on a capture.

    Raises:
        UsageError: If an option was given; it names the first one.
    """
    for item in fields(options):
        if getattr(options, item.name) != item.default:
            flag = f"--{item.name.replace('_', '-')}"
            raise UsageError(flag, f"a capture, {path}", "a stage")


def open_stage(
    path: Path, options: StageOptions, reporter: Reporter, *, keep: tuple[str, ...] = ()
) -> Usd.Stage:
    """Open a stage. The file and the given session layer are only read.

    Args:
        path: A file that USD reads.
        options: Options for opening.
        reporter: Receives a finding for each composition error, and for missing results of a bake.
        keep: Paths of prims that are loaded regardless of the mask, if they exist.

    Raises:
        StageError: If a layer cannot be opened, or has no prim, variant or layer of a given name.
        UsageError: If an option cannot be parsed.
    """
    stage = open_as_asked(
        path,
        variants=options.variant,
        mute=options.mute,
        mask=options.mask,
        session_layer=options.session_layer,
        keep=keep,
    )
    reporter.findings.extend(composition_findings(stage))
    reporter.findings.extend(bake_findings(stage))
    return stage
