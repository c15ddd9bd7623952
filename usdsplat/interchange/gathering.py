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
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.editing import bounds_after, edited

_MIXED = "captures have different rasterize modes; the result states classic for all splats"
_UNKNOWN_UNIT = "captures do not state a unit of length: the unit of the stage is assumed"
_EXACT = "exact"


def gather(
    sources: Sequence[Path],
    *,
    axes: str | None = None,
    meters_per_unit: float | None = None,
    edits: Sequence[Edit] = (),
    how: ReadOptions = READ_OPTIONS,
    progress: Progress = silent,
) -> Capture:
    """Read captures as one.

    Args:
        sources: Files in any format that `formats` reads, at least one.
        axes: Axes of all captures; None chooses those of each file, see `axes_choice`.
        meters_per_unit: Unit of all captures; None uses that of each file.
        edits: Edits of all splats together, in the first capture's coordinates.
        how: Other options of the readers.
        progress: Receives the progress of reading and editing.

    Raises:
        FormatError: If a source is invalid.
        UsageError: If `axes` is invalid, edits leave no splat, or colour spaces differ.
    """
    how = reading_for(edits, how)
    captures = [formats.read(source, how=how, progress=progress) for source in sources]
    captures = [with_axes(capture, choose_axes(capture, axes)) for capture in captures]
    captures = [with_unit(capture, meters_per_unit) for capture in captures]
    return edit_capture(joined(captures), edits, progress=progress)


def reading_for(edits: Sequence[Edit], how: ReadOptions = READ_OPTIONS) -> ReadOptions:
    """Return reading options for captures to be edited: accept non-finite numbers if dropped
    later."""
    drops = any(item.name == "drop-nan" for item in edits)
    return replace(how, drop_nonfinite=how.drop_nonfinite or drops)


def with_unit(capture: Capture, meters_per_unit: float | None) -> Capture:
    """Return the capture with a given unit instead of its own, and a note if it states another one;
    None leaves its own."""
    if meters_per_unit is None:
        return capture
    notes, own = capture.notes, capture.meters_per_unit
    if own not in (None, meters_per_unit):
        notes += (f"one unit is {meters_per_unit:g} m as given to the import, not {own:g} m",)
    return replace(capture, meters_per_unit=meters_per_unit, unit_source="given", notes=notes)


def unit_assumed(capture: Capture, meters_per_unit: float) -> Capture:
    """Return the capture with a unit, an assumed one if it states none, and a note of that."""
    if capture.meters_per_unit is not None:
        return capture
    return replace(
        capture,
        meters_per_unit=meters_per_unit,
        unit_source="assumed",
        notes=(*capture.notes, _UNKNOWN_UNIT),
    )


def joined(captures: Sequence[Capture]) -> Capture:
    """Join captures, with the axes and the unit of the first.

    Captures without a unit are assumed to have the unit of the first that states one.

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
    known = next((c for c in captures if c.meters_per_unit is not None), first)
    factors = [_ratio(c.meters_per_unit, known.meters_per_unit) for c in captures]
    clouds = [
        turned(c.cloud, c.frame, first.frame, factor)
        for c, factor in zip(captures, factors, strict=True)
    ]
    modes = {capture.antialiased for capture in captures}
    notes = dict.fromkeys(note for capture in captures for note in capture.notes)
    for capture, factor in zip(captures, factors, strict=True):
        name = capture.files[0].name
        if capture.frame != first.frame:
            notes[f"{name} was turned from {capture.frame} to {first.frame}"] = None
        if factor != 1:
            notes[f"{name} was scaled by {factor:g} to the unit of {known.files[0].name}"] = None
        if capture.meters_per_unit is None and known.meters_per_unit is not None:
            notes[f"{name} states no unit of length: that of {known.files[0].name} is assumed"] = (
                None
            )
    if len(modes) > 1:
        notes[_MIXED] = None
    return Capture(
        cloud=edit.merge(clouds),
        format=" + ".join(dict.fromkeys(capture.format for capture in captures)),
        files=tuple(dict.fromkeys(path for capture in captures for path in capture.files)),
        frame=first.frame,
        frame_source=first.frame_source,
        frame_score=first.frame_score,
        meters_per_unit=known.meters_per_unit,
        unit_source=known.unit_source,
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
    cloud, notes = edited(capture.cloud, edits, antialiased=capture.antialiased, progress=progress)
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


def unit_ratio(capture: Capture, target: Path) -> float:
    """Return the factor from the unit of a capture to that of the target's format; 1 if either is
    unknown.

    Raises:
        UnknownFormatError: If the target's suffix cannot be written.
    """
    return _ratio(capture.meters_per_unit, formats.unit_written(target))


def _ratio(source: float | None, target: float | None) -> float:
    """Return the factor between two units [m]; 1 if either is unknown."""
    return 1.0 if source is None or target is None else source / target


def turned(cloud: SplatCloud, source: str, target: str, factor: float = 1.0) -> SplatCloud:
    """Convert a cloud from axes `source` to axes `target`, `factor` times as large.

    Raises:
        UsageError: If either is not a name of axes.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = factor * axes.change(source, target)
    return edit.transform(cloud, matrix)


def either(first: str, second: str) -> str:
    """Join two descriptions by "or", without repetition."""
    return first if second in (first, *first.split(" or ")) else f"{first} or {second}"


def widened(first: Mapping[str, str], second: Mapping[str, str]) -> Mapping[str, str]:
    """Combine alternative error bounds; missing ones are exact."""
    names = sorted({*first, *second})
    return {name: either(first.get(name, _EXACT), second.get(name, _EXACT)) for name in names}
