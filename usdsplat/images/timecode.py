"""SMPTE time codes and frame rates, as picture headers have them.

Source: SMPTE ST 12-1, non-drop; OpenEXR's standard attributes framesPerSecond and timeCode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

NTSC = Fraction(1000, 1001)
"""Ratio of the rates of NTSC, such as 23.976, to the whole numbers that they are named after."""


@dataclass(frozen=True, slots=True)
class Timecode:
    """Hours, minutes, seconds and frames."""

    hours: int
    minutes: int
    seconds: int
    frames: int

    def __str__(self) -> str:
        """Return the usual notation, such as 00:00:42:01."""
        return f"{self.hours:02}:{self.minutes:02}:{self.seconds:02}:{self.frames:02}"

    @property
    def packed(self) -> int:
        """SMPTE's 32 bits: a byte for each number, frames lowest, in binary-coded decimals."""
        numbers = (self.frames, self.seconds, self.minutes, self.hours)
        return sum((n // 10 << 4 | n % 10) << 8 * i for i, n in enumerate(numbers))


def exact_rate(rate: float) -> Fraction | None:
    """Return a frame rate as a ratio: a whole number, a rate of NTSC, or the nearest small one.

    Args:
        rate: Frames per second, often rounded, such as 23.976.

    Returns:
        The ratio; None if `rate` is not a positive number below a million.
    """
    if not 0 < rate < 1e6:
        return None
    whole = Fraction(round(rate))
    for exact in (whole, whole * NTSC):
        if exact and abs(rate - exact) < 5e-4:
            return exact
    return Fraction(rate).limit_denominator(1001) or None


def timecode_of(frame: float, rate: Fraction) -> Timecode | None:
    """Return the time code of a frame, non-drop: frame 0 is 00:00:00:00.

    Args:
        frame: Frame number; a fraction counts to the frame that it is part of.
        rate: Frames per second, a whole number up to 99 or its rate of NTSC.

    Returns:
        The time code, which begins again after a day; None for other rates and negative frames.
    """
    base = math.ceil(rate)
    is_countable = 1 <= base <= 99 and rate in (base, base * NTSC)
    if not is_countable or not 0 <= frame < math.inf:
        return None
    seconds, frames = divmod(math.floor(frame), base)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return Timecode(hours % 24, minutes, seconds, frames)
