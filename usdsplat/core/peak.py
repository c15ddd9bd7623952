"""Peak memory of this process."""

from __future__ import annotations

import sys


def peak_memory() -> int:
    """Return the most memory of the process so far [byte]; 0 where the system does not say."""
    try:
        import resource
    except ImportError:  # not on Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
