"""Read binary PLY files in parts, whatever their size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress
from usdsplat.formats import ply
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.sources import bounds, described, survey_of
from usdsplat.interchange.lod.survey import SAMPLED, Survey

WINDOW = 1 << 19
"""Number of rows that `survey` reads at a time; a file of no more is read once."""


class PlySource:
    """A binary PLY file with splats.

    Args:
        path: The file.
        count: Its number of rows.
        options: Options of the building.
    """

    def __init__(self, path: Path, count: int, options: LodOptions) -> None:
        self.path = path
        self.files: tuple[Path, ...] = (path,)
        self._count = count
        self._options = options
        self._held: SplatCloud | None = None

    def survey(self, progress: Progress) -> Survey:
        """Read all rows, and keep a sample; rows that cannot be drawn are counted all the same.

        Raises:
            FormatError: If the file is damaged.
            UsageError: If the axes are invalid.
        """
        label, step = f"reading {self.path}", max(1, self._count // SAMPLED)
        description = ply.read_part(self.path, 0, 0, self._options.reading)
        sampled = [description.cloud]
        boxes: list[tuple[F64, F64]] = []
        for first in range(0, self._count, WINDOW):
            progress.step(label, first, self._count)
            part = self._read(first, min(first + WINDOW, self._count))
            if len(part) == self._count:
                self._held = part
            if len(part):
                boxes.append(bounds(part.positions))
                sampled.append(edit.take(part, np.arange(-first % step, len(part), step)))
        progress.step(label, self._count, self._count)
        capture = described(replace(description, cloud=edit.merge(sampled)), self._options)
        return survey_of(self.path, capture, self._count, boxes)

    def rows(self, part: int, first: int, last: int, matrix: F64) -> SplatCloud:
        """Return the splats of some rows; `part` is 0."""
        held = self._held
        cloud = self._read(first, last) if held is None else edit.take(held, np.arange(first, last))
        return edit.transform(cloud, matrix)

    def findings(self) -> list[Finding]:
        """Return nothing: captures ask for nothing."""
        return []

    def release(self) -> None:
        """Release the splats of a small file."""
        self._held = None

    def _read(self, first: int, last: int) -> SplatCloud:
        """Return the splats of some rows."""
        return ply.read_part(self.path, first, last, self._options.reading).cloud
