"""Format numbers in sentences."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """Return the number and its noun, such as "1 field" or "0 fields"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
