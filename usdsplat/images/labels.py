"""Header entries that describe how a picture was made."""

from __future__ import annotations

import json
import math
import platform
from fractions import Fraction

from usdsplat.core.errors import UsageError
from usdsplat.core.source_date import source_date
from usdsplat.core.text import shown
from usdsplat.images.layout import Entry, Metadata
from usdsplat.images.timecode import (
    NEAR,
    Timecode,
    exact_rate,
    frame_count,
    frame_of,
    parse_timecode,
    timecode_of,
)


def picture_metadata(*, stage: str, frame: float, samples: int, exposure: float) -> Metadata:
    """Return the entries for `ImageLayout.metadata`; writers add our version themselves.

    Args:
        stage: Root layer of the stage, as given by the user.
        frame: Time code of the picture.
        samples: Number of samples of shutter, lens and pixel.
        exposure: Factor of the camera on linear light.
    """
    return {
        "usdsplat:stage": shown(stage),
        "usdsplat:frame": float(frame),
        "usdsplat:samples": samples,
        "usdsplat:exposure": float(exposure),
    }


def time_metadata(
    *,
    frame: float,
    rate: float,
    per_second: float,
    shutter: tuple[float, float],
    offset: int = 0,
) -> Metadata:
    """Return the entries on time, in the names and units of OpenEXR's standard attributes.

    Args:
        frame: Time code of the stage.
        rate: Frames per second of playback.
        per_second: Time codes per second.
        shutter: Times at which the shutter opens and closes, relative to the frame [time code].
        offset: Number of frames that time code 0 of the stage is after 00:00:00:00.
    """
    entries: dict[str, Entry] = {}
    exact = exact_rate(rate)
    if exact is not None and per_second > 0:
        entries["framesPerSecond"] = exact
        count = frame_count(frame, per_second, exact)
        counted = None if count is None else timecode_of(count + offset, exact)
        if counted is not None:
            entries["timeCode"] = counted
    opens, closes = shutter
    if closes > opens:
        entries["usdsplat:shutter"] = (opens, closes)
        if per_second > 0:
            entries["expTime"] = (closes - opens) / per_second
    return entries


def timecode_offset(start: str, *, first: float, rate: float, per_second: float) -> int:
    """Return the number of frames that time code 0 of a stage is after 00:00:00:00.

    Args:
        start: SMPTE time code of the stage's first frame; "" if frame 0 is 00:00:00:00.
        first: Time code of the stage's first frame.
        rate, per_second: As for `time_metadata`.

    Raises:
        UsageError: If `start` is not a time code, or the rate does not have it.
    """
    if not start:
        return 0
    where = "start_timecode"
    code, exact = parse_timecode(start, where), exact_rate(rate)
    count = None if exact is None else frame_count(first, per_second, exact)
    number = None if exact is None else frame_of(code, exact)
    if number is None or count is None:
        found = f"{start} at {rate:g} frames per second"
        raise UsageError(where, found, "a time code of the stage's framesPerSecond")
    return number - math.floor(count + NEAR)  # as `timecode_of` counts


def origin_metadata(source: str) -> Metadata:
    """Return the entries that identify the machine and the files of a picture.

    Under SOURCE_DATE_EPOCH, the variable of reproducible builds, the machine is left out.

    Args:
        source: Hash of the files; "" if there is none.
    """
    entries: dict[str, Entry] = {"usdsplat:stageHash": source} if source else {}
    host = platform.node()
    if host and not is_reproducible():
        entries["HostComputer"] = host
    return entries


def is_reproducible() -> bool:
    """Return whether files must be the same in each run: without date and machine."""
    return source_date() is not None


def as_json(metadata: Metadata) -> str:
    """Return header entries as one JSON text; rates and time codes are strings in it."""
    return json.dumps(dict(metadata), default=str)


def as_text(metadata: Metadata) -> dict[str, str]:
    """Return header entries for a format that holds text only: numbers and tuples as JSON."""
    return {
        key: str(value) if isinstance(value, str | Fraction | Timecode) else json.dumps(value)
        for key, value in metadata.items()
    }
