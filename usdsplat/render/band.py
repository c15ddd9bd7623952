"""Finished rows of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

BAND_PIXELS = 1 << 21
"""Pixels of a band: a 1920x1080 picture is one band, a 3840x2160 picture four."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Rows y0 to y1 - 1 of a picture, over the full width of the data window.

    y is counted in the display window. The arrays belong to the renderer and are valid only until
    the next band is requested, but those of `lasting`.
    """

    y0: int
    y1: int
    arrays: dict[str, npt.NDArray[Any]]
    """AOV -> pixels, shape (y1 - y0, width) or, of color, (y1 - y0, width, 4)."""
    lasting: frozenset[str] = frozenset()
    """AOVs whose arrays stay unchanged after the next band is requested: copies from a GPU."""
