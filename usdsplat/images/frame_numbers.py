"""Parse frame ranges, and insert frame numbers in file names.

A range is one or more pieces separated by commas: `7`, `1-10` or `1:10` (both ends included), and
with a step, `1-10x2`. A range may be descending and a step fractional: `10-1`, `1-2x0.25`. A file
name has a placeholder for the number, `####` or `%04d`; a fractional frame needs one with a
fraction, `####.##`. Its folders may have Houdini's, `$F4` or `<F4>`; hashes in them are letters.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usdsplat.core.errors import UsageError

_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_PIECE = re.compile(rf"{_NUMBER}(?:[-:]{_NUMBER}(?:x{_NUMBER})?)?")
_HOUDINI = (
    r"\$(?:F(?P<dollar>\d?)(?![A-Za-z\d])|\{F(?P<braces>\d?)\}|(?P<real>FF)(?![A-Za-z\d]))"
    r"|<(?:[Ff](?P<angles>\d?)|(?P<husk>FF))>"
)
_PLACE = re.compile(r"(?P<hashes>##+)(?:\.(?P<decimals>#+))?|%(?:0(?P<printf>\d\d?))?d|" + _HOUDINI)
_FOLDER = re.compile(_HOUDINI)

LIMIT = 1_000_000
"""Maximum number of frames in a request; more are assumed to be a mistake."""


def parse_frames(text: str) -> tuple[float, ...]:
    """Parse a frame range into frame numbers, in its order, each once.

    Raises:
        UsageError: If `text` is not a range, a step is 0 or has the wrong sign, or there are more
            than `LIMIT` frames.
    """
    frames: dict[float, None] = {}
    for piece in text.split(","):
        match = _PIECE.fullmatch(piece.strip())
        if not match:
            raise UsageError("frames", repr(text), "a range such as 1-10, 1:10x2 or 1,5,8-12")
        first, last, step = match.groups()
        frames.update(dict.fromkeys(_span(text, float(first), last, step)))
    return tuple(frames)


@dataclass(frozen=True, slots=True)
class _Place:
    """Placeholder for a frame number in a name."""

    start: int
    end: int
    width: int
    """Minimum number of digits before the point; negative numbers have one less."""
    decimals: int | None
    """Number of decimals; None for as many as needed."""

    def number(self, frame: float) -> str:
        """Return the text of a frame number."""
        if self.decimals is None:
            text = f"{frame:.6f}".rstrip("0").rstrip(".")
            return "0" if text == "-0" else text
        if not self.decimals:
            return f"{int(frame):0{self.width}d}"
        return f"{frame:0{self.width + 1 + self.decimals}.{self.decimals}f}"


def has_place(pattern: str | Path) -> bool:
    """Return whether the name of the file has a placeholder for a frame number."""
    return _PLACE.search(Path(pattern).name) is not None


def frame_path(pattern: str | Path, frame: float) -> Path:
    """Return `pattern` with the frame number inserted; unchanged without a placeholder.

    Raises:
        UsageError: If a part of the path has several placeholders, or a fractional frame does not
            fit.
    """
    path = Path(pattern)
    if not path.name:
        return path
    folders = (_numbered(part, frame, str(pattern), _FOLDER) for part in path.parts[:-1])
    return Path(*folders, _numbered(path.name, frame, str(pattern), _PLACE))


def frame_paths(pattern: str | Path, frames: Sequence[float]) -> tuple[Path, ...]:
    """Return a path for each frame.

    Raises:
        UsageError: If two frames have the same path, and as for `frame_path`.
    """
    return FileName.of(pattern).paths(frames)


@dataclass(frozen=True, slots=True)
class FileName:
    """Name of the files of a sequence: a pattern, or several that hold one after the other."""

    samples: tuple[tuple[float, str], ...]
    """Pairs (first frame, pattern), ascending; the first pattern holds before its frame too."""

    @classmethod
    def of(cls, pattern: str | Path) -> FileName:
        """Return the name that has one pattern."""
        return cls(((0.0, str(pattern)),))

    def __str__(self) -> str:
        """Return the first pattern."""
        return self.samples[0][1]

    @property
    def is_sequence(self) -> bool:
        """Whether frames differ in their names."""
        first = Path(str(self))
        several = len({pattern for _, pattern in self.samples}) > 1
        return several or has_place(first) or self.in_folder

    @property
    def in_folder(self) -> bool:
        """Whether a folder's name has a placeholder."""
        return any(map(_FOLDER.search, Path(str(self)).parts[:-1]))

    def at(self, frame: float) -> Path:
        """Return the path of a frame.

        Raises:
            UsageError: As for `frame_path`.
        """
        held = [pattern for first, pattern in self.samples if first <= frame]
        return frame_path(held[-1] if held else str(self), frame)

    def paths(self, frames: Sequence[float]) -> tuple[Path, ...]:
        """Return a path for each frame.

        Raises:
            UsageError: As for `frame_paths`.
        """
        return _distinct(str(self), tuple(map(self.at, frames)))


def frames_found(pattern: str | Path) -> dict[float, Path]:
    """Return existing files and folders that match `pattern` by frame number, ascending.

    Only names that `frame_path` would return match: `####` does not match `1`, nor `%d` `01`.

    Raises:
        UsageError: If the name has no placeholder, or more than one, or a folder has one.
        OSError: If the folder cannot be listed.
    """
    path = Path(pattern)
    places = _places(path.name, _PLACE)
    if any(map(_FOLDER.search, path.parts[:-1])):
        expected = "a placeholder in the file's name only, to find the files of a sequence"
        raise UsageError(str(pattern), "a placeholder in a folder", expected)
    if len(places) != 1:
        found = f"{len(places)} placeholders" if places else "no placeholder"
        raise UsageError(str(pattern), found, "one placeholder for the frame number, such as ####")
    before, after = path.name[: places[0].start], path.name[places[0].end :]
    decimals = {None: r"(?:\.\d{1,15})?", 0: ""}.get(places[0].decimals, r"\.\d{1,15}")
    number = r"-?\d{1,15}" + decimals
    matcher = re.compile(f"{re.escape(before)}({number}){re.escape(after)}")
    matches = (matcher.fullmatch(name) for name in os.listdir(path.parent))
    frames = sorted({float(match[1]): match[0] for match in matches if match}.items())
    named = ((frame, frame_path(path, frame), name) for frame, name in frames)
    return {frame: file for frame, file, name in named if file.name == name}


def without_place(pattern: str | Path) -> Path:
    """Return `pattern` without the placeholder and the separator before it."""
    path = Path(pattern)
    return path.parent / re.sub(rf"[._-]?(?:{_PLACE.pattern})", "", path.name)


def _distinct(pattern: str, paths: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return the paths of frames, and raise an error if two are the same."""
    if len(set(paths)) < len(paths):
        expected = "a placeholder for the frame number in the file's name, such as #### or $F4"
        raise UsageError(pattern, f"{len(paths)} frames", expected)
    return paths


def _numbered(name: str, frame: float, pattern: str, place_in: re.Pattern[str]) -> str:
    """Return one part of a path with the frame number inserted; see `frame_path`."""
    places = _places(name, place_in)
    if len(places) > 1:
        expected = "one placeholder for the frame number in each name"
        raise UsageError(pattern, f"{len(places)} placeholders", expected)
    if not places:
        return name
    place = places[0]
    if place.decimals == 0 and frame != int(frame):
        expected = "room for its fraction, such as ####.## or $FF"
        raise UsageError(pattern, f"frame {frame:g}", expected)
    return name[: place.start] + place.number(frame) + name[place.end :]


def _places(name: str, place_in: re.Pattern[str]) -> list[_Place]:
    """Return the placeholders in the name of a file or a folder."""
    return [_place(match.groupdict(), match.span()) for match in place_in.finditer(name)]


def _place(found: dict[str, str | None], span: tuple[int, int]) -> _Place:
    """Return a placeholder that `_PLACE` or `_FOLDER` has matched, by the names of the groups."""
    start, end = span
    if found["real"] or found["husk"]:
        return _Place(start, end, 0, None)
    if hashes := found.get("hashes"):
        return _Place(start, end, len(hashes), len(found.get("decimals") or ""))
    digits = found.get("printf") or found["dollar"] or found["braces"] or found["angles"]
    return _Place(start, end, int(digits or 0), 0)


def _span(text: str, first: float, last: str | None, step: str | None) -> list[float]:
    """Return the frames of one piece of a range."""
    if last is None:
        return [first]
    way = float(last) - first
    stride = abs(float(step)) if step else 1.0
    backwards = step is not None and float(step) < 0
    if stride == 0.0 or (backwards and way > 0):
        raise UsageError("frames", repr(text), "a step that leads from the first to the last frame")
    count = int(abs(way) / stride + 1e-9) + 1
    if count > LIMIT:
        raise UsageError("frames", f"{count} frames in {text!r}", f"{LIMIT} or fewer")
    return [first + (stride if way >= 0 else -stride) * i for i in range(count)]
