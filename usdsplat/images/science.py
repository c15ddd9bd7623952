"""Colour differences and colour charts by colour-science."""

from __future__ import annotations

import sys
import warnings
from typing import Any
from unittest.mock import Mock

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.core.errors import UsageError
from usdsplat.images.color import D65, REC709, adaptation, to_xyz

CHARTS = {
    "classic24": "ColorChecker24 - After November 2014",
    "classic24-2005": "ColorChecker24 - Before November 2014",
    "sg140": "ColorCheckerSG - After November 2014",
}
"""Short names -> names of colour-science, which are accepted too."""


def delta_e(first: npt.ArrayLike, second: npt.ArrayLike) -> F64:
    """Return the CIE 2000 difference of colours.

    Args:
        first, second: Linear Rec.709, shape (..., 3); 1 is white.

    Returns:
        Differences, shape (...,).
    """
    colour = colour_science()
    matrix = to_xyz(REC709)
    labs = [
        colour.XYZ_to_Lab(np.asarray(rgb, np.float64) @ matrix.T, np.array(D65))
        for rgb in (first, second)
    ]
    difference: F64 = np.asarray(colour.difference.delta_E_CIE2000(*labs), np.float64)
    return difference


def chart(name: str) -> dict[str, F64]:
    """Return the colours of a chart under D65 by patch, in the chart's order, linear Rec.709.

    Args:
        name: One of `CHARTS`, or a name of colour-science's CCS_COLOURCHECKERS.

    Raises:
        UsageError: If the chart is unknown; the message lists the known ones.
    """
    colour = colour_science()
    known = colour.CCS_COLOURCHECKERS
    found = CHARTS.get(name, name)
    if found not in known:
        raise UsageError("--chart", repr(name), f"one of {', '.join((*CHARTS, *known))}")
    data = known[found]
    white, d65 = (colour.xy_to_XYZ(xy) for xy in (data.illuminant, np.array(D65)))
    to_rgb = np.linalg.inv(to_xyz(REC709)) @ adaptation(white, d65)
    return {patch: to_rgb @ colour.xyY_to_XYZ(xyy) for patch, xyy in data.data.items()}


def colour_science() -> Any:
    """Import the module `colour`, which takes half a second, without output on stderr.

    It warns of missing optional packages. If SciPy or Matplotlib is missing, it leaves a mock in
    sys.modules, which other packages take for the real one: importing Numba then fails. The mocks
    are removed.
    """
    before = set(sys.modules)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    for name in set(sys.modules) - before:
        if isinstance(sys.modules[name], Mock):
            del sys.modules[name]
    return colour
