"""Read the finest level of a streamed SOG in parts."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path

from usdsplat.core import edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress
from usdsplat.interchange.lod.options import LodOptions
from usdsplat.interchange.lod.sources import bounds, described, survey_of
from usdsplat.interchange.lod.survey import Survey
from usdsplat.interchange.lod.tree_rows import TreeRows
from usdsplat.interchange.streamed import StreamedSog
from usdsplat.schema.chunks import ChunkReader


class StreamedSource:
    """A streamed SOG: its finest level, and its environment.

    Args:
        path: `lod-meta.json`, or its folder.
        options: Options of the building.
    """

    def __init__(self, path: Path, options: LodOptions) -> None:
        self.path = path
        self.files: tuple[Path, ...] = (path,)
        self._options = options

    def survey(self, progress: Progress) -> Survey:
        """Read all splats, and keep a sample.

        Raises:
            FormatError: If `lod-meta.json` or the metadata of a file is invalid.
            StageError: If a file is damaged.
            UsageError: If the axes are invalid.
        """
        rows, label = self._rows, f"reading {self.path}"
        done, few, boxes = 0, [], []
        for some, centres in rows.sample():
            progress.step(label, done, rows.count)
            few.append(some)
            boxes.append(bounds(centres))
            done += len(centres)
        progress.step(label, rows.count, rows.count)
        capture = self._streamed.sample()
        capture = replace(capture, cloud=edit.merge(few or [capture.cloud]))
        return survey_of(self.path, described(capture, self._options), rows.count, boxes)

    def rows(self, part: int, first: int, last: int, matrix: F64) -> SplatCloud:
        """Return some splats; `part` is 0."""
        return edit.transform(self._rows.rows(first, last), matrix)

    def findings(self) -> list[Finding]:
        """Return nothing: captures ask for nothing."""
        return []

    def release(self) -> None:
        """Release the metadata, and the files that are unpacked."""
        for name in ("_rows", "_streamed"):
            self.__dict__.pop(name, None)

    @cached_property
    def _streamed(self) -> StreamedSog:
        """The metadata of all files."""
        return StreamedSog.open(self.path, self._options.reading.progress)

    @cached_property
    def _rows(self) -> TreeRows:
        """Reader of the splats."""
        streamed = self._streamed
        return TreeRows(streamed.table, ChunkReader(streamed.chunks, streamed.degree))
