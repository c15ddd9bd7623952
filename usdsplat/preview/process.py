"""What this process holds."""

from __future__ import annotations

import sys
from pathlib import Path

MEGA = 1e6
STATM = Path("/proc/self/statm")


def resident_megabytes() -> float:
    """Memory of this process [MB]; the most so far where only that is known, or else 0."""
    if STATM.exists():
        import resource

        return int(STATM.read_text().split()[1]) * resource.getpagesize() / MEGA
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most * (1 if sys.platform == "darwin" else 1024) / MEGA
