"""Colour grade of a prim."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from usdsplat.core.errors import UsageError, UsdSplatError

NEUTRAL_TEMPERATURE = 6504.0
"""Colour temperature of D65 [K], the white point of nearly every capture's colour space."""
UNIT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""The 3x3 identity matrix, row-major."""

RANGES = {
    "exposure": (-64.0, 64.0),
    "temperature": (1000.0, 25000.0),
    "tint": (-0.05, 0.05),
    "saturation": (0.0, 1000.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Grade:
    """A colour correction of linear colour, in the primaries of the splats' colour space.

    It is applied in this order: matrix, white balance (temperature and tint), gain and exposure,
    saturation.
    """

    exposure: float = 0.0
    """[stop]."""
    temperature: float = NEUTRAL_TEMPERATURE
    """Colour temperature of the light that becomes white [K]; lower makes the picture bluer."""
    tint: float = 0.0
    """Distance of that light from the Planckian locus, Duv; positive values are greenish lights and
    make the picture more magenta."""
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    """Factors of red, green and blue."""
    saturation: float = 1.0
    """Saturation: 1 is unchanged, 0 leaves luminance only."""
    matrix: tuple[float, ...] = UNIT
    """Matrix 3x3, row-major, for column vectors: the first row gives red."""

    def check(self, where: str, *, error: type[UsdSplatError] = UsageError) -> None:
        """Raise an error if a value is out of range or not finite.

        Args:
            where: Prefix of the value's name in the message.
            error: Class of the error.

        Raises:
            UsdSplatError: For the first invalid value.
        """
        for item in fields(self):
            value = getattr(self, item.name)
            values = value if isinstance(value, tuple) else (value,)
            low, high = RANGES.get(item.name, (-math.inf, math.inf))
            for number in values:
                if not (low <= number <= high and math.isfinite(number)):
                    expected = f"{low:g} to {high:g}" if item.name in RANGES else "a finite number"
                    raise error(f"{where}{item.name}", f"{number:g}", expected)
