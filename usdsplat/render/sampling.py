"""Select the samples of a picture in shutter, lens and pixel.

Every sample is a complete sharp picture. The picture is the plain average of its samples; a
filter's weight is expressed by the density of the samples. The points are fixed, evenly spread in
each dimension and uncorrelated between dimensions. A picture of n samples is therefore always the
same and has no noise.

Source: Vogel 1979 for points on a disc; Roberts 2018 for additive recurrences; Shirley 1990 for
ranks as strata; Harris 1978 for the Blackman-Harris window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
FADE_STEP = math.sqrt(3.0) - 1.0
"""Step of the recurrence for the fades between levels of detail, irrational to the other steps."""
STEPS = (0.7548776662466927, 0.5698402909980532, math.sqrt(2.0) - 1.0)
"""Steps of the additive recurrences for pixel x, pixel y and time. They and their ratios are
irrational."""
WIDTHS = {"box": 1.0, "triangle": 2.0, "gaussian": 3.0, "blackmanHarris": 3.3}
"""Default width of each filter [pixel]."""
GAUSSIAN_CUT = 3.0
"""Standard deviations from the centre of a Gaussian filter to its edge."""
BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)
INNER_LOW_PASS = 0.5
"""Low-pass of coarse levels of splat trees, as a factor on that of a picture whose pixels are the
samples. Measured on playbot_lod2 and flowers_lod2_0, a quarter of the splats from 4 and 8 times the
framing distance: 2x2 samples with 0.5 are as good as 3x3 with 1. Splats as narrow as a sample would
lose or gain 10 % of their light with their position; with 0.25 it would be half."""
TABLE = 4097
"""Number of points at which a filter's distribution is tabulated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One of the sharp pictures that are averaged."""

    time: float = 0.0
    """Time relative to the frame [time code]."""
    lens: tuple[float, float] = (0.0, 0.0)
    """Point of the lens that the ray passes, right and up [scene unit]."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Offset from the pixels' centres, right and down [pixel]."""
    inner_offset: tuple[float, float] = (0.0, 0.0)
    """As `offset`, for coarse levels of splat trees."""
    inner_low_pass: float = 1.0
    """Low-pass of these levels, as a factor on that of the picture."""
    fade: tuple[float, float] = (0.0, 0.0)
    """Part of [0, 1] in which the sample fades levels of splat trees, see `lod.cut`."""


def samples(settings: RenderSettings, camera: CameraSpec) -> tuple[Sample, ...]:
    """Return the samples of a picture. A single sample is sharp and at the time of the frame."""
    n = settings.samples
    if n == 1:
        return (Sample(),)
    x, y, t = (_strata(n, step) for step in STEPS)
    spread = _filter(settings.pixel_filter, settings.filter_width)
    begin, end = camera.shutter if settings.motion_blur else (0.0, 0.0)
    radius = camera.lens_radius if has_lens(camera) and settings.depth_of_field else 0.0
    angle = GOLDEN_ANGLE * np.arange(n)
    away = radius * np.sqrt((np.arange(n) + 0.5) / n)
    times = begin + (end - begin) * t
    rights, ups = away * np.cos(angle), away * np.sin(angle)
    columns, rows = np.interp(x, *spread), np.interp(y, *spread)
    return tuple(
        Sample(time=each[0], lens=(each[1], each[2]), offset=(each[3], each[4]))
        for each in np.stack([times, rights, ups, columns, rows], axis=1).tolist()
    )


def subdivided(
    plan: tuple[Sample, ...], settings: RenderSettings, along: int
) -> tuple[tuple[Sample, ...], ...]:
    """Return samples with own points in the pixel for the coarse levels of splat trees.

    These levels are drawn with at least `along` squared samples. Each sample of the plan is
    repeated as often as needed, so that everything else is drawn as without them. The repetitions
    of one sample form one item of the result, in the order of their fades: neighbours often draw
    the same nodes.
    """
    times = -(-(along * along) // len(plan))
    n = times * len(plan)
    fades = _strata(n, FADE_STEP)
    if n == 1:
        return ((replace(plan[0], fade=(0.0, 1.0)),),)
    if len(plan) == 1:
        across = (np.arange(along) + 0.5) / along - 0.5
        points = [(x, y) for y in across.tolist() for x in across.tolist()]
        area = 1 / n
    else:
        spread = _filter(settings.pixel_filter, settings.filter_width)
        columns, rows = (np.interp(_strata(n, step), *spread) for step in STEPS[:2])
        points = list(zip(columns.tolist(), rows.tolist(), strict=True))
        if times == 1:
            points = [each.offset for each in plan]
        area = min(1.0, float(np.ptp(spread[1])) ** 2 / n)
    found = tuple(
        replace(
            plan[i // times],
            inner_offset=points[i],
            inner_low_pass=INNER_LOW_PASS * area,
            fade=(fade - 0.5 / n, fade + 0.5 / n),
        )
        for i, fade in enumerate(fades.tolist())
    )
    items = (found[i : i + times] for i in range(0, n, times))
    return tuple(tuple(sorted(item, key=lambda each: each.fade)) for item in items)


def reach(settings: RenderSettings) -> float:
    """Return the largest offset along an axis that a sample of `subdivided` may have [pixel]."""
    if settings.samples == 1:
        return 0.5
    _, offsets = _filter(settings.pixel_filter, settings.filter_width)
    return float(offsets[-1])


def center(settings: RenderSettings, camera: CameraSpec) -> Sample:
    """Return the sample for AOVs that must not be averaged: in the middle of shutter and lens."""
    if settings.samples == 1 or not settings.motion_blur:
        return Sample()
    return Sample(time=0.5 * (camera.shutter[0] + camera.shutter[1]))


def has_lens(camera: CameraSpec) -> bool:
    """Return whether a camera has depth of field."""
    return not camera.orthographic and camera.lens_radius > 0 and camera.focus_distance > 0


def _strata(n: int, step: float) -> F64:
    """Return the centres of n equal parts of [0, 1] in the order in which a recurrence visits
    them."""
    visited = np.argsort(np.arange(n) * step % 1.0, kind="stable")
    middles = np.empty(n)
    middles[visited] = (np.arange(n) + 0.5) / n
    return middles


def _filter(name: str, width: float) -> tuple[F64, F64]:
    """Return the cumulative distribution of a filter's weight, and the offsets [pixel] of its
    points."""
    half = 0.5 * (width or WIDTHS[name])
    at: F64 = np.linspace(-1.0, 1.0, TABLE)
    if name == "box":
        weight = np.ones(TABLE)
    elif name == "triangle":
        weight = 1.0 - np.abs(at)
    elif name == "gaussian":
        weight = np.exp(-0.5 * (GAUSSIAN_CUT * at) ** 2)
    else:
        angles = np.pi * (at + 1.0)[:, None] * np.arange(4)
        weight = np.cos(angles) @ (np.array(BLACKMAN_HARRIS) * (1, -1, 1, -1))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))])
    return total / total[-1], half * at
