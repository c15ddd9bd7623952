"""Parse values of options that are more than one word or number."""

from __future__ import annotations

import math
import re

from usdsplat.core.errors import UsageError
from usdsplat.core.pairs import whole_pair
from usdsplat.core.wording import UNITS
from usdsplat.images.aovs import AOVS
from usdsplat.products.request import MOST_PIXELS, Window


def time_code(value: float | None) -> float | None:
    """Return the value of `--frame`.

    Raises:
        UsageError: If it is not finite. NaN is USD's default time.
    """
    if value is not None and not math.isfinite(value):
        raise UsageError("--frame", f"{value:g}", "the number of a frame")
    return value


def resolution_of(text: str | None) -> tuple[int, int] | None:
    """Return the value of `--resolution`, WIDTHxHEIGHT, as two numbers.

    Raises:
        UsageError: If it is anything else.
    """
    if text is None:
        return None
    found = whole_pair(text, "x")
    if found is None:
        raise UsageError("--resolution", repr(text), "two numbers of pixels, such as 1920x1080")
    return found


def names_of(text: str | None) -> tuple[str, ...] | None:
    """Return the items of a list that is separated by commas."""
    return None if text is None else tuple(name.strip() for name in text.split(","))


def aovs_of(text: str | None) -> tuple[str, ...] | None:
    """Return the value of `--aovs`: a list separated by commas, or "all": all but those of light
    groups, which change how colours are blended."""
    return tuple(AOVS) if text == "all" else names_of(text)


def crop_of(text: str | None) -> Window | None:
    """Return the value of `--crop`, x0,y0,x1,y1 in pixels, ends exclusive.

    Raises:
        UsageError: If it is anything else, or has no area.
    """
    if text is None:
        return None
    numbers = _whole(text)
    if len(numbers) != 4 or not (numbers[0] < numbers[2] and numbers[1] < numbers[3]):
        expected = "four whole numbers x0,y0,x1,y1 with x0 < x1 and y0 < y1"
        raise UsageError("--crop", repr(text), expected)
    return numbers[0], numbers[1], numbers[2], numbers[3]


def overscan_of(text: str | None) -> Window | None:
    """Return the value of `--overscan` as left, top, right and bottom [pixel].

    One number is for all sides, two are for left and right and for top and bottom.

    Raises:
        UsageError: If it is anything else.
    """
    if text is None:
        return None
    numbers = _whole(text)
    if len(numbers) not in (1, 2, 4) or min(numbers) < 0 or max(numbers) > MOST_PIXELS:
        expected = f"1, 2 or 4 whole numbers of pixels, 0 to {MOST_PIXELS}"
        raise UsageError("--overscan", repr(text), expected)
    left, top, right, bottom = numbers * (4 // len(numbers))
    return left, top, right, bottom


def bytes_of(text: str | None) -> int | None:
    """Return the value of `--memory-limit` in bytes; suffixes K, M, G and T are powers of 1024.

    Raises:
        UsageError: If it is anything else.
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d+(?:\.\d+)?) ?([KMGT]?)(?:iB|B)?", text.strip(), re.IGNORECASE)
    size = int(float(match[1]) * UNITS[match[2].upper()]) if match else 0
    if size <= 0:
        raise UsageError("--memory-limit", repr(text), "bytes such as 800M or 6G")
    return size


def _whole(text: str) -> tuple[int, ...]:
    """Return integers that are separated by commas; empty if one of them is not an integer."""
    parts = [part.strip() for part in text.split(",")]
    return tuple(map(int, parts)) if all(re.fullmatch(r"[-+]?\d{1,6}", p) for p in parts) else ()
