"""How good the next picture may be, from what the last ones took.

While the view moves, a picture is drawn at a part of the viewport's resolution, and with a part of
the splats where even that is too slow, so that it takes about a thirtieth of a second. When the
view rests it is drawn in full, with a step between where that takes long.

A picture takes what is done once for each splat and what is done for each pixel; both follow from
the last pictures' times by median, so that one that was held up counts for nothing. A finer scale
is taken up only after it has been affordable for a while, and one that was given up again is tried
later each time: quality does not flicker.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Pixels of the viewport to a side of a drawn one."""
MOVING_MS = 30.0
"""What a picture may take while the view moves."""
RESTING_MS = 150.0
"""What the full picture may take to be drawn at once when the view rests."""
MIDDLE_MS = 100.0
"""What the picture between may take."""
SLACK = 1.15
"""How far past what it may take a picture goes before it becomes coarser."""
EASE = 0.75
"""A finer scale must take less than this part of what it may."""
PATIENCE, MOST_PATIENCE = 0.5, 8.0
"""Seconds for which a finer scale must have been affordable."""
REMEMBERED = 5
"""Pictures that times are taken from."""
SPLAT_NS, PIXEL_NS = 60.0, 100.0
"""What is expected before anything was drawn."""
DOUBTED = 2
"""Pictures that it takes to give that up."""
SHARE = 0.6
"""Part of the time that splats may take before some of them are left out."""
LEAST_SPLATS = 50_000
WIDE = 1.5
"""By which factor what can be afforded must change before another part of the splats is drawn."""
REGRET = 3.0
"""Seconds within which a finer scale that had to be given up was a mistake."""

Took = Callable[[float], float]
"""What a picture at a scale will take."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """What there is to draw."""

    pixels: int
    """Of the viewport."""
    splats: int
    """On the stage, instances counted each."""
    samples: int = 1
    """Pictures that are averaged in full quality."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How one picture is drawn."""

    scale: float = 1.0
    """Pixels of the viewport to a side of a drawn one."""
    splats: int | None = None
    """Most splats to draw; None for all."""
    averages: bool = True
    """Whether it has all samples, where one picture is averaged of many."""

    def is_at_least(self, other: Quality) -> bool:
        """Whether nothing of `other` is better."""
        mine, theirs = self.splats or math.inf, other.splats or math.inf
        return self.scale <= other.scale and mine >= theirs and self.averages >= other.averages


FULL = Quality()


class Pacer:
    """Chooses the quality of each picture of one viewport. Times are in milliseconds.

    Told of every picture by `drew`, asked for the next by `moving` and `resting`.
    """

    def __init__(self) -> None:
        self._splat_ns: deque[float] = deque([SPLAT_NS] * DOUBTED, REMEMBERED)
        self._pixel_ns: deque[float] = deque([PIXEL_NS] * DOUBTED, REMEMBERED)
        self._scale: float | None = None
        """Of the movement that goes on; None at rest."""
        self._easy_since: float | None = None
        self._raised_at = -math.inf
        self._patience = PATIENCE
        self._splats: int | None = None

    # --- what pictures took ----------------------------------------------------------------

    def drew(self, quality: Quality, load: Load, *, fixed: float, rest: float) -> None:
        """Learn from a picture: what was done once for each splat took `fixed`, all else `rest`."""
        splats, pixels = _work(quality, load)
        self._splat_ns.append(1e6 * fixed / max(splats, 1))
        self._pixel_ns.append(1e6 * rest / max(pixels, 1))

    def expected(self, quality: Quality, load: Load) -> float:
        """What a picture will take."""
        splats, pixels = _work(quality, load)
        return 1e-6 * (splats * median(self._splat_ns) + pixels * median(self._pixel_ns))

    # --- what comes next -------------------------------------------------------------------

    def moving(self, now: float, load: Load) -> Quality:
        """Return how to draw the next picture of a movement; `now` is any clock's [s]."""
        begins = self._scale is None
        if begins:
            self._easy_since, self._patience, self._raised_at = None, PATIENCE, -math.inf
            self._splats = None
        self._splats = self._affordable_splats(load.splats)

        def took(scale: float) -> float:
            return self.expected(self._moving_at(scale, load), load)

        if self._scale is None:
            self._scale = _finest(took, MOVING_MS)
        elif took(self._scale) > SLACK * MOVING_MS:
            coarser = max(_finest(took, MOVING_MS), self._scale)
            if coarser > self._scale and now - self._raised_at < REGRET:
                self._patience = min(2.0 * self._patience, MOST_PATIENCE)
            self._scale, self._easy_since = coarser, None
        elif self._scale > SCALES[0]:
            self._scale = self._maybe_finer(now, self._scale, took)
        return self._moving_at(self._scale, load)

    def resting(self, shown: Quality | None, load: Load) -> Quality:
        """Return how to draw the next picture at rest; `FULL` unless that takes long.

        Args:
            shown: How the picture was drawn that shows the same already; None if there is none.
        """
        self._scale = None
        if self.expected(FULL, load) <= RESTING_MS:
            return FULL
        alone = load.samples == 1
        scale = _finest(
            lambda scale: self.expected(Quality(scale=scale, averages=alone), load), MIDDLE_MS
        )
        middle = Quality(scale=scale, averages=alone)
        return FULL if shown is not None and shown.is_at_least(middle) else middle

    # --- private ---------------------------------------------------------------------------

    def _moving_at(self, scale: float, load: Load) -> Quality:
        return Quality(scale=scale, splats=self._splats, averages=load.samples == 1)

    def _maybe_finer(self, now: float, scale: float, took: Took) -> float:
        """The scale itself, or the next finer one when it has been affordable for long enough."""
        finer = SCALES[SCALES.index(scale) - 1]
        if took(finer) > EASE * MOVING_MS:
            self._easy_since = None
        elif self._easy_since is None:
            self._easy_since = now
        elif now - self._easy_since >= self._patience:
            self._easy_since, self._raised_at = None, now
            return finer
        return scale

    def _affordable_splats(self, splats: int) -> int | None:
        """Most splats, in steps that are not taken back and forth; None for all."""
        most = SHARE * MOVING_MS * 1e6 / max(median(self._splat_ns), 1e-3)
        held = self._splats
        if most >= (splats if held is None else WIDE * splats):
            return None
        if held is not None and held / WIDE < most < held * WIDE:
            return held
        wanted = max(int(most), LEAST_SPLATS)
        return wanted if wanted < splats else None


def _work(quality: Quality, load: Load) -> tuple[int, float]:
    """Splats and pixels of a picture, counted for each of its samples."""
    samples = load.samples if quality.averages else 1
    splats = min(load.splats, quality.splats or load.splats)
    return samples * splats, samples * load.pixels / quality.scale**2


def _finest(took: Took, limit: float) -> float:
    """The finest scale within a limit, or the coarsest."""
    return next((scale for scale in SCALES if took(scale) <= limit), SCALES[-1])
