"""Parse frame ranges, and insert frame numbers in file names.

A range is one or more pieces separated by commas: `7`, `1-10` or `1:10` (both ends included), and
with a step, `1-10x2`. A range may be descending and a step fractional: `10-1`, `1-2x0.25`. A file
name has a placeholder for the number, `####` or `%04d`; a fractional frame needs one with a
fraction, `####.##`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from usdsplat.core.errors import UsageError

_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_PIECE = re.compile(rf"{_NUMBER}(?:[-:]{_NUMBER}(?:x{_NUMBER})?)?")
_PLACE = re.compile(r"(#+)(?:\.(#+))?|%(?:0(\d+))?d")

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


def has_place(pattern: str | Path) -> bool:
    """Return whether the name has a placeholder for a frame number."""
    return _PLACE.search(Path(pattern).name) is not None


def frame_path(pattern: str | Path, frame: float) -> Path:
    """Return `pattern` with the frame number inserted; unchanged without a placeholder.

    Raises:
        UsageError: If there are several placeholders, or a fractional frame does not fit.
    """
    path = Path(pattern)
    places = list(_PLACE.finditer(path.name))
    if len(places) > 1:
        raise UsageError(
            str(pattern), f"{len(places)} placeholders", "one placeholder for the frame number"
        )
    if not places:
        return path
    whole, fraction, digits = places[0].groups()
    if not fraction and frame != int(frame):
        raise UsageError(str(pattern), f"frame {frame:g}", "room for its fraction, such as ####.##")
    width = len(whole) if whole else int(digits or 0)
    if fraction:
        text = f"{frame:0{width + 1 + len(fraction)}.{len(fraction)}f}"
    else:
        text = f"{int(frame):0{width}d}"
    return path.with_name(_PLACE.sub(text, path.name))


def frame_paths(pattern: str | Path, frames: Sequence[float]) -> tuple[Path, ...]:
    """Return a path for each frame.

    Raises:
        UsageError: If two frames have the same path, and as for `frame_path`.
    """
    paths = tuple(frame_path(pattern, frame) for frame in frames)
    if len(set(paths)) < len(paths):
        raise UsageError(
            str(pattern),
            f"{len(frames)} frames",
            "a placeholder for the frame number, such as ####",
        )
    return paths


def frames_found(pattern: str | Path) -> dict[float, Path]:
    """Return existing files and folders that match `pattern` by frame number, ascending.

    Only names that `frame_path` would return match: `####` does not match `1`, nor `#` `01`.

    Raises:
        UsageError: If the name has no placeholder, or more than one.
        OSError: If the folder cannot be listed.
    """
    path = Path(pattern)
    places = list(_PLACE.finditer(path.name))
    if len(places) != 1:
        found = f"{len(places)} placeholders" if places else "no placeholder"
        raise UsageError(str(pattern), found, "one placeholder for the frame number, such as ####")
    before, after = path.name[: places[0].start()], path.name[places[0].end() :]
    number = r"-?\d{1,15}" + (r"\.\d{1,15}" if places[0][2] else "")
    matcher = re.compile(f"{re.escape(before)}({number}){re.escape(after)}")
    matches = (matcher.fullmatch(name) for name in os.listdir(path.parent))
    frames = sorted({float(match[1]): match[0] for match in matches if match}.items())
    named = ((frame, frame_path(path, frame), name) for frame, name in frames)
    return {frame: file for frame, file, name in named if file.name == name}


def without_place(pattern: str | Path) -> Path:
    """Return `pattern` without the placeholder and the separator before it."""
    path = Path(pattern)
    return path.parent / re.sub(rf"[._-]?(?:{_PLACE.pattern})", "", path.name)


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
