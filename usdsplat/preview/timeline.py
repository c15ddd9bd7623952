"""The timeline of a viewport: the current time, and playback driven by ticks of a clock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from usdsplat.core.errors import UsageError

_LONGEST = 1.0
"""Maximum time between two ticks; after a longer pause, playback does not skip frames [s]."""


@dataclass(slots=True, kw_only=True)
class Timeline:
    """A range of frames with a current one. Times are time codes.

    Playback is in real time: if pictures take longer than a frame, frames are skipped.
    """

    start: float = 0.0
    end: float = 0.0
    rate: float = 24.0
    """Time codes per second."""
    step: float = 1.0
    """Time from one frame to the next [time code]."""
    current: float = 0.0
    is_playing: bool = False
    loops: bool = True
    """Whether playback restarts at the end, rather than stopping."""

    _frames: float = field(default=0.0, repr=False)
    """Fraction of a frame due since the last one shown."""
    _last: float | None = field(default=None, repr=False)
    """Time of the last tick [s]."""

    def set_range(self, start: float, end: float) -> None:
        """Set the range; the current time is clamped to it.

        Raises:
            UsageError: If it ends before it starts, or a bound is not finite.
        """
        if not (math.isfinite(start) and math.isfinite(end) and start <= end):
            raise UsageError("range", f"{start:g} to {end:g}", "two numbers, the first not larger")
        self.start, self.end = float(start), float(end)
        self.current = min(max(self.current, self.start), self.end)

    def set_rate(self, rate: float) -> None:
        """Set the rate [time code/s].

        Raises:
            UsageError: If it is not positive.
        """
        self.rate = _positive("rate", rate)

    def go(self, time: float) -> float:
        """Show a time, clamped to the range, and return it. Playback continues from there.

        Raises:
            UsageError: If it is NaN.
        """
        if math.isnan(time):
            raise UsageError("time", "nan", "a number")
        self.current = min(max(float(time), self.start), self.end)
        self._frames = 0.0
        return self.current

    def advance(self, frames: int) -> float:
        """Stop playback, move by a number of frames, and return the new time.

        Frames are whole steps from the start. Beyond an end it wraps around if it loops. A time
        between two frames moves to the next frame in that direction first.
        """
        self.play(False)
        place = round((self.current - self.start) / self.step, 6)
        near = math.floor(place) if frames > 0 else math.ceil(place)
        return self.go(self._at(near + frames))

    def play(self, is_playing: bool = True) -> None:
        """Start playback, from the start if the current frame is the last; or stop it."""
        if is_playing and not self.is_playing and self._is_last():
            self.current = self.start
        self.is_playing = is_playing
        self._frames, self._last = 0.0, None

    def tick(self, now: float) -> float | None:
        """Return the time to show now if it changed, else None.

        Args:
            now: Time of a monotonic clock [s].
        """
        if not self.is_playing:
            return None
        since = 0.0 if self._last is None else now - self._last
        self._last = now
        if since > _LONGEST:
            return None
        self._frames += since * self.rate / self.step
        due = math.floor(self._frames + 1e-9)
        if due < 1:
            return None
        self._frames = max(self._frames - due, 0.0)
        before = self.current
        place = (self.current - self.start) / self.step
        self.current = self._at(math.floor(place + 1e-6) + due)
        if not self.loops and self._is_last():
            self.play(False)
        return self.current if self.current != before else None

    def _count(self) -> int:
        """Return the number of frames in the range."""
        return math.floor((self.end - self.start) / self.step + 1e-6) + 1

    def _at(self, number: int) -> float:
        """Return the time of a frame; beyond an end it wraps around if it loops, else it is
        clamped."""
        count = self._count()
        number = number % count if self.loops else min(max(number, 0), count - 1)
        return self.start + number * self.step

    def _is_last(self) -> bool:
        """Return whether the current frame is the last."""
        return self.current + self.step > self.end + 1e-6 * self.step


def _positive(what: str, number: float) -> float:
    if not 0 < number < math.inf:
        raise UsageError(what, f"{number:g}", "a positive number")
    return float(number)
