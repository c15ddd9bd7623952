"""Rows of a picture, as the renderer finishes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Rows y0 to y1 - 1 of a picture, the whole data window wide; y counts in the display window.

    The arrays are the renderer's own, and valid only until the next band is asked for.
    """

    y0: int
    y1: int
    arrays: dict[str, npt.NDArray[Any]]
    """AOV -> pixels, shape (y1 - y0, width) or, of color, (y1 - y0, width, 4)."""
