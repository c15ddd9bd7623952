"""SMPTE time codes and frame rates, as picture headers have them.

A time code's frames have two bits for the tens, so it counts up to 39. Rates of 48, 50 and 60, and
those of NTSC, are counted in pairs of frames as ST 12-1 does: both frames of a pair have the same
number, and the second has the field bit. Other rates above 30 have no time code.

Source: SMPTE ST 12-1, non-drop; OpenEXR's standard attributes framesPerSecond and timeCode.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction

from usdsplat.core.errors import UsageError

NTSC = Fraction(1000, 1001)
"""Ratio of the rates of NTSC, such as 23.976, to the whole numbers that they are named after."""
NTSC_BASES = (24, 30, 48, 60, 120)
"""Whole numbers whose rates of NTSC are also recognised with two decimals, such as 23.98."""
ROUNDED = 7e-3
"""Difference to a rate of NTSC up to which it is recognised; 23.97 and 23.98 are 23.976."""
MOST_SINGLE, PAIRED = 30, (48, 50, 60)
"""Highest rate that is counted in single frames, and the rates that are counted in pairs."""
NEAR = Fraction(1, 10**6)
"""Part of a frame by which a frame number may be too small because it was rounded."""

_NOTATION = re.compile(r"(\d\d):(\d\d):(\d\d)[:.](\d\d)(?:\.([01]))?")


@dataclass(frozen=True, slots=True)
class Timecode:
    """Hours, minutes, seconds and frames."""

    hours: int
    minutes: int
    seconds: int
    frames: int
    """Number of the frame within its second, or of the pair of frames."""
    second_of_pair: bool | None = None
    """Whether this is the second frame of a pair; None for rates counted in single frames."""

    def __str__(self) -> str:
        """Return the usual notation, such as 00:00:42:01, and .0 or .1 for a frame of a pair."""
        pair = "" if self.second_of_pair is None else f".{self.second_of_pair:d}"
        return f"{self.hours:02}:{self.minutes:02}:{self.seconds:02}:{self.frames:02}{pair}"

    @property
    def packed(self) -> int:
        """SMPTE's 32 bits: a byte for each number, frames lowest, in binary-coded decimals.

        Bit 15 is the field bit, where OpenEXR has it for all rates (its packing TV60).
        """
        numbers = (self.frames, self.seconds, self.minutes, self.hours)
        bits = sum((n // 10 << 4 | n % 10) << 8 * i for i, n in enumerate(numbers))
        return bits | bool(self.second_of_pair) << 15


def exact_rate(rate: float) -> Fraction | None:
    """Return a frame rate as a ratio: a whole number, a rate of NTSC, or the nearest small one.

    Args:
        rate: Frames per second, often rounded, such as 23.976 or 23.98.

    Returns:
        The ratio; None if `rate` is not a positive number below a million.
    """
    if not 0 < rate < 1e6:
        return None
    whole = Fraction(round(rate))
    for exact in (whole, whole * NTSC):
        if exact and abs(rate - exact) < 5e-4:
            return exact
    if whole in NTSC_BASES and abs(rate - whole * NTSC) < ROUNDED:
        return whole * NTSC
    return Fraction(rate).limit_denominator(1001) or None


def frame_count(time: float, per_second: float, rate: Fraction) -> Fraction | None:
    """Return the number of frames from time code 0 to a time code of the stage.

    Args:
        time: Time code of the stage.
        per_second: Time codes per second, often rounded.
        rate: Frames per second.

    Returns:
        The exact ratio; None if a number is not finite or `per_second` is not positive.
    """
    codes = exact_rate(per_second)
    return None if codes is None or not math.isfinite(time) else Fraction(time) * rate / codes


def timecode_of(frame: float | Fraction, rate: Fraction) -> Timecode | None:
    """Return the time code of a frame, non-drop: frame 0 is 00:00:00:00.

    Args:
        frame: Frame number; a fraction counts to the frame that it is part of.
        rate: Frames per second.

    Returns:
        The time code, which begins again after a day; None for negative frames, and for rates that
        are not counted: see the module.
    """
    per_code = _frames_per_code(rate)
    if not per_code or not 0 <= frame < math.inf:
        return None
    pair, second = divmod(math.floor(Fraction(frame) + NEAR), per_code)
    seconds, frames = divmod(pair, _base(rate) // per_code)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return Timecode(hours % 24, minutes, seconds, frames, bool(second) if per_code == 2 else None)


def parse_timecode(text: str, where: str) -> Timecode:
    """Parse a time code written as hours:minutes:seconds:frames, such as 01:00:00:00.

    Raises:
        UsageError: If it is not a time code.
    """
    match = _NOTATION.fullmatch(text)
    numbers = tuple(map(int, match.groups()[:4])) if match else ()
    if not match or numbers[0] > 23 or max(numbers[1:3]) > 59 or numbers[3] >= MOST_SINGLE:
        raise UsageError(where, repr(text), "hours, minutes, seconds and frames, as 01:00:00:00")
    hours, minutes, seconds, frames = numbers
    return Timecode(hours, minutes, seconds, frames, None if match[5] is None else match[5] == "1")


def frame_of(code: Timecode, rate: Fraction) -> int | None:
    """Return the frame with a time code; None if the rate cannot have it."""
    per_code = _frames_per_code(rate)
    if not per_code or code.frames >= _base(rate) // per_code:
        return None
    if code.second_of_pair is not None and per_code == 1:
        return None
    seconds = (code.hours * 60 + code.minutes) * 60 + code.seconds
    return seconds * _base(rate) + code.frames * per_code + bool(code.second_of_pair)


def _base(rate: Fraction) -> int:
    """Return the whole number of frames that count as a second."""
    return math.ceil(rate)


def _frames_per_code(rate: Fraction) -> int:
    """Return the number of frames with the same numbers; 0 for a rate without time codes."""
    base = _base(rate)
    if rate not in (base, base * NTSC):
        return 0
    return 1 if 1 <= base <= MOST_SINGLE else 2 if base in PAIRED else 0
