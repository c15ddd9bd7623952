"""How good the next picture may be, from what the last ones took.

While the view moves, a picture is drawn at a part of the viewport's resolution, and with a part of
the splats where even that is too slow, so that it takes about a thirtieth of a second. When the
view rests it is drawn in full, with a step between where that takes long.

A picture takes what is done once for each splat and what is done for pixels; both follow from the
last pictures' times by median, so that one that was held up counts for nothing. A finer scale
is taken up only after it has been affordable for a while, and one that was given up again is tried
later each time: quality does not flicker.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

SCALES = (1.0, 1.5, 2.0, 3.0)
"""Pixels of the viewport to a side of a drawn one, with all splats."""
BUDGETS = tuple(int(2.0 ** (0.5 * i)) for i in range(50, 31, -1))
"""Most splats, at the last of `SCALES`: larger pixels still would look worse than fewer splats."""
MUCH_LESS = 0.85
"""Part of the splats that a budget must be below."""
COARSEST = (4.0, 6.0)
"""Scales where no more splats can be left out."""
STEADY = 0.2
"""Part of what pixels take that no scale saves: as measured, the rest goes with 1 / scale."""
MOVING_MS = 35.0
"""What a picture may take while the view moves."""
RESTING_MS = 150.0
"""What the full picture may take to be drawn at once when the view rests."""
MIDDLE_MS = 100.0
"""What the picture between may take."""
WORTH = 1.3
"""Times the least possible that a picture may take where nothing is affordable: coarser ones would
save too little to be seen so."""
SLACK = 1.15
"""How far past what it may take a picture goes before it becomes coarser."""
EASE = 0.8
"""A finer scale must take less than this part of what it may."""
PATIENCE, MOST_PATIENCE = 0.5, 8.0
"""Seconds for which a finer scale must have been affordable."""
REMEMBERED = 5
"""Pictures that times are taken from."""
SPLAT_NS, PIXEL_NS = 90.0, 50.0
"""What is expected before anything was drawn."""
DOUBTED = 2
"""Pictures that it takes to give that up."""
JUMP = 0.3
"""By which part work must change to tell what no saving of work saves."""
BELIEF = 0.5
"""How far one such change is believed."""
REGRET = 3.0
"""Seconds within which a finer scale that had to be given up was a mistake."""


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


class Cost:
    """What work takes [ms]: so much for each piece of it, and something however little it is.

    The first follows from the last pictures by median. The second shows where the amount of work
    jumps from one picture to the next, for there the view is still nearly the same.

    Args:
        guess: What a piece is believed to take before there were pictures.
    """

    def __init__(self, guess: float) -> None:
        self._seen: deque[tuple[float, float]] = deque([(1.0, guess)] * DOUBTED, REMEMBERED)
        self._start: float | None = None

    def learn(self, work: float, took: float) -> None:
        """Take in one picture."""
        work = max(work, 1.0)
        before, _ = self._seen[-1]
        if before > 1.0 and abs(work - before) > JUMP * before:
            was = median(ms for amount, ms in self._seen if amount == before)
            start = (was * work - took * before) / (work - before)
            start = min(max(start, 0.0), was, took)
            self._start = (
                start if self._start is None else self._start + BELIEF * (start - self._start)
            )
        self._seen.append((work, took))

    def of(self, work: float) -> float:
        """What some work will take."""
        start = self._start or 0.0
        return start + work * median(max(took - start, 0.0) / amount for amount, took in self._seen)


class Pacer:
    """Chooses the quality of each picture of one viewport. Times are in milliseconds.

    Told of every picture by `drew`, asked for the next by `moving` and `resting`.
    """

    def __init__(self) -> None:
        self._splats, self._pixels = Cost(1e-6 * SPLAT_NS), Cost(1e-6 * PIXEL_NS)
        self._held: Quality | None = None
        """Of the movement that goes on; None at rest."""
        self._easy_since: float | None = None
        self._raised_at = -math.inf
        self._patience = PATIENCE

    # --- what pictures took ----------------------------------------------------------------

    def drew(self, quality: Quality, load: Load, *, fixed: float, rest: float) -> None:
        """Learn from a picture: what was done once for each splat took `fixed`, all else `rest`."""
        splats, pixels = _work(quality, load)
        self._splats.learn(splats, fixed)
        self._pixels.learn(pixels, rest)

    def expected(self, quality: Quality, load: Load) -> float:
        """What a picture will take."""
        splats, pixels = _work(quality, load)
        return self._splats.of(splats) + self._pixels.of(pixels)

    # --- what comes next -------------------------------------------------------------------

    def moving(self, now: float, load: Load) -> Quality:
        """Return how to draw the next picture of a movement; `now` is any clock's [s]."""
        choices = _choices(load)
        held = self._held
        if held is None:
            self._easy_since, self._patience, self._raised_at = None, PATIENCE, -math.inf
            self._held = self._best(choices, MOVING_MS, load)
        elif held not in choices:  # splats or pixels have come or gone
            self._held, self._easy_since = self._best(choices, MOVING_MS, load), None
        elif self.expected(held, load) > SLACK * MOVING_MS:
            self._give_up(now, held, choices, load)
        elif held != choices[0]:
            self._maybe_raise(now, choices[choices.index(held) - 1], load)
        return self._held or FULL

    def resting(self, shown: Quality | None, load: Load) -> Quality:
        """Return how to draw the next picture at rest; `FULL` unless that takes long.

        Args:
            shown: How the picture was drawn that shows the same already; None if there is none.
        """
        self._held = None
        if self.expected(FULL, load) <= RESTING_MS:
            return FULL
        whole = [each for each in _choices(load) if each.splats is None]
        middle = self._best(whole, MIDDLE_MS, load)
        return FULL if shown is not None and shown.is_at_least(middle) else middle

    # --- private ---------------------------------------------------------------------------

    def _best(self, choices: Sequence[Quality], limit: float, load: Load) -> Quality:
        """The first that is affordable; where none is, the first that takes little more than the
        last."""
        least = self.expected(choices[-1], load)
        limit = limit if least <= limit else WORTH * least
        return next(each for each in choices if self.expected(each, load) <= limit)

    def _give_up(self, now: float, held: Quality, choices: list[Quality], load: Load) -> None:
        """Go on with less, and be slower to ask for more again if that was a mistake."""
        best = self._best(choices, MOVING_MS, load)
        if choices.index(best) <= choices.index(held):
            return
        if now - self._raised_at < REGRET:
            self._patience = min(2.0 * self._patience, MOST_PATIENCE)
        self._held, self._easy_since = best, None

    def _maybe_raise(self, now: float, better: Quality, load: Load) -> None:
        """Go on with more when it has been affordable for long enough."""
        if self.expected(better, load) > EASE * MOVING_MS:
            self._easy_since = None
        elif self._easy_since is None:
            self._easy_since = now
        elif now - self._easy_since >= self._patience:
            self._held, self._easy_since, self._raised_at = better, None, now


def _choices(load: Load) -> list[Quality]:
    """How pictures of a movement may be drawn, the best first."""
    alone = load.samples == 1
    found = [Quality(scale=scale, averages=alone) for scale in SCALES]
    fewer = [count for count in BUDGETS if count < MUCH_LESS * load.splats]
    found += [Quality(scale=SCALES[-1], splats=count, averages=alone) for count in fewer]
    least = fewer[-1] if fewer else None
    return found + [Quality(scale=scale, splats=least, averages=alone) for scale in COARSEST]


def _work(quality: Quality, load: Load) -> tuple[float, float]:
    """Splats of a picture, and pixels of a full one that its own take as long as."""
    samples = load.samples if quality.averages else 1
    part = min(1.0, quality.splats / load.splats) if quality.splats and load.splats else 1.0
    pixels = STEADY * part + (1.0 - STEADY) * math.sqrt(part) / quality.scale
    return samples * part * load.splats, samples * load.pixels * pixels
