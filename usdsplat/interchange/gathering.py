"""Read captures, join them in common axes and edit them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np

from usdsplat import formats
from usdsplat.core import axes, edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edits import Edit
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture, ReadOptions
from usdsplat.formats.options import READ_OPTIONS
from usdsplat.interchange.editing import bounds_after, edited

_MIXED = "captures have different rasterize modes; the result states classic for all splats"
_EXACT = "exact"


def gather(
    sources: Sequence[Path],
    *,
    axes: str | None = None,
    edits: Sequence[Edit] = (),
    how: ReadOptions = READ_OPTIONS,
    progress: Progress = silent,
) -> Capture:
    """Read captures as one.

    Args:
        sources: Files in any format that `formats` reads, at least one.
        axes: Axes of all captures; None uses those of each file.
        edits: Edits of all splats together, in the first capture's coordinates.
        how: Other options of the readers.
        progress: Receives the progress of reading and editing.

    Raises:
        FormatError: If a source is invalid.
        UsageError: If `axes` is invalid, edits leave no splat, or colour spaces differ.
    """
    how = reading_for(edits, how)
    captures = [formats.read(source, how=how, progress=progress) for source in sources]
    if axes is not None:
        captures = [replace(capture, frame=axes) for capture in captures]
    return edit_capture(joined(captures), edits, progress=progress)


def reading_for(edits: Sequence[Edit], how: ReadOptions = READ_OPTIONS) -> ReadOptions:
    """Return reading options for captures to be edited: accept non-finite numbers if dropped
    later."""
    drops = any(item.name == "drop-nan" for item in edits)
    return replace(how, drop_nonfinite=how.drop_nonfinite or drops)


def joined(captures: Sequence[Capture]) -> Capture:
    """Join captures, with the axes of the first.

    Raises:
        UsageError: If their colour spaces differ.
    """
    first = captures[0]
    if len(captures) == 1:
        return first
    for capture in captures:
        if capture.color_space != first.color_space:
            expected = f"{first.color_space} as in {first.files[0]}"
            raise UsageError(str(capture.files[0]), f"colours in {capture.color_space}", expected)
    clouds = [turned(c.cloud, c.frame, first.frame) for c in captures]
    modes = {capture.antialiased for capture in captures}
    notes = dict.fromkeys(note for capture in captures for note in capture.notes)
    for capture in captures:
        if capture.frame != first.frame:
            notes[f"{capture.files[0].name} was turned from {capture.frame} to {first.frame}"] = (
                None
            )
    if len(modes) > 1:
        notes[_MIXED] = None
    return Capture(
        cloud=edit.merge(clouds),
        format=" + ".join(dict.fromkeys(capture.format for capture in captures)),
        files=tuple(dict.fromkeys(path for capture in captures for path in capture.files)),
        frame=first.frame,
        antialiased=modes == {True},
        color_space=first.color_space,
        error_bounds=reduce(widened, [capture.error_bounds for capture in captures]),
        notes=tuple(notes),
    )


def edit_capture(
    capture: Capture, edits: Sequence[Edit], *, progress: Progress = silent
) -> Capture:
    """Edit a capture in its own coordinates, and update its bounds and notes.

    Raises:
        UsageError: If no splat is left.
    """
    if not edits:
        return capture
    cloud, notes = edited(capture.cloud, edits, progress=progress)
    return replace(
        capture,
        cloud=cloud,
        error_bounds=bounds_after(capture.error_bounds, edits),
        notes=(*capture.notes, *notes),
    )


def fitted(capture: Capture, target: Path) -> Capture:
    """Drop the harmonics that the target's format cannot hold, and add a note.

    Raises:
        UnknownFormatError: If the target's suffix cannot be written.
    """
    degree = formats.degree_written(target)
    if capture.cloud.sh_degree <= degree:
        return capture
    note = f"harmonics above degree {degree} are not written: {target.suffix} cannot store them"
    cloud = edit.with_sh_degree(capture.cloud, degree)
    return replace(capture, cloud=cloud, notes=(*capture.notes, note))


def turned(cloud: SplatCloud, source: str, target: str) -> SplatCloud:
    """Convert a cloud from axes `source` to axes `target`.

    Raises:
        UsageError: If either is not a name of axes.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = axes.change(source, target)
    return edit.transform(cloud, matrix)


def either(first: str, second: str) -> str:
    """Join two descriptions by "or", without repetition."""
    return first if second in (first, *first.split(" or ")) else f"{first} or {second}"


def widened(first: Mapping[str, str], second: Mapping[str, str]) -> Mapping[str, str]:
    """Combine alternative error bounds; missing ones are exact."""
    names = sorted({*first, *second})
    return {name: either(first.get(name, _EXACT), second.get(name, _EXACT)) for name in names}
