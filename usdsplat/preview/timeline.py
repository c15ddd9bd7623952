"""The time that a viewport shows, and how it goes on by itself; whoever has a clock ticks it."""

from __future__ import annotations

from dataclasses import dataclass


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
    """From one frame to the next."""
    current: float = 0.0
    is_playing: bool = False
    loops: bool = True
    """Whether it begins again at the end, rather than stop there."""

    def set_range(self, start: float, end: float) -> None:
        """Play another range; what is shown stays in it.

        Raises:
            UsageError: If it ends before it starts, or an end is no finite number.
        """
        raise NotImplementedError

    def set_rate(self, rate: float) -> None:
        """Play at another rate [time code/s].

        Raises:
            UsageError: If it is not positive.
        """
        raise NotImplementedError

    def set_step(self, step: float) -> None:
        """Have frames farther apart, or nearer [time code].

        Raises:
            UsageError: If it is not positive.
        """
        raise NotImplementedError

    def go(self, time: float) -> float:
        """Show a time, or the nearest in the range; returns it. What plays goes on from there."""
        raise NotImplementedError

    def advance(self, frames: int) -> float:
        """Show the frame that is so many later, or earlier, and stop playing; returns its time.

        Frames are whole steps from the start; beyond an end it goes on at the other one if it
        loops.
        """
        raise NotImplementedError

    def play(self, is_playing: bool = True) -> None:
        """Play from where it is, or from the start if that is the end; or stop."""
        raise NotImplementedError

    def tick(self, now: float) -> float | None:
        """The time to show now, if it is another than before; None to leave it.

        Args:
            now: Of a clock that never runs backwards [s].
        """
        raise NotImplementedError
