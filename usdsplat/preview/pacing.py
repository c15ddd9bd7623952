"""Choose the quality of the next picture from the times of the last ones.

While the view moves, a picture is drawn at reduced resolution, and with fewer splats if that is
still too slow, so that it takes about a thirtieth of a second. When the view rests it is drawn in
full, with an intermediate picture if that takes long.

The time of a picture has a part per splat and a part per pixel. Both are estimated from the last
pictures' times by median, so that a single delay has no effect. A finer scale is used only after it
has been affordable for a while, and one that had to be given up is tried later each time, so that
the quality does not flicker.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

SCALES = (1.0, 1.5, 2.0, 3.0)
"""Viewport pixels per side of a drawn pixel, with all splats."""
BUDGETS = tuple(int(2.0 ** (0.5 * i)) for i in range(50, 31, -1))
"""Splat budgets at the last of `SCALES`: even larger pixels would look worse than fewer splats."""
MUCH_LESS = 0.85
"""Maximum fraction of the splats for a budget to be worthwhile."""
COARSEST = (4.0, 6.0)
"""Scales for the smallest splat budget."""
STEADY = 0.2
"""Measured fraction of the pixel time that does not depend on the scale; the rest is 1 / scale."""
MOVING_MS = 35.0
"""Time limit of a picture while the view moves."""
OPENING_MS = 20.0
"""Time limit of the first picture of a movement. It is shorter than that of the others, because the
full picture in progress must end before it begins."""
RESTING_MS = 150.0
"""Time limit to draw the full picture at once when the view rests."""
LONGEST_MS = 1500.0
"""Time limit of the final picture of splat trees, which would have any number of splats: until it
is drawn, the view does not move."""
MIDDLE_MS = 100.0
"""Time limit of the intermediate picture."""
WORTH = 1.3
"""Time limit if even the coarsest quality is too slow, as a multiple of its time: the finest
quality within this limit is used."""
SLACK = 1.15
"""Factor on the time limit above which a picture becomes coarser."""
EASE = 0.8
"""Fraction of the time limit below which a finer scale is affordable."""
PATIENCE, MOST_PATIENCE = 0.5, 8.0
"""Initial and maximum time for which a finer scale must have been affordable [s]."""
REMEMBERED = 5
"""Number of pictures that times are taken from."""
SPLAT_NS, PIXEL_NS = 90.0, 50.0
"""Initial estimates [ns]."""
DOUBTED = 2
"""Number of pictures that the initial estimate counts for, until newer ones replace it."""
JUMP = 0.3
"""Minimum relative change of the work to estimate the constant part of the time."""
CONSTANT_MS = 10.0
"""Limit of the constant part. A machine that is busy for a moment can make a small picture as slow
as a full one, which says nothing of either."""
BELIEF = 0.5
"""Weight of a new estimate of the constant part relative to the previous ones."""
NEAR = 1
"""Number of steps of quality by which estimates differ from one movement to the next."""
REGRET = 3.0
"""A finer scale that is given up within this time counts as a mistake [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """The amount of work of a picture."""

    pixels: int
    """Pixels of the viewport."""
    splats: int
    """Splats on the stage, counting every instance."""
    samples: int = 1
    """Number of samples in full quality."""
    has_trees: bool = False
    """Whether a budget selects coarser levels instead of fewer splats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """The quality of a picture."""

    scale: float = 1.0
    """Viewport pixels per side of a drawn pixel."""
    splats: int | None = None
    """Splat budget; None for all."""
    averages: bool = True
    """Whether all samples of a picture are drawn."""

    @property
    def is_whole(self) -> bool:
        """Whether a picture at rest may stay: no larger pixels, and all samples."""
        return self.scale == 1.0 and self.averages

    def is_at_least(self, other: Quality) -> bool:
        """Return whether `other` is better in no respect."""
        mine, theirs = self.splats or math.inf, other.splats or math.inf
        return self.scale <= other.scale and mine >= theirs and self.averages >= other.averages


FULL = Quality()


class Cost:
    """A cost model of work [ms]: a time per piece, and a constant.

    The time per piece is the median of the last pictures. The constant is estimated where the
    amount of work jumps from one picture to the next, because the view is still nearly the same
    there.

    Args:
        guess: Initial estimate of the time per piece.
    """

    def __init__(self, guess: float) -> None:
        self._seen: deque[tuple[float, float]] = deque([(1.0, guess)] * DOUBTED, REMEMBERED)
        self._start: float | None = None

    def learn(self, work: float, took: float, *, has_constant: bool = True) -> None:
        """Add the measurement of a picture. Without a constant, all of it was per piece."""
        work = max(work, 1.0)
        before, _ = self._seen[-1]
        if not has_constant:
            self._start = None
        elif before > 1.0 and abs(work - before) > JUMP * before:
            was = median(ms for amount, ms in self._seen if amount == before)
            start = (was * work - took * before) / (work - before)
            start = min(max(start, 0.0), was, took, CONSTANT_MS)
            self._start = (
                start if self._start is None else self._start + BELIEF * (start - self._start)
            )
        self._seen.append((work, took))

    def of(self, work: float) -> float:
        """Return the expected time of an amount of work."""
        start = self._start or 0.0
        return start + work * median(max(took - start, 0.0) / amount for amount, took in self._seen)


class Pacer:
    """Pacer of one viewport, which chooses the quality of each picture. Times are in milliseconds.

    `drew` records every picture; `moving` and `resting` choose the next one.
    """

    def __init__(self) -> None:
        self._splats, self._pixels = Cost(1e-6 * SPLAT_NS), Cost(1e-6 * PIXEL_NS)
        self._held: Quality | None = None
        """Quality during the current movement; None at rest."""
        self._last: Quality | None = None
        """Quality at the end of the last movement."""
        self._opened: Quality | None = None
        """Quality that the last movement began with."""
        self._easy_since: float | None = None
        self._raised_at = -math.inf
        self._patience = PATIENCE

    # --- what pictures took ----------------------------------------------------------------

    def drew(self, quality: Quality, load: Load, *, fixed: float, rest: float) -> None:
        """Record a picture: work per splat took `fixed`, all else `rest`.

        The first one of a movement says nothing: it is too like the next to tell what is constant.
        """
        if self._held is not None and quality == self._opened != self._held:
            return
        splats, pixels = _work(quality, load)
        has_constant = not load.has_trees  # of whose levels the views are not nearly the same
        self._splats.learn(splats, fixed, has_constant=has_constant)
        self._pixels.learn(pixels, rest, has_constant=has_constant)

    def expected(self, quality: Quality, load: Load) -> float:
        """Return the expected time of a picture."""
        splats, pixels = _work(quality, load)
        return self._splats.of(splats) + self._pixels.of(pixels)

    # --- what comes next -------------------------------------------------------------------

    def moving(self, now: float, load: Load) -> Quality:
        """Return the quality of the next picture of a movement; `now` is any clock's time [s]. The
        first one is coarser than the next ones, so that it comes sooner."""
        choices = _choices(load)
        held = self._held
        if held is None:
            self._easy_since, self._patience, self._raised_at = None, PATIENCE, -math.inf
            self._held = self._last = self.first(load)
            self._opened = self.opening(load)
            return self._opened
        if held not in choices:  # the number of splats or pixels has changed
            self._held, self._easy_since = self._best(choices, MOVING_MS, load), None
        elif self.expected(held, load) > SLACK * MOVING_MS:
            self._give_up(now, held, choices, load)
        elif held != choices[0]:
            self._maybe_raise(now, choices[choices.index(held) - 1], load)
        self._last = self._held
        return self._held or FULL

    def resting(self, shown: Quality | None, load: Load) -> Quality:
        """Return the quality of the next picture at rest; `FULL` unless that takes long. That of
        splat trees may have a budget.

        Args:
            shown: Quality of the current picture of the same view; None if there is none.
        """
        self._held = None
        if self.expected(FULL, load) <= RESTING_MS:
            return FULL
        if load.has_trees and shown is not None and shown.is_whole:
            return shown  # estimates change with each picture
        whole = [each for each in _choices(load) if each.splats is None or load.has_trees]
        middle = self._best(whole, MIDDLE_MS, load)
        return self._final(load) if shown is not None and shown.is_at_least(middle) else middle

    def first(self, load: Load) -> Quality:
        """Return the quality that a movement will go on with: that of the last one if it still
        fits, as its splats are at hand."""
        return self._near(self._last, MOVING_MS, load)

    def opening(self, load: Load) -> Quality:
        """Return the quality of the first picture of a movement, likewise."""
        first, opening = self.first(load), self._near(self._opened, OPENING_MS, load)
        return opening if first.is_at_least(opening) else first

    # --- private ---------------------------------------------------------------------------

    def _near(self, last: Quality | None, limit: float, load: Load) -> Quality:
        """Return the best affordable quality, or an earlier one that differs by `NEAR` steps."""
        choices = _choices(load)
        best = self._best(choices, limit, load)
        if last not in choices or abs(choices.index(best) - choices.index(last)) > NEAR:
            return best
        return last

    def _final(self, load: Load) -> Quality:
        """Return the quality of a picture at rest that stays."""
        if not load.has_trees or self.expected(FULL, load) <= LONGEST_MS:
            return FULL
        fewer = [Quality(splats=count) for count in BUDGETS if count < load.splats]
        affordable = (each for each in fewer if self.expected(each, load) <= LONGEST_MS)
        return next(affordable, fewer[-1] if fewer else FULL)

    def _best(self, choices: Sequence[Quality], limit: float, load: Load) -> Quality:
        """Return the first affordable choice; without one, the first that takes at most `WORTH`
        times as long as the last."""
        least = self.expected(choices[-1], load)
        limit = limit if least <= limit else WORTH * least
        return next(each for each in choices if self.expected(each, load) <= limit)

    def _give_up(self, now: float, held: Quality, choices: list[Quality], load: Load) -> None:
        """Reduce the quality, and wait longer before raising it if raising it was a mistake."""
        best = self._best(choices, MOVING_MS, load)
        if choices.index(best) <= choices.index(held):
            return
        if now - self._raised_at < REGRET:
            self._patience = min(2.0 * self._patience, MOST_PATIENCE)
        self._held, self._easy_since = best, None

    def _maybe_raise(self, now: float, better: Quality, load: Load) -> None:
        """Raise the quality if it has been affordable for long enough."""
        if self.expected(better, load) > EASE * MOVING_MS:
            self._easy_since = None
        elif self._easy_since is None:
            self._easy_since = now
        elif now - self._easy_since >= self._patience:
            self._held, self._easy_since, self._raised_at = better, None, now


def _choices(load: Load) -> list[Quality]:
    """Return the qualities of a movement, the best first."""
    alone = load.samples == 1
    found = [Quality(scale=scale, averages=alone) for scale in SCALES]
    fewer = [count for count in BUDGETS if count < MUCH_LESS * load.splats]
    found += [Quality(scale=SCALES[-1], splats=count, averages=alone) for count in fewer]
    least = fewer[-1] if fewer else None
    return found + [Quality(scale=scale, splats=least, averages=alone) for scale in COARSEST]


def _work(quality: Quality, load: Load) -> tuple[float, float]:
    """Return the splats of a picture, and the equivalent number of full-quality pixels."""
    samples = load.samples if quality.averages else 1
    part = min(1.0, quality.splats / load.splats) if quality.splats and load.splats else 1.0
    pixels = STEADY * part + (1.0 - STEADY) * math.sqrt(part) / quality.scale
    return samples * part * load.splats, samples * load.pixels * pixels
