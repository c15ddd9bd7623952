"""What a prim's grade says, in numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from usdsplat.core.errors import UsageError, UsdSplatError

NEUTRAL_TEMPERATURE = 6504.0
"""[K] of D65, the white of nearly every capture's space."""
UNIT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""The 3x3 that changes nothing, row-major."""

RANGES = {
    "exposure": (-64.0, 64.0),
    "temperature": (1000.0, 25000.0),
    "tint": (-0.05, 0.05),
    "saturation": (0.0, 1000.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Grade:
    """Changes of linear colour, in the primaries of the space of the splats.

    They are made in this order: matrix, white balance (temperature and tint), gain and exposure,
    saturation.
    """

    exposure: float = 0.0
    """[stop]."""
    temperature: float = NEUTRAL_TEMPERATURE
    """[K] of the light that is to look white; lower makes the picture bluer."""
    tint: float = 0.0
    """How far that light is from the locus of white lights, Duv; greenish ones are positive, and
    make the picture more magenta."""
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    """Red, green and blue."""
    saturation: float = 1.0
    """1 keeps it, 0 leaves the luminance."""
    matrix: tuple[float, ...] = UNIT
    """3x3, row-major, for column vectors: the first row makes red."""

    def check(self, where: str, *, error: type[UsdSplatError] = UsageError) -> None:
        """Refuse what is out of range or not finite.

        Args:
            where: What the message has before the name of the value.
            error: Class of the error.

        Raises:
            UsdSplatError: About the first value that is wrong.
        """
        for item in fields(self):
            value = getattr(self, item.name)
            values = value if isinstance(value, tuple) else (value,)
            low, high = RANGES.get(item.name, (-math.inf, math.inf))
            for number in values:
                if not (low <= number <= high and math.isfinite(number)):
                    expected = f"{low:g} to {high:g}" if item.name in RANGES else "a finite number"
                    raise error(f"{where}{item.name}", f"{number:g}", expected)
