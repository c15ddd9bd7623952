"""Find the capture files of a sequence, and collect their metadata."""

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
from usdsplat.images.frame_numbers import frame_paths, frames_found, has_place
from usdsplat.interchange.axes_choice import AxesChoice
from usdsplat.interchange.files import is_usd
from usdsplat.interchange.gathering import either, widened

_MOST_LISTED = 8
"""Maximum number of runs of frames listed in a sentence."""


def is_sequence(source: Path) -> bool:
    """Return whether an input name is a sequence of captures, not an existing file of that name."""
    return has_place(source) and not is_usd(source) and not source.exists()


def files_of(pattern: Path, frames: Sequence[float] | None = None) -> dict[float, Path]:
    """Return the files of a sequence by frame number, ascending.

    Args:
        pattern: Name with a placeholder for the frame number: `cap.####.ply` or `cap.%04d.ply`.
        frames: Frames to use; None is all, without gaps.

    Raises:
        UsageError: If the name has no placeholder.
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
    """Notes on frames, each sentence once."""

    _times: dict[str, list[float]] = field(default_factory=dict)
    _count: int = 0

    def add(self, time: float, notes: Iterable[str]) -> None:
        """Add the notes of a frame later than those before."""
        self._count += 1
        for note in dict.fromkeys(notes):
            self._times.setdefault(note, []).append(time)

    def told(self) -> tuple[str, ...]:
        """Return the notes, with frame numbers for those that apply to some frames only."""
        return tuple(
            note if len(times) == self._count else f"{_listed(_runs(times))}: {note}"
            for note, times in self._times.items()
        )


@dataclass(slots=True, eq=False)
class Account:
    """Metadata of the frames of a sequence, without their splats."""

    capture: Capture | None = None
    """The first frame without its splats; later frames extend its format and bounds."""
    axes: AxesChoice | None = None
    """Axes of all frames, chosen at the first: a choice for each could change between frames."""
    counts: list[int] = field(default_factory=list)
    """Number of splats of each frame."""
    notes: Notes = field(default_factory=Notes)
    _digests: dict[str, str] = field(default_factory=dict)

    def add(self, time: float, path: Path, capture: Capture, sha256: str) -> None:
        """Add a frame.

        Raises:
            FormatError: If it differs from the first in a property of the whole field.
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
        """Return the SHA-256 over names and hashes of all frames, sorted by name."""
        total = hashlib.sha256()
        for name, digest in sorted(self._digests.items()):
            total.update(f"{name}\0{digest}\n".encode())
        return total.hexdigest()


_SHARED = ("degree of harmonics", "axes", "metres per unit", "antialiasing", "colour space")


def _shared(capture: Capture) -> tuple[object, ...]:
    """Return properties that all frames must share, in the order of `_SHARED`."""
    degree = capture.cloud.sh_degree
    return (
        *(degree, capture.frame, capture.meters_per_unit),
        *(capture.antialiased, capture.color_space),
    )


def _gaps(times: Sequence[float]) -> list[tuple[float, float]]:
    """Return runs of missing integers in an ascending list; fractional frames have no gaps."""
    if any(time != int(time) for time in times):
        return []
    return [(a + 1, b - 1) for a, b in pairwise(times) if b > a + 1]


def _runs(times: Iterable[float]) -> list[tuple[float, float]]:
    """Group ascending numbers in runs of consecutive ones."""
    runs: list[tuple[float, float]] = []
    for time in times:
        if runs and time == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], time)
        else:
            runs.append((time, time))
    return runs


def _listed(runs: Sequence[tuple[float, float]]) -> str:
    """Describe runs of frames: "frame 7" or "frames 3 to 5, 9 and others"."""
    first, last = runs[0]
    if len(runs) == 1 and first == last:
        return f"frame {first:.10g}"
    words = [f"{a:.10g}" if a == b else f"{a:.10g} to {b:.10g}" for a, b in runs[:_MOST_LISTED]]
    return f"frames {', '.join(words)}" + (" and others" if len(runs) > _MOST_LISTED else "")
