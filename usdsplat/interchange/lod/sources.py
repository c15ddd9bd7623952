"""Read the inputs of a tree in parts that fit memory: captures and stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from usdsplat import formats
from usdsplat.core import edit
from usdsplat.core.cloud import F32, F64, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress
from usdsplat.core.sh import coefficient_count
from usdsplat.core.wording import said_bytes
from usdsplat.formats import Capture
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.decimating import FAR_LINES, framing_pixel
from usdsplat.interchange.gathering import with_unit
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.survey import SAMPLED, Survey, core_box

READING = 1.6
"""Memory that reading a capture takes, relative to its splats."""


class Source(Protocol):
    """An input of a tree."""

    path: Path
    files: tuple[Path, ...]
    """The input's file or folder, or the layers of a stage."""

    def survey(self, progress: Progress) -> Survey:
        """Return what is known of the input before its splats are sorted."""

    def rows(self, part: int, first: int, last: int, matrix: F64) -> SplatCloud:
        """Return splats `first` to `last` of a part, transformed from the input's coordinates by
        `matrix`."""

    def findings(self) -> list[Finding]:
        """Return what the input asks for and does not get."""

    def release(self) -> None:
        """Release what is in memory; `rows` reads it again."""


def splat_bytes(degree: int) -> int:
    """Return the size of a splat in memory [byte]."""
    return 4 * (11 + 3 * coefficient_count(degree))


class CaptureSource:
    """A capture in any format that `formats` reads; it is read whole."""

    def __init__(self, path: Path, options: LodOptions) -> None:
        self.path = path
        self.files: tuple[Path, ...] = (path,)
        self._options = options
        self._held: Capture | None = None

    def survey(self, progress: Progress) -> Survey:
        """Read the capture, and keep it for `rows`.

        Raises:
            FormatError: If it is damaged.
            UsageError: If it does not fit in memory, or its axes are invalid.
        """
        capture = self._read(progress)
        cloud = capture.cloud
        few = edit.take(cloud, np.arange(0, len(cloud), max(1, len(cloud) // SAMPLED)))
        boxes = [bounds(cloud.positions)] if len(cloud) else []
        return survey_of(self.path, replace(capture, cloud=few), len(cloud), boxes)

    def rows(self, part: int, first: int, last: int, matrix: F64) -> SplatCloud:
        """Return some splats; `part` is 0."""
        cloud = (self._held or self._read(self._options.reading.progress)).cloud
        return edit.transform(edit.take(cloud, np.arange(first, last)), matrix)

    def findings(self) -> list[Finding]:
        """Return nothing: captures ask for nothing."""
        return []

    def release(self) -> None:
        """Release the capture."""
        self._held = None

    def _read(self, progress: Progress) -> Capture:
        """Read the capture with the axes and the unit that the options give."""
        options = self._options
        capture = formats.read(self.path, how=options.reading, progress=progress)
        capture = described(capture, options)
        size = int(READING * len(capture.cloud) * splat_bytes(capture.cloud.sh_degree))
        check_memory(str(self.path), size, options.memory_limit)
        self._held = replace(capture, cloud=replace(capture.cloud, ids=None, velocities=None))
        return self._held


def described(capture: Capture, options: LodOptions) -> Capture:
    """Return a capture with the axes and the unit that the options give.

    Raises:
        UsageError: If the axes are invalid.
    """
    capture = with_axes(capture, choose_axes(capture, options.axes))
    return with_unit(capture, options.meters_per_unit)


def survey_of(path: Path, capture: Capture, count: int, boxes: Sequence[tuple[F64, F64]]) -> Survey:
    """Return the survey of a capture.

    Args:
        path: The input.
        capture: A sample of its splats, and its description.
        count: Number of its splats.
        boxes: Boxes that together contain all its centres; none without splats.
    """
    cloud = capture.cloud
    low, high, core = np.zeros(3), np.zeros(3), (np.zeros(3), np.zeros(3))
    if boxes and len(cloud):
        low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
        core = core_box(cloud.positions)
    return Survey(
        name=str(path),
        files=tuple(map(str, capture.files)),
        parts=(count,),
        degree=cloud.sh_degree,
        low=tuple(map(float, low)),
        high=tuple(map(float, high)),
        core_low=tuple(map(float, core[0])),
        core_high=tuple(map(float, core[1])),
        pixel=framing_pixel(cloud, FAR_LINES),
        frame=capture.frame,
        frame_source=capture.frame_source,
        frame_score=capture.frame_score or 0.0,
        meters_per_unit=capture.meters_per_unit,
        unit_source=capture.unit_source,
        antialiased=capture.antialiased,
        projection_modes=("perspective",),
        sorting_modes=("zDepth",),
        footprints=(0.0, 0.0),
        color_space=capture.color_space,
        format=capture.format,
        error_bounds=dict(capture.error_bounds),
        notes=capture.notes,
    )


def check_memory(where: str, needed: int, limit: int) -> None:
    """Raise an error if an input that is read whole does not fit in memory.

    Raises:
        UsageError: If it does not.
    """
    if needed > limit:
        found = f"{said_bytes(limit)} for {where}, which takes {said_bytes(needed)}"
        raise UsageError("memory_limit", found, "a higher limit, or the input in several files")


def bounds(positions: F32) -> tuple[F64, F64]:
    """Return the box around finite points, at least one."""
    return positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
