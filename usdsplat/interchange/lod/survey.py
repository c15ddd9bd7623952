"""Survey the inputs of a tree: counts, bounds and metadata, and where the inputs meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from usdsplat.core import axes
from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.wording import counted
from usdsplat.interchange.lod.runs import Cube
from usdsplat.interchange.outliers import weighted_median
from usdsplat.schema import DrawingHints

SAMPLED = 100_000
"""Approximate number of splats of an input from which its size is estimated."""
OUTLYING = 0.01
"""Part of the centres, at either end of each axis, that may be far from the others."""
MOST_NOTES = 20
"""Largest number of notes on the inputs."""
MARGIN = 4.0
"""Factor from the box of the centres that are no outliers to the cube that divides them."""

SAME = 1e-5
"""Relative difference below which footprints are the same: USD stores single precision."""

Triple = tuple[float, ...]
"""x, y and z."""
Words = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What is known of an input before its splats are sorted. Lengths are in its own units."""

    name: str
    files: tuple[str, ...]
    """Files that hold the input."""
    parts: tuple[int, ...]
    """Number of splats of each part: a capture, or an appearance of a field on a stage."""
    degree: int
    low: Triple
    """Lower corner of the box around all centres."""
    high: Triple
    core_low: Triple
    """Lower corner of the box around the centres that are no outliers."""
    core_high: Triple
    pixel: float
    """Size of a pixel of the photographs, authored or estimated."""
    frame: str
    """Directions of x, y and z."""
    frame_source: str
    frame_score: float
    """Score of the evidence for `frame`, if that is its source, else 0."""
    meters_per_unit: float | None
    unit_source: str
    antialiased: bool
    projection_modes: Words
    """Projection modes of its parts, each once, see `DrawingHints`."""
    sorting_modes: Words
    """Sorting modes of its parts, each once."""
    footprints: tuple[float, float]
    """Smallest and largest footprint of its parts; 0 for a part without one."""
    color_space: str
    format: str
    error_bounds: dict[str, str]
    notes: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of splats."""
        return sum(self.parts)

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Survey:
        """Return the survey of which `value` is the `as_json`, after it was stored as JSON."""
        values: dict[str, Any] = {
            name: tuple(each) if isinstance(each, list) else each for name, each in value.items()
        }
        return cls(**values)

    def as_json(self) -> dict[str, object]:
        """Return the survey as values of JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Meeting:
    """The coordinates and the properties that all inputs share in the tree."""

    frame: str
    """Axes of the tree's own coordinates: those of the first input."""
    frame_source: str
    """Source of these axes, see `Capture.frame_source`."""
    meters_per_unit: float | None
    """Unit of these coordinates; None if no input states one."""
    maps: tuple[F64, ...]
    """From the coordinates of each input to the tree's, shape (4, 4)."""
    cube: Cube
    degree: int
    color_space: str
    drawing: DrawingHints
    """Hints of the tree: those of the inputs where all of them agree."""
    pixel: float
    """Size of the pixel of the baked low-pass [unit of the tree]."""
    notes: tuple[str, ...]


def meet(surveys: Sequence[Survey], *, sh_degree: int | None, pixel: float | None) -> Meeting:
    """Return the common coordinates of the inputs, which are those of the first.

    An input without a unit is assumed to have that of the first input that states one.

    Args:
        surveys: One for each input.
        sh_degree: Highest degree of the harmonics; None for that of the inputs.
        pixel: Pixel of the baked low-pass [unit of the tree]; None for that of the inputs.

    Raises:
        UsageError: If colour spaces differ, or the pixel is larger than all inputs.
        StageError: If there is no splat.
    """
    surveys, notes = _with_shared_axes(surveys)
    first = surveys[0]
    for each in surveys:
        if each.color_space != first.color_space:
            expected = f"{first.color_space} as in {first.name}"
            raise UsageError(each.name, f"colours in {each.color_space}", expected)
    if not sum(each.count for each in surveys):
        raise StageError(first.name, "no splats", "one or more")
    unit = next((s.meters_per_unit for s in surveys if s.meters_per_unit is not None), None)
    factors = [
        1.0 if s.meters_per_unit is None or unit is None else s.meters_per_unit / unit
        for s in surveys
    ]
    maps = []
    for each, factor in zip(surveys, factors, strict=True):
        matrix = np.eye(4)
        matrix[:3, :3] = factor * axes.change(each.frame, first.frame)
        maps.append(matrix)
    antialiased, cube = all(each.antialiased for each in surveys), _cube(surveys, maps)
    if pixel is not None and pixel > cube.edge:
        expected = f"0 to {cube.edge:.4g}, the size of all inputs"
        raise UsageError("pixel", f"{pixel:g}", expected)
    if pixel is None:
        sizes = [each.pixel * factor for each, factor in zip(surveys, factors, strict=True)]
        counts = [each.count for each in surveys]
        pixel = 0.0 if antialiased else weighted_median(np.array(sizes), np.array(counts))
    degree = max(each.degree for each in surveys)
    drawing, differences = _hints(surveys, factors)
    return Meeting(
        frame=first.frame,
        frame_source=first.frame_source,
        meters_per_unit=unit,
        maps=tuple(maps),
        cube=cube,
        degree=degree if sh_degree is None else min(degree, sh_degree),
        color_space=first.color_space,
        drawing=replace(drawing, rasterize_mode="antialiased" if antialiased else "classic"),
        pixel=pixel,
        notes=tuple(dict.fromkeys([*notes, *_notes(surveys, factors), *differences])),
    )


def _hints(surveys: Sequence[Survey], factors: Sequence[float]) -> tuple[DrawingHints, list[str]]:
    """Return the drawing hints on which all inputs agree, and notes on the others.

    Args:
        surveys: One for each input, each with one part at least.
        factors: From the unit of each input to the tree's.
    """
    notes = []
    shared: dict[str, str] = {}
    for name in ("projection_mode", "sorting_mode"):
        modes = {mode for each in surveys for mode in getattr(each, f"{name}s")}
        if len(modes) == 1:
            shared[name] = modes.pop()
        else:
            words = name.replace("_", " ")
            notes.append(f"inputs have different {words}s; the tree has the default of USD")
    sizes = np.array([each.footprints for each in surveys]) * np.array(factors)[:, None]
    low, high = float(sizes.min()), float(sizes.max())
    is_shared = 0 < high <= low * (1 + SAME)
    if high and not is_shared:
        notes.append("inputs have different footprints, or some have none; the tree has none")
    return DrawingHints(**shared, footprint=low if is_shared else None), notes


def core_box(positions: F32) -> tuple[F64, F64]:
    """Return the box around the centres that are no outliers; points are finite, at least one."""
    low, high = np.quantile(positions.astype(np.float64), (OUTLYING, 1 - OUTLYING), axis=0)
    return low, high


def _cube(surveys: Sequence[Survey], maps: Sequence[F64]) -> Cube:
    """Return the cube that divides the splats: it contains all that are no outliers."""
    filled = [(s, m) for s, m in zip(surveys, maps, strict=True) if s.count]
    boxes = [[_placed(s.low, s.high, m), _placed(s.core_low, s.core_high, m)] for s, m in filled]
    low, core_low = np.min([[box[0] for box in pair] for pair in boxes], axis=0)
    high, core_high = np.max([[box[1] for box in pair] for pair in boxes], axis=0)
    middle, half = 0.5 * (core_low + core_high), 0.5 * MARGIN * (core_high - core_low).max()
    low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    edge = float((high - low).max())
    return Cube(low=low, edge=edge if edge > 0 else 1.0)


def _placed(low: Triple, high: Triple, matrix: F64) -> tuple[F64, F64]:
    """Return a box after a signed permutation with a scale."""
    corners = np.array([low, high]) @ matrix[:3, :3].T
    return corners.min(axis=0), corners.max(axis=0)


def _with_shared_axes(surveys: Sequence[Survey]) -> tuple[list[Survey], list[str]]:
    """Return the surveys with one choice of axes for all inputs that do not state them, which are
    assumed to be tiles of one capture, and notes."""
    open_ones = [each for each in surveys if each.frame_source in ("evidence", "assumed")]
    scores: dict[str, float] = {}
    for each in open_ones:
        scores[each.frame] = scores.get(each.frame, 0.0) + each.frame_score
    if len(scores) < 2:
        return list(surveys), []
    frame = max(scores, key=lambda name: scores[name])
    source = "evidence" if scores[frame] > 0 else "assumed"
    turned = sum(each.frame != frame for each in open_ones)
    note = f"inputs do not state their axes: {frame!r} by most of the evidence, also for {turned} "
    note += "that suggest others"
    shared = [
        replace(each, frame=frame, frame_source=source, notes=()) if each in open_ones else each
        for each in surveys
    ]
    return shared, [note]


def _notes(surveys: Sequence[Survey], factors: Sequence[float]) -> list[str]:
    """Return the notes of all inputs, and those on their differences."""
    first = surveys[0]
    known = next((s for s in surveys if s.meters_per_unit is not None), first)
    told: dict[str, list[str]] = {}
    for each, factor in zip(surveys, factors, strict=True):
        notes = list(each.notes)
        if each.frame != first.frame:
            notes.append(f"turned from {each.frame} to {first.frame}")
        if factor != 1:
            notes.append(f"scaled by {factor:g} to the unit of {known.name}")
        if each.meters_per_unit is None and known.meters_per_unit is not None:
            notes.append(f"no unit of length is stated: that of {known.name} is assumed")
        for note in notes:
            told.setdefault(note, []).append(each.name)
    found = [_with_names(note, names, len(surveys)) for note, names in told.items()]
    if len({each.antialiased for each in surveys}) > 1:
        found.append("inputs have different rasterize modes; the tree states classic for all")
    more = len(found) - MOST_NOTES
    return found if more <= 0 else [*found[:MOST_NOTES], counted(more, "further note")]


def _with_names(note: str, names: Sequence[str], inputs: int) -> str:
    """Return a note with the inputs that it is on, if there are several."""
    if inputs == 1:
        return note
    if len(names) == 1:
        return f"{Path(names[0]).name}: {note}"
    return f"{len(names)} inputs: {note}"
