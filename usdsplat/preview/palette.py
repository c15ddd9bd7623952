"""Colours for numbers: steady ones for names and ids, and ramps for depths."""

from __future__ import annotations

import colorsys

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.images.cryptomatte import hash_bits

U32 = npt.NDArray[np.uint32]
Bytes = npt.NDArray[np.uint8]

BITS = 12
GOLDEN = 0.6180339887498949
"""Steps of hue by this part of a turn never come close to each other soon."""
TURBO = (
    (48, 18, 59), (70, 98, 216), (53, 171, 248), (27, 229, 181), (116, 254, 93), (201, 239, 52),
    (251, 185, 56), (245, 105, 24), (201, 41, 3), (122, 4, 3),
)  # fmt: skip
"""Ten even steps of a rainbow whose lightness rises and falls without bands, after Mikhailov 2019,
"Turbo, an improved rainbow colormap"; what lies between is interpolated."""


def _colors() -> Bytes:
    """As many clear colours as `BITS` can count."""
    rows = []
    for i in range(1 << BITS):
        hue, saturation = i * GOLDEN % 1.0, 0.45 + 0.4 * ((i * 7) % 16) / 15
        value = 0.7 + 0.3 * ((i * 5) % 8) / 7
        rows.append(colorsys.hsv_to_rgb(hue, saturation, value))
    return np.rint(255 * np.array(rows)).astype(np.uint8)


COLORS = _colors()


def of_ids(ids: npt.NDArray[np.integer]) -> Bytes:
    """Return the colours of whole numbers, shape (..., 3): like ones for like, for ever."""
    return np.take(COLORS, _mixed(ids.astype(np.uint32)) >> np.uint32(32 - BITS), axis=0)


def of_names(names: tuple[str, ...]) -> Bytes:
    """Return the colours of names, shape (n, 3): those that Cryptomatte's hashes have."""
    return of_ids(np.array([hash_bits(name) for name in names], np.uint32))


def ramp(name: str, parts: F32) -> Bytes:
    """Return the colours of numbers in 0..1 of a ramp, "grey" or "turbo", shape (..., 3)."""
    levels = np.rint(255 * np.clip(parts, 0, 1)).astype(np.uint8)
    return np.take(RAMPS[name], levels, axis=0)


def of_directions(x: F32, y: F32, lengths: F32) -> Bytes:
    """Return the colours of directions, shape (..., 3): hue by angle, red to the right, green-
    yellow up; value by length in 0..1."""
    turn = np.arctan2(y, x) * np.float32(0.5 / np.pi) % np.float32(1)
    hues = np.take(HUES, np.minimum((1024 * turn).astype(np.int32), 1023), axis=0)
    value = np.clip(lengths, 0, 1)[..., None]
    return (hues * value + np.float32(0.5)).astype(np.uint8)


def _mixed(bits: U32) -> U32:
    """A hash of 32 bits whose high bits are even for neighbours."""
    bits = (bits ^ bits >> np.uint32(16)) * np.uint32(0x7FEB352D)
    bits = (bits ^ bits >> np.uint32(15)) * np.uint32(0x846CA68B)
    return bits ^ bits >> np.uint32(16)


def _ramp(stops: tuple[tuple[int, int, int], ...]) -> Bytes:
    at, where = np.linspace(0, len(stops) - 1, 256), np.arange(len(stops))
    channels = [np.interp(at, where, channel) for channel in zip(*stops, strict=True)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


RAMPS = {"grey": _ramp(((0, 0, 0), (255, 255, 255))), "turbo": _ramp(TURBO)}
HUES = np.array([colorsys.hsv_to_rgb(i / 1024, 1.0, 255.0) for i in range(1024)], np.float32)
