"""Fit a grade that matches colours to a reference: exposure, white balance, a matrix.

The fit minimises squared differences relative to the wanted brightness, so that shadows count as
much as highlights. It is made robust by trimming: starting from medians, only the colours that fit
well are fitted again, until the set stays the same. Colours that are in only one of the pictures
drop out.

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
"""The linear colour space of this module."""
SHADOW = 0.02
"""Fraction of the mean brightness below which differences count absolutely."""
KEPT = 0.7
"""Fraction of the colours that a concentration step keeps."""
INLIER = 3.0
"""Multiple of the median error above which colours are ignored in the final fit."""
FLAT = 0.02
"""Minimum spread of the colours, relative to the largest, to fit a matrix."""
FEWEST = 6
"""Minimum number of colours to fit a matrix."""
STEPS = 30
"""Maximum number of concentration steps; usually a few suffice."""
WARM_START = 300.0
"""Second starting point [mired]: from daylight alone, a fit of tungsten light may end at the corner
of the locus."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A fitted grade."""

    grade: Grade
    """The grade for a field in Rec.709; `in_primaries` converts it for others."""
    used: int
    """Number of colours in the final fit."""
    notes: tuple[str, ...] = ()
    """Parts of the fit that were skipped, and why."""


def fit_grade(found: npt.ArrayLike, wanted: npt.ArrayLike, *, parts: Sequence[str] = PARTS) -> Fit:
    """Fit the grade that brings colours closest to the wanted ones.

    Exposure and balance are fitted first, so that the matrix holds only the remainder.

    Args:
        found: Ungraded colours, linear Rec.709, shape (n, 3).
        wanted: Reference colours, shape (n, 3).
        parts: The `PARTS` to fit; others stay neutral.

    Raises:
        UsageError: If a part is unknown, or there are no usable colours.
    """
    for part in parts:
        if part not in PARTS:
            raise UsageError("--fit", repr(part), f"one of {', '.join(PARTS)}")
    x, y = np.asarray(found, np.float64), np.asarray(wanted, np.float64)
    if not len(x) or not x.any() or not y.any():
        raise UsageError("fit", "no colours", "colours that both pictures have")
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
    """Convert a grade for Rec.709 to the equivalent for linear colours of `space`.

    Exposure and balance are the same in all spaces; gain and saturation must be neutral.
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
    """Apply a grade to linear Rec.709 colours, shape (..., 3)."""
    graded: F64 = np.asarray(rgb, np.float64) @ _matrix(grade).T
    return graded


def _fit(x: F64, y: F64, free: set[str]) -> Grade:
    """Fit by plain least squares, without weights."""
    # Only these sums matter. With S = L Lᵀ the squared error is that of T L − C L⁻ᵀ, nine numbers.
    s, c = x.T @ x, y.T @ x
    try:
        low = np.linalg.cholesky(s + 1e-12 * np.trace(s) * np.eye(3))
    except np.linalg.LinAlgError:  # the sums overflow, or nothing but black is left
        found = "colours without a finite, positive brightness"
        raise UsageError("fit", found, "colours that both pictures have") from None
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
    """Fit exposure [stop], mired and thousandths of Duv by Levenberg-Marquardt."""
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
    """Return the grade of fitted numbers, clamped to its ranges."""
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
    """Return the reason why these colours do not determine a matrix; "" if they do."""
    if len(x) < FEWEST:
        return f"matrix not fitted: {len(x)} colours, at least {FEWEST} needed"
    spread = np.linalg.svd(x, compute_uv=False)
    part = spread[2] / spread[0]
    if part >= FLAT:
        return ""
    return f"matrix not fitted: the colours are too similar (spread {part:.1%}, needs {FLAT:.0%})"


def _typical(x: F64, y: F64) -> npt.NDArray[np.bool_]:
    """Return which colours fit the medians of the channel ratios best."""
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
    """Return which colours are the given fraction with the smallest residuals."""
    limit = np.quantile(residuals, part)
    best: npt.NDArray[np.bool_] = residuals <= limit
    return best
