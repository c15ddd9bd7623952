"""The date of files that are the same in each run, from SOURCE_DATE_EPOCH.

Source: "SOURCE_DATE_EPOCH" of reproducible-builds.org.
"""

from __future__ import annotations

import os

VARIABLE = "SOURCE_DATE_EPOCH"
_DIGITS = 11
"""Largest number of digits that is taken for a date; it is after the year 5000."""


def source_date() -> int | None:
    """Return the date of all files, in seconds since 1970; None if SOURCE_DATE_EPOCH has none."""
    text = os.environ.get(VARIABLE, "")
    return int(text) if text.isdecimal() and len(text) <= _DIGITS else None
