"""Tell what grows in a process that is used for long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WARM = 3
"""Minutes that are not compared."""
MEMORY, THREADS, FILES = 0.05, 2, 4
"""Growth that is allowed: part of the memory, threads, and open files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Minute:
    """State of the process after a minute."""

    megabytes: float
    threads: int
    files: int
    opened: int
    """Documents that were opened so far."""
    pictures: int
    """Pictures that were painted in the minute."""


def growth(minutes: list[Minute]) -> list[str]:
    """Return what has grown since the first minutes, as sentences."""
    rest = minutes[WARM:]
    if len(rest) < 2:
        return [f"found {len(minutes)} minutes, expected at least {WARM + 2}"]
    half = len(rest) // 2
    early, late = rest[:half], rest[half:]
    grown = []
    for name, most in (
        ("megabytes", MEMORY * early[0].megabytes),
        ("threads", THREADS),
        ("files", FILES),
    ):
        before = float(np.median([getattr(each, name) for each in early]))
        after = float(np.median([getattr(each, name) for each in late]))
        if after - before > most:
            grown.append(f"{name}: found {after:.0f} after {before:.0f}, expected no growth")
    return grown
