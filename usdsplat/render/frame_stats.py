"""What a picture took."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass(slots=True)
class FrameStats:
    """What one picture took; of several samples, all of them together."""

    splats: int = 0
    """Splats that were drawn, instances counted each."""
    total: int = 0
    """Splats that would be drawn without a budget."""
    visible: int = 0
    """Splats that may touch the data window."""
    pairs: int = 0
    """Splats times the tiles that each touches."""
    rows: int = 0
    """Rows of 16 pixels that were blended; 0 on a GPU, which does not count them."""
    failed: int = 0
    """Pixels that no view can show as they were captured; `inverseView` only."""
    asked: int = 0
    """Pixels with splats that `inverseView` took back through the view."""
    wall_ms: dict[str, float] = field(default_factory=dict)
    cpu_ms: dict[str, float] = field(default_factory=dict)
    """Milliseconds by stage."""


class Clock:
    """Adds up what each stage takes."""

    def __init__(self, stats: FrameStats) -> None:
        self._stats = stats
        self.resume()

    def resume(self) -> None:
        """Book nothing for the time since the last lap: the caller had its turn."""
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap to `stage`."""
        wall, cpu = time.perf_counter(), time.process_time()
        for book, spent in (
            (self._stats.wall_ms, wall - self._wall),
            (self._stats.cpu_ms, cpu - self._cpu),
        ):
            book[stage] = book.get(stage, 0.0) + 1e3 * spent
        self._wall, self._cpu = wall, cpu
