"""Format numbers in sentences."""

from __future__ import annotations

UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
"""Suffix of a size -> number of bytes."""


def counted(number: int, noun: str) -> str:
    """Return the number and its noun, such as "1 field" or "0 fields"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def said_bytes(size: float) -> str:
    """Return a size with a unit, such as "1.50 GiB" or "300 MiB"."""
    if size >= UNITS["G"]:
        return f"{size / UNITS['G']:.2f} GiB"
    return f"{size / UNITS['M']:.{1 if size < 10 * UNITS['M'] else 0}f} MiB"
