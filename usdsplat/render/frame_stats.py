"""Counts and times of a picture."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from usdsplat.core.cancel import CancelToken


@dataclass(slots=True)
class FrameStats:
    """Counts and times of one picture, added over its samples."""

    splats: int = 0
    """Number of drawn splats; each instance counts."""
    total: int = 0
    """Number of splats that would be drawn without a budget."""
    visible: int = 0
    """Splats that may touch the data window."""
    of_trees: int = 0
    """Number of splats of the finest cut of splat trees in the windows; each instance counts."""
    missing: int = 0
    """Parts of nodes of splat trees that coarser ones replace until they are read."""
    light_steps: int = 0
    """Samples of lights that were computed for splats."""
    lacks_light: bool = False
    """Whether something is shown without the light of the scene, which was not waited for."""
    pairs: int = 0
    """Pairs of a splat and a tile that it touches."""
    blocks: int = 0
    """Pairs of a splat and a block of 4x4 pixels that were blended; 0 on a GPU."""
    failed: int = 0
    """Pixels whose captured colour the view cannot produce; only for `inverseView`."""
    asked: int = 0
    """Pixels with splats that `inverseView` converted back through the view."""
    wall_ms: dict[str, float] = field(default_factory=dict)
    cpu_ms: dict[str, float] = field(default_factory=dict)
    """Stage -> CPU time [ms]; `wall_ms` has the elapsed time of each stage."""


class Clock:
    """Stopwatch that adds up the time of each stage.

    Args:
        cancel: Ends the picture after the current stage.
    """

    def __init__(self, stats: FrameStats, cancel: CancelToken) -> None:
        self._stats = stats
        self.cancel = cancel
        self.resume()

    def resume(self) -> None:
        """Restart the clock without counting the time since the last lap, in which the caller
        worked."""
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to `stage`."""
        wall, cpu = time.perf_counter(), time.process_time()
        for book, spent in (
            (self._stats.wall_ms, wall - self._wall),
            (self._stats.cpu_ms, cpu - self._cpu),
        ):
            book[stage] = book.get(stage, 0.0) + 1e3 * spent
        self._wall, self._cpu = wall, cpu
        self.cancel.check()
