"""Colours for values: constant ones for names and ids, a wheel for directions, ramps."""

from __future__ import annotations

import colorsys

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.images.cryptomatte import hash_bits
from usdsplat.kernels.false_color import mixed

Bytes = npt.NDArray[np.uint8]

BITS = 12
SHIFT = np.uint32(32 - BITS)
"""Shift of a hash to its colour bits."""
GOLDEN = 0.6180339887498949
"""Hue step: successive hues by the golden ratio stay far apart."""
TURBO = (
    (48, 18, 59), (70, 98, 216), (53, 171, 248), (27, 229, 181), (116, 254, 93), (201, 239, 52),
    (251, 185, 56), (245, 105, 24), (201, 41, 3), (122, 4, 3),
)  # fmt: skip
"""Ten steps of a rainbow whose lightness rises and falls without bands, after Mikhailov 2019,
"Turbo, an improved rainbow colormap"; values between them are interpolated."""


def _colors() -> Bytes:
    """Return 2^BITS distinct colours."""
    rows = []
    for i in range(1 << BITS):
        hue, saturation = i * GOLDEN % 1.0, 0.45 + 0.4 * (i * 7 % 16) / 15
        rows.append(colorsys.hsv_to_rgb(hue, saturation, 0.7 + 0.3 * (i * 5 % 8) / 7))
    return np.rint(255 * np.array(rows)).astype(np.uint8)


def _ramp(*stops: tuple[int, int, int]) -> Bytes:
    at, where = np.linspace(0, len(stops) - 1, 256), np.arange(len(stops))
    channels = [np.interp(at, where, channel) for channel in zip(*stops, strict=True)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


COLORS = _colors()
"""Colours of hashes, by their high bits."""
HUES: F32 = np.array([colorsys.hsv_to_rgb(i / 1024, 1.0, 1.0) for i in range(1024)], np.float32)
"""Colour wheel: red to the right, yellow-green up."""
RAMPS = {"grey": _ramp((0, 0, 0), (255, 255, 255)), "turbo": _ramp(*TURBO)}


def of_names(names: tuple[str, ...]) -> Bytes:
    """Return the colours of names, shape (n, 3), by their Cryptomatte hashes."""
    rows = [COLORS[int(mixed(np.uint32(hash_bits(name)))) >> int(SHIFT)] for name in names]
    return np.array(rows, np.uint8).reshape(-1, 3)
