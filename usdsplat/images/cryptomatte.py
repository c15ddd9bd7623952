"""Cryptomatte: object hashes and header entries of `crypto…` AOVs.

A pixel holds pairs of an id and the fraction of the pixel that it covers. The id is a hash of a
name, such as a prim's path, stored bit for bit in a float32 channel. Its bits must therefore be
those of a normal number: one bit of a hash that would be denormal, infinite or NaN is flipped.

Source: Cryptomatte specification 1.2 (Friedman, Jones; Psyop 2015-2018). MurmurHash3_x86_32 from
Appleby's description of the algorithm (2011).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable

import numpy as np

LAYERS = ("cryptoObject", "cryptoAsset", "cryptoMaterial")
"""Layers of Cryptomatte, which are AOVs."""
RANK = 6
"""Default number of pairs of id and coverage in a pixel."""
HASH = "MurmurHash3_32"
CONVERSION = "uint32_to_float32"

_ALL = 0xFFFFFFFF
_ONE, _TWO = 0xCC9E2D51, 0x1B873593


def rank_pairs(rank: int) -> int:
    """Return the number of RGBA groups of channels for `rank` pairs of id and coverage.

    Each group holds two pairs, so an odd number is rounded up.
    """
    return (rank + 1) // 2


def channels(layer: str, rank: int) -> tuple[str, ...]:
    """Return the channels of a layer: `layer00.R`, id and coverage alternating."""
    return tuple(f"{layer}{pair:02}.{c}" for pair in range(rank_pairs(rank)) for c in "RGBA")


def object_hash(name: str) -> np.float32:
    """Return the id of object `name` in pixels: a finite number that is neither 0 nor denormal."""
    return np.float32(struct.unpack("<f", struct.pack("<I", hash_bits(name)))[0])


def hash_bits(name: str) -> int:
    """Return the 32 bits of `object_hash`."""
    bits = murmur3(name.encode())
    exponent = bits >> 23 & 0xFF
    return bits ^ 1 << 23 if exponent in (0, 0xFF) else bits


def prefix_of(layer: str) -> str:
    """Return the start of a layer's header entries: its key is the first seven digits of its
    hash."""
    return f"cryptomatte/{hash_bits(layer):08x}"[:-1]


def metadata(layer: str, names: Iterable[str]) -> dict[str, str]:
    """Return the entries for `ImageLayout.metadata`.

    Args:
        layer: Name of the AOV, such as "cryptoObject".
        names: Names of all objects that may be in the picture, each once.
    """
    prefix = prefix_of(layer)
    manifest = {name: f"{hash_bits(name):08x}" for name in names}
    return {
        f"{prefix}/name": layer,
        f"{prefix}/hash": HASH,
        f"{prefix}/conversion": CONVERSION,
        f"{prefix}/manifest": json.dumps(manifest, separators=(",", ":"), ensure_ascii=False),
    }


def murmur3(data: bytes) -> int:
    """Return MurmurHash3_x86_32 of `data` with seed 0, in 0..2^32-1."""
    whole = len(data) // 4
    state = 0
    for word in struct.unpack_from(f"<{whole}I", data):
        state = _rotated(state ^ _scrambled(word), 13) * 5 + 0xE6546B64 & _ALL
    state ^= _scrambled(int.from_bytes(data[4 * whole :], "little")) ^ len(data)
    state = (state ^ state >> 16) * 0x85EBCA6B & _ALL
    state = (state ^ state >> 13) * 0xC2B2AE35 & _ALL
    return state ^ state >> 16


def _scrambled(word: int) -> int:
    return _rotated(word * _ONE & _ALL, 15) * _TWO & _ALL


def _rotated(word: int, by: int) -> int:
    return (word << by | word >> 32 - by) & _ALL
