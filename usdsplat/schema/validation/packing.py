"""Check that a packed field can be decoded."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from usdsplat.core.findings import Finding
from usdsplat.core.sh import MAX_DEGREE
from usdsplat.core.wording import counted
from usdsplat.schema import packing, tokens
from usdsplat.schema.validation.finding import Sample

_CURE = "author the prim with usdsplat.schema.author, which writes all packed arrays together"


def layout(sample: Sample) -> Iterator[Finding]:
    """Check that the token names a layout that this version reads."""
    if not sample.is_packed:
        return
    token = sample.prim.GetAttribute(tokens.PACKING).Get()
    if token != packing.TOKEN:
        yield sample.finding(
            "error",
            tokens.PACKING,
            "unknown-packing",
            repr(token),
            repr(packing.TOKEN),
            "read the prim with the version of usdsplat that wrote it, or a newer one",
        )


def arrays(sample: Sample) -> Iterator[Finding]:
    """Check that the packed arrays match the number of centres and the degree."""
    n, degree = sample.count, sample.degree
    if not sample.is_packed or not n or not 0 <= degree <= MAX_DEGREE:
        return
    counts = {
        tokens.PACKED: n,
        tokens.COLOR_RANGE: 2,
        tokens.PACKED_HARMONICS: n * packing.harmonics_width(degree),
        tokens.HARMONICS_RANGE: degree,
    }
    for name, expected in counts.items():
        values = sample.array(name)
        found = 0 if values is None else len(values)
        if found != expected:
            yield sample.finding(
                "error" if found < expected else "warning",
                name,
                "packed-count",
                counted(found, "value"),
                f"{expected} ({counted(n, 'splat')} of degree {degree})",
                _CURE,
            )


def ranges(sample: Sample) -> Iterator[Finding]:
    """Check that the value ranges are finite and in order."""
    if not sample.is_packed:
        return
    colors, harmonics = sample.numbers(tokens.COLOR_RANGE), sample.numbers(tokens.HARMONICS_RANGE)
    upside_down = len(colors) == 2 and bool((colors[0] > colors[1]).any())
    if upside_down or not np.isfinite(colors).all():
        expected = "finite ends, the lower one first"
        found = str(colors.tolist())
        yield sample.finding("error", tokens.COLOR_RANGE, "range", found, expected, _CURE)
    if not np.isfinite(harmonics).all() or (harmonics < 0).any():
        found = str(harmonics.tolist())
        expected = "finite magnitudes"
        yield sample.finding("error", tokens.HARMONICS_RANGE, "range", found, expected, _CURE)
