"""Find the grade that makes colours look like others: exposure, white balance, a matrix.

The fit is by least squares of differences relative to the wanted brightness, so that shadows count
as highlights do. It is robust by trimming: from a first guess by medians on, only the colours that
fit well are fitted again, until they stay the same ones; what is not in both pictures drops out.

Source: Rousseeuw and Van Driessen 2006, the concentration steps of least trimmed squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.core.errors import UsageError
from usdsplat.core.grade import NEUTRAL_TEMPERATURE, RANGES, UNIT, Grade
from usdsplat.images.color import color_space, to_xyz
from usdsplat.images.grade import grade_matrix

Part = Literal["exposure", "whiteBalance", "matrix"]
PARTS: tuple[Part, ...] = get_args(Part)

SPACE = "lin_rec709_scene"
"""The linear space of everything here."""
SHADOW = 0.02
"""Brightness, of that of all colours, below which differences count as absolute ones."""
KEPT = 0.7
"""Part of the colours that a concentration step keeps."""
INLIER = 3.0
"""Times the median error: what is further off does not count in the end."""
FLAT = 0.02
"""Least spread of the colours, of the greatest, that tells a matrix from a balance."""
FEWEST = 6
"""Colours without which there is no matrix."""
STEPS = 30
"""Concentration steps at most; a few are enough."""
WARM_START = 300.0
"""[mired] of the second start: from daylight alone the way to tungsten may end at the locus's
corner."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A grade that was found."""

    grade: Grade
    """For a field in Rec.709; `in_primaries` says what it is for others."""
    used: int
    """Colours that it was fitted to in the end."""
    notes: tuple[str, ...] = ()
    """What was left out, and why."""


def fit_grade(found: npt.ArrayLike, wanted: npt.ArrayLike, *, parts: Sequence[str] = PARTS) -> Fit:
    """Return the grade that takes colours nearest to those that are wanted.

    Exposure and balance are fitted first, so that the matrix holds only what they cannot do.

    Args:
        found: Ungraded colours, linear Rec.709, shape (n, 3).
        wanted: What they should be, shape (n, 3).
        parts: Which of `PARTS` may change; others stay neutral.

    Raises:
        UsageError: If a part is unknown, or there is nothing to fit to.
    """
    for part in parts:
        if part not in PARTS:
            raise UsageError("--fit", repr(part), f"of {', '.join(PARTS)}")
    x, y = np.asarray(found, np.float64), np.asarray(wanted, np.float64)
    if not len(x) or not x.any() or not y.any():
        raise UsageError("fit", "no colours", "some that are in both")
    brightness = y.mean(axis=1)
    weights = 1.0 / (np.maximum(brightness, 0.0) + SHADOW * brightness.mean())
    free, notes = set(parts), []
    if "matrix" in free and (why := _too_flat(x * weights[:, None])):
        free.remove("matrix")
        notes.append(why)
    x, y = x * weights[:, None], y * weights[:, None]
    keep = _typical(x, y)
    for _ in range(STEPS):
        grade = _fit(x[keep], y[keep], free)
        before, keep = keep, _best(_residuals(grade, x, y), KEPT)
        if np.array_equal(before, keep):
            break
    residuals = _residuals(grade, x, y)
    keep = residuals <= max(INLIER * np.median(residuals), 1e-9)
    return Fit(grade=_fit(x[keep], y[keep], free), used=int(keep.sum()), notes=tuple(notes))


def in_primaries(grade: Grade, space: str) -> Grade:
    """Return the grade that does to linear colours of `space` what `grade` does to Rec.709.

    Exposure and balance mean the same everywhere; gain and saturation must be neutral.
    """
    chromaticities = color_space(space).chromaticities
    if chromaticities is None or grade.matrix == UNIT:
        return grade
    rec709 = color_space(SPACE).chromaticities
    assert rec709 is not None
    to_rec709 = np.linalg.solve(to_xyz(rec709), to_xyz(chromaticities))
    matrix = np.linalg.solve(to_rec709, np.reshape(grade.matrix, (3, 3)) @ to_rec709)
    return Grade(
        exposure=grade.exposure,
        temperature=grade.temperature,
        tint=grade.tint,
        matrix=tuple(matrix.ravel().tolist()),
    )


def apply_grade(rgb: npt.ArrayLike, grade: Grade) -> F64:
    """Return linear Rec.709 colours, shape (..., 3), graded."""
    graded: F64 = np.asarray(rgb, np.float64) @ _matrix(grade).T
    return graded


def _fit(x: F64, y: F64, free: set[str]) -> Grade:
    """Least squares, without any weights or robustness."""
    # Only these sums matter. With S = L Lᵀ the squares are those of T L − C L⁻ᵀ, nine numbers.
    s, c = x.T @ x, y.T @ x
    low = np.linalg.cholesky(s + 1e-12 * np.trace(s) * np.eye(3))
    target: F64 = np.linalg.solve(low, c.T).T.astype(np.float64)
    grade = _balance(low, target, free)
    if "matrix" not in free:
        return grade
    whole = np.linalg.solve(low.T, target.T).T
    matrix = np.linalg.solve(_matrix(grade), whole)
    return Grade(
        exposure=grade.exposure,
        temperature=grade.temperature,
        tint=grade.tint,
        matrix=tuple(matrix.ravel().tolist()),
    )


def _balance(low: F64, target: F64, free: set[str]) -> Grade:
    """Exposure [stop], mired and thousandths of Duv, by Levenberg and Marquardt."""
    neutral = 1e6 / NEUTRAL_TEMPERATURE
    active = np.array(["exposure" in free, "whiteBalance" in free, "whiteBalance" in free])
    if not active.any():
        return Grade()

    scale = np.linalg.norm(target)

    def errors(values: F64) -> F64:
        return ((_matrix(_grade(values)) @ low - target) / scale).ravel()

    best, steps = np.inf, np.array([1e-4, 1e-2, 1e-2])
    exposure = float(np.log2(scale / np.linalg.norm(low))) if active[0] else 0.0
    for mired in (neutral, WARM_START) if active[1] else (neutral,):
        now = np.array([exposure, mired, 0.0])
        damping, error = 1e-3, errors(now)
        for _ in range(100):
            slopes = np.stack(
                [
                    (errors(now + step) - errors(now - step)) / (2 * steps[i])
                    for i, step in enumerate(np.diag(steps))
                    if active[i]
                ],
                axis=1,
            )
            normal = slopes.T @ slopes
            move = np.zeros(3)
            move[active] = np.linalg.solve(
                normal + damping * np.diag(np.diag(normal) + 1e-12), -slopes.T @ error
            )
            tried = errors(now + move)
            if tried @ tried < error @ error:
                now, error, damping = now + move, tried, damping * 0.2
            else:
                damping *= 8.0
            if np.abs(move / (1.0, 100.0, 10.0)).max() < 1e-10 or damping > 1e12:
                break
        if error @ error < best:
            values, best = now, float(error @ error)
    return _grade(values)


def _grade(values: F64) -> Grade:
    """A grade of the numbers that are fitted, kept in range."""
    exposure, mired, tint = values.tolist()
    warm, cool = RANGES["temperature"]
    return Grade(
        exposure=float(np.clip(exposure, *RANGES["exposure"])),
        temperature=float(np.clip(1e6 / max(mired, 1.0), warm, cool)),
        tint=float(np.clip(1e-3 * tint, *RANGES["tint"])),
    )


def _matrix(grade: Grade) -> F64:
    return np.reshape(grade_matrix(grade, SPACE), (3, 3))


def _too_flat(x: F64) -> str:
    """Why these colours do not tell a matrix; "" if they do."""
    if len(x) < FEWEST:
        return f"matrix left alone: {len(x)} colours, and it takes {FEWEST}"
    spread = np.linalg.svd(x, compute_uv=False)
    part = spread[2] / spread[0]
    if part >= FLAT:
        return ""
    return f"matrix left alone: the colours are too alike (spread {part:.1%}, it takes {FLAT:.0%})"


def _typical(x: F64, y: F64) -> npt.NDArray[np.bool_]:
    """The colours that the medians of the channels' ratios fit best."""
    legal = x > 1e-9
    gains = [
        np.median(y[legal[:, c], c] / x[legal[:, c], c]) for c in range(3) if legal[:, c].any()
    ]
    gain = np.array(gains) if len(gains) == 3 else np.full(3, np.mean(gains))
    return _best(np.linalg.norm(x * gain - y, axis=1), 0.5)


def _residuals(grade: Grade, x: F64, y: F64) -> F64:
    distances: F64 = np.linalg.norm(apply_grade(x, grade) - y, axis=1)
    return distances


def _best(residuals: F64, part: float) -> npt.NDArray[np.bool_]:
    """The given part of the colours, those with the least residuals."""
    limit = np.quantile(residuals, part)
    best: npt.NDArray[np.bool_] = residuals <= limit
    return best
