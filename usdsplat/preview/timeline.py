"""The time that a viewport shows, and how it goes on by itself; whoever has a clock ticks it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from usdsplat.core.errors import UsageError

_LONGEST = 1.0
"""Time without a tick after which it goes on where it was rather than jump [s]."""


@dataclass(slots=True, kw_only=True)
class Timeline:
    """A range of frames, one of which is shown. Times are time codes.

    It plays in real time: where pictures take longer than a frame, frames are left out.
    """

    start: float = 0.0
    end: float = 0.0
    rate: float = 24.0
    """Time codes in a second."""
    step: float = 1.0
    """From one frame to the next [time code]."""
    current: float = 0.0
    is_playing: bool = False
    loops: bool = True
    """Whether it begins again at the end, rather than stop there."""

    _frames: float = field(default=0.0, repr=False)
    """Frames that were due since the last one that was shown, a part of one."""
    _last: float | None = field(default=None, repr=False)
    """When it was ticked last [s]."""

    def set_range(self, start: float, end: float) -> None:
        """Play another range; what is shown stays in it.

        Raises:
            UsageError: If it ends before it starts, or an end is no finite number.
        """
        if not (math.isfinite(start) and math.isfinite(end) and start <= end):
            raise UsageError("range", f"{start:g} to {end:g}", "two numbers, the first not larger")
        self.start, self.end = float(start), float(end)
        self.current = min(max(self.current, self.start), self.end)

    def set_rate(self, rate: float) -> None:
        """Play at another rate [time code/s].

        Raises:
            UsageError: If it is not positive.
        """
        self.rate = _positive("rate", rate)

    def set_step(self, step: float) -> None:
        """Have frames farther apart, or nearer [time code].

        Raises:
            UsageError: If it is not positive.
        """
        self.step = _positive("step", step)

    def go(self, time: float) -> float:
        """Show a time, or the nearest in the range; returns it. What plays goes on from there.

        Raises:
            UsageError: If it is no number.
        """
        if math.isnan(time):
            raise UsageError("time", "nan", "a number")
        self.current = min(max(float(time), self.start), self.end)
        self._frames = 0.0
        return self.current

    def advance(self, frames: int) -> float:
        """Show the frame that is so many later, or earlier, and stop playing; returns its time.

        Frames are whole steps from the start. Beyond an end it goes on at the other one if it
        loops; a time between two frames goes to the next one of them first.
        """
        self.play(False)
        place = round((self.current - self.start) / self.step, 6)
        near = math.floor(place) if frames > 0 else math.ceil(place)
        return self.go(self._at(near + frames))

    def play(self, is_playing: bool = True) -> None:
        """Play from where it is, or from the start if that is the end; or stop."""
        if is_playing and not self.is_playing and self._is_last():
            self.current = self.start
        self.is_playing = is_playing
        self._frames, self._last = 0.0, None

    def tick(self, now: float) -> float | None:
        """The time to show now, if it is another than before; None to leave it.

        Args:
            now: Of a clock that never runs backwards [s].
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
        """Frames of the range."""
        return math.floor((self.end - self.start) / self.step + 1e-6) + 1

    def _at(self, number: int) -> float:
        """The time of a frame; beyond an end that of the other one, or the end."""
        count = self._count()
        number = number % count if self.loops else min(max(number, 0), count - 1)
        return self.start + number * self.step

    def _is_last(self) -> bool:
        """Whether no frame comes after the one that is shown."""
        return self.current + self.step > self.end + 1e-6 * self.step


def _positive(what: str, number: float) -> float:
    if not 0 < number < math.inf:
        raise UsageError(what, f"{number:g}", "a positive number")
    return float(number)
