"""The capture files of a sequence: which there are, and what they say in common."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from usdsplat.core import edit
from usdsplat.core.errors import FormatError
from usdsplat.formats import Capture
from usdsplat.images.frames import frame_paths, frames_found, has_place
from usdsplat.interchange.files import is_usd
from usdsplat.interchange.gathering import either, widened

_MOST_LISTED = 8
"""Runs of frames that a sentence lists."""


def is_sequence(source: Path) -> bool:
    """Whether a name of what is read stands for many captures; a file of that very name is one."""
    return has_place(source) and not is_usd(source) and not source.exists()


def files_of(pattern: Path, frames: Sequence[float] | None = None) -> dict[float, Path]:
    """The files of a sequence by their frame numbers, ascending.

    Args:
        pattern: Its name has a place for the frame number: `cap.####.ply` or `cap.%04d.ply`.
        frames: Which to take; None is all there are, and they must leave no gap.

    Raises:
        UsageError: If the name has no place for the number.
        FormatError: If the folder cannot be listed, there is no file, or files are missing.
    """
    try:
        found = frames_found(pattern)
    except OSError as error:
        said = (error.strerror or str(error)).lower()
        raise FormatError(str(pattern), said, "a folder of captures") from error
    if frames is None:
        missing = _gaps(list(found))
        expected = "every frame from the first to the last, or --frames that says which"
    else:
        wanted = sorted(set(frames))
        files = dict(zip(wanted, frame_paths(pattern, wanted), strict=True))
        missing = [(time, time) for time in wanted if time not in found]
        expected = "a file for each frame that is asked for"
        found = {time: path for time, path in files.items() if time in found}
    if missing:
        raise FormatError(str(pattern), f"no file for {_listed(missing)}", expected)
    if not found:
        raise FormatError(str(pattern), "no file of that name", "one for each frame")
    return found


@dataclass(slots=True, eq=False)
class Notes:
    """What is remarked on frames, each sentence once."""

    _times: dict[str, list[float]] = field(default_factory=dict)
    _count: int = 0

    def add(self, time: float, notes: Iterable[str]) -> None:
        """Take what is said of another frame, later than those before."""
        self._count += 1
        for note in dict.fromkeys(notes):
            self._times.setdefault(note, []).append(time)

    def told(self) -> tuple[str, ...]:
        """The sentences; what only some frames say, with their numbers."""
        return tuple(
            note if len(times) == self._count else f"{_listed(_runs(times))}: {note}"
            for note, times in self._times.items()
        )


@dataclass(slots=True, eq=False)
class Account:
    """What the frames of a sequence say, gathered while they pass by; it keeps no splats."""

    capture: Capture | None = None
    """The first frame without its splats; its format and bounds are widened by later ones."""
    counts: list[int] = field(default_factory=list)
    """Splats of each frame."""
    notes: Notes = field(default_factory=Notes)
    _digests: dict[str, str] = field(default_factory=dict)

    def add(self, time: float, path: Path, capture: Capture, sha256: str) -> None:
        """Count a frame in.

        Raises:
            FormatError: If it differs from the first in what one field can only have once.
        """
        self.counts.append(len(capture.cloud))
        self._digests[path.name] = sha256
        self.notes.add(time, capture.notes)
        nothing = edit.take(capture.cloud, np.empty(0, np.int64))
        if self.capture is None:
            self.capture = replace(capture, cloud=nothing)
            return
        for name, first, found in zip(
            _SHARED, _shared(self.capture), _shared(capture), strict=True
        ):
            if found != first:
                raise FormatError(str(path), f"{name} {found}", f"{first}, as in the first frame")
        self.capture = replace(
            self.capture,
            format=either(self.capture.format, capture.format),
            error_bounds=widened(self.capture.error_bounds, capture.error_bounds),
        )

    def fingerprint(self) -> str:
        """SHA-256 over the names and fingerprints of all frames, sorted by name."""
        total = hashlib.sha256()
        for name, digest in sorted(self._digests.items()):
            total.update(f"{name}\0{digest}\n".encode())
        return total.hexdigest()


_SHARED = ("degree of harmonics", "axes", "antialiasing", "colour space")


def _shared(capture: Capture) -> tuple[object, ...]:
    """What all frames must have in common, in the order of `_SHARED`."""
    degree = capture.cloud.sh_degree
    return degree, capture.frame, capture.antialiased, capture.color_space


def _gaps(times: Sequence[float]) -> list[tuple[float, float]]:
    """Runs of whole numbers that are missing between ascending ones; fractions have no gaps."""
    if any(time != int(time) for time in times):
        return []
    return [(a + 1, b - 1) for a, b in pairwise(times) if b > a + 1]


def _runs(times: Iterable[float]) -> list[tuple[float, float]]:
    """Ascending numbers as runs of successive ones."""
    runs: list[tuple[float, float]] = []
    for time in times:
        if runs and time == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], time)
        else:
            runs.append((time, time))
    return runs


def _listed(runs: Sequence[tuple[float, float]]) -> str:
    """Runs of frames in words: "frame 7" or "frames 3 to 5, 9 and others"."""
    first, last = runs[0]
    if len(runs) == 1 and first == last:
        return f"frame {first:.10g}"
    words = [f"{a:.10g}" if a == b else f"{a:.10g} to {b:.10g}" for a, b in runs[:_MOST_LISTED]]
    return f"frames {', '.join(words)}" + (" and others" if len(runs) > _MOST_LISTED else "")
