"""Values of options that are more than one word or number, as people type them."""

from __future__ import annotations

import math
import re

from usdsplat.core.errors import UsageError
from usdsplat.core.wording import UNITS
from usdsplat.images.aovs import AOVS
from usdsplat.products.request import MOST_PIXELS, Window


def time_code(value: float | None) -> float | None:
    """The value of `--frame`.

    Raises:
        UsageError: If it is not finite: NaN is how USD writes the default time.
    """
    if value is not None and not math.isfinite(value):
        raise UsageError("--frame", f"{value:g}", "the number of a frame")
    return value


def resolution_of(text: str | None) -> tuple[int, int] | None:
    """The value of `--resolution`, WIDTHxHEIGHT, as two numbers.

    Raises:
        UsageError: If it is anything else.
    """
    if text is None:
        return None
    match = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text)
    if not match:
        raise UsageError("--resolution", repr(text), "two numbers of pixels, such as 1920x1080")
    return int(match[1]), int(match[2])


def names_of(text: str | None) -> tuple[str, ...] | None:
    """A list with commas between."""
    return None if text is None else tuple(name.strip() for name in text.split(","))


def aovs_of(text: str | None) -> tuple[str, ...] | None:
    """The value of `--aovs`: a list with commas between, or all of them."""
    return tuple(AOVS) if text == "all" else names_of(text)


def crop_of(text: str | None) -> Window | None:
    """The value of `--crop`, x0,y0,x1,y1 in pixels, ends exclusive.

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
    """The value of `--overscan`: pixels added on all sides, left and right and top and bottom, or
    left, top, right and bottom.

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
    """The value of `--memory-limit`: bytes, or with K, M, G or T behind it 1024 of each other.

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
    """Whole numbers with commas between; nothing if one of them is something else."""
    parts = [part.strip() for part in text.split(",")]
    return tuple(map(int, parts)) if all(re.fullmatch(r"[-+]?\d{1,6}", p) for p in parts) else ()
