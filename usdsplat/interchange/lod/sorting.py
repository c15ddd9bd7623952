"""Sort the splats of all inputs into runs, in pieces that fit memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.progress import Progress
from usdsplat.interchange.lod.chunks import joined
from usdsplat.interchange.lod.runs import Runs, has_run, write_run
from usdsplat.interchange.lod.sources import Source, splat_bytes
from usdsplat.interchange.lod.survey import Meeting, Survey
from usdsplat.interchange.lod.work_folder import WorkFolder

SHARE = 16
"""A piece takes at most one of so many parts of the memory, before it is transformed and sorted."""
LARGEST = 2.0**31
"""Largest standard deviation of a splat [unit]: packed ones have none above 2^32, and boxes leave
out those whose squares are not finite."""
LEAST_ROWS = 1 << 16
"""Smallest number of rows of a piece, but for the last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Splats `first` to `last` of a part of an input."""

    source: int
    part: int
    first: int
    last: int


def pieces(surveys: Sequence[Survey], most: int) -> Iterator[list[Rows]]:
    """Divide all splats into pieces of `most` splats, in order; the last has the rest."""
    piece: list[Rows] = []
    room = most
    for source, survey in enumerate(surveys):
        for part, count in enumerate(survey.parts):
            first = 0
            while first < count:
                last = min(count, first + room)
                piece.append(Rows(source=source, part=part, first=first, last=last))
                room -= last - first
                first = last
                if room == 0:
                    yield piece
                    piece, room = [], most
    if piece:
        yield piece


def sort_inputs(
    sources: Sequence[Source],
    surveys: Sequence[Survey],
    meeting: Meeting,
    folder: WorkFolder,
    memory: int,
    progress: Progress,
) -> tuple[Runs, int]:
    """Write all runs that do not exist, and return them, and the number of splats that are not
    finite, which are left out.

    Args:
        sources: The inputs.
        surveys: One for each.
        meeting: Their common coordinates.
        folder: Folder of the runs.
        memory: Limit of memory [byte].
        progress: Receives the number of splats.
    """
    total = sum(survey.count for survey in surveys)
    runs = planned_runs(surveys, meeting, folder, memory)
    folder.remove_other_runs(path.name for path in runs)
    write_runs(runs, sources, meeting, progress)
    found = Runs(list(runs), meeting.degree)
    return found, total - int(found.counts.sum())


def planned_runs(
    surveys: Sequence[Survey], meeting: Meeting, folder: WorkFolder, memory: int
) -> dict[Path, list[Rows]]:
    """Return the path of each run, with the splats that are sorted in it.

    Args are those of `sort_inputs`.
    """
    most = max(LEAST_ROWS, memory // SHARE // splat_bytes(meeting.degree))
    return {
        folder.runs / f"{number:05}_{most}": piece
        for number, piece in enumerate(pieces(surveys, most))
    }


def write_runs(
    runs: Mapping[Path, list[Rows]], sources: Sequence[Source], meeting: Meeting, progress: Progress
) -> None:
    """Write those runs that do not exist, and release the inputs."""
    done, total = 0, sum(rows.last - rows.first for piece in runs.values() for rows in piece)
    for path, piece in runs.items():
        progress.step("sorting splats", done, total)
        if not has_run(path):
            write_run(path, _read(sources, piece, meeting), meeting.cube)
        done += sum(rows.last - rows.first for rows in piece)
    progress.step("sorting splats", total, total)
    for source in sources:
        source.release()


def _read(sources: Sequence[Source], piece: Sequence[Rows], meeting: Meeting) -> SplatCloud:
    """Return the finite splats of a piece, in the tree's coordinates."""
    parts = []
    for rows in piece:
        for source in sources[: rows.source]:
            source.release()
        matrix = meeting.maps[rows.source]
        cloud = sources[rows.source].rows(rows.part, rows.first, rows.last, matrix)
        cloud = edit.prune(edit.with_sh_degree(cloud, meeting.degree))
        if cloud.scales.max(initial=0.0) > LARGEST:
            cloud = replace(cloud, scales=np.minimum(cloud.scales, np.float32(LARGEST)))
        parts.append(cloud)
    return joined(parts)
