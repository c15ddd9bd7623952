"""How slow this machine is now, for bounds that are stated for a usual one."""

from __future__ import annotations

import time

STEPS = 1_000_000
USUAL = 0.04
"""Time of the loop on a usual machine [s]."""


def slowness() -> float:
    """Return the factor by which plain Python is slower than usual, at least 1: the machines of
    tests are shared, and their processor seconds differ by twice and more."""
    start = time.process_time()
    total = 0
    for number in range(STEPS):
        total += number & 3
    return max(1.0, (time.process_time() - start) / USUAL)
