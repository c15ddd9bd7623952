"""Statistics of a simulation: time by stage, and memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Statistics of a simulation."""

    target: str
    frames: int
    """Frames simulated in this run; fewer than all if a bake was resumed."""
    splats: dict[str, int]
    """Splats at the last frame, by field."""
    seconds: float
    seconds_per_frame: float
    """Median of all frames but the first [s]."""
    stages: dict[str, float] = field(default_factory=dict)
    """Seconds of each stage of the solver, and of writing."""
    phases: dict[str, float] = field(default_factory=dict)
    """Seconds of each phase of the preparation and of the whole run, without those in it."""
    megabytes: float = 0.0
    """Peak memory of the process."""
    is_finished: bool = True
    """Whether all frames are baked; False if the simulation stopped at `SimulateOptions.until`."""

    def sentence(self) -> str:
        """Return the report as a sentence."""
        if not self.frames and not self.is_finished:
            return "nothing to do before the frame of --until"
        if not self.frames:
            return "nothing to do: all frames are baked already"
        slowest = sorted(self.stages.items(), key=lambda item: -item[1])[:3]
        where = ", ".join(f"{name} {spent:.1f} s" for name, spent in slowest)
        return (
            f"{self.frames} frames of {sum(self.splats.values()):,} splats in {self.seconds:.1f} "
            f"s, {self.seconds_per_frame:.2f} s a frame ({where}), at most {self.megabytes:,.0f} MB"
        )


class Clock:
    """Wall time by stage, without compilation, which happens only once.

    Args:
        compiled: Returns the time spent on compilation so far [s].
    """

    def __init__(self, compiled: Callable[[], float] = lambda: 0.0) -> None:
        self.spent: dict[str, float] = {}
        self._compiled = compiled
        self._began = time.perf_counter()
        self._last = self.now

    @property
    def elapsed(self) -> float:
        """Wall time since the clock was made, compiling included [s]."""
        return time.perf_counter() - self._began

    @property
    def now(self) -> float:
        """Wall time without compilation [s], from an arbitrary origin."""
        return time.perf_counter() - self._compiled()

    def lap(self, name: str) -> None:
        """Add the time since the last call to a stage."""
        now = self.now
        self.spent[name] = self.spent.get(name, 0.0) + now - self._last
        self._last = now
