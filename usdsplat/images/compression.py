"""Compressions of EXR files, with their levels."""

from __future__ import annotations

import re
from dataclasses import dataclass

from usdsplat.core.errors import UsageError

FLAT_COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "dwaa", "dwab")
DEEP_COMPRESSIONS = ("none", "zips")
LOSSY = ("dwaa", "dwab")
LEVELS = {**dict.fromkeys(("zips", "zip"), (1, 9)), **dict.fromkeys(LOSSY, (1, 100_000))}
"""Compression -> lowest and highest level. Higher levels of zip are slower; of dwa, lossier."""


@dataclass(frozen=True, slots=True)
class Compression:
    """A compression and its level."""

    name: str
    level: int | None = None
    """Level; None for OpenEXR's default, 4 of zip and 45 of dwa."""

    def __str__(self) -> str:
        """Return the text that `parse` reads, which is also OpenImageIO's."""
        return self.name if self.level is None else f"{self.name}:{self.level}"

    @property
    def is_lossy(self) -> bool:
        """Whether channels named R, G and B change."""
        return self.name in LOSSY

    @classmethod
    def parse(cls, text: str, *, where: str, deep: bool = False) -> Compression:
        """Return the compression that a text such as "zip" or "dwaa:45" names.

        Args:
            text: Name, and after a colon a level.
            where: Origin of the text in error messages.
            deep: Whether it is for a deep picture, whose compressions have no level.

        Raises:
            UsageError: If the text names none of them, or a level that it does not have.
        """
        name, colon, level = text.partition(":")
        names = DEEP_COMPRESSIONS if deep else FLAT_COMPRESSIONS
        if name not in names:
            expected = f"one of {', '.join(names)}"
            raise UsageError(where, f"compression {text!r}", expected)
        if not colon:
            return cls(name)
        low, high = (0, -1) if deep else LEVELS.get(name, (0, -1))
        is_number = re.fullmatch(r"\d{1,6}", level) is not None
        if not is_number or not low <= int(level) <= high:
            whole = f"a whole number from {low} to {high} as level of {name}"
            expected = whole if low <= high else f"{name} without a level"
            raise UsageError(where, f"compression {text!r}", expected)
        return cls(name, int(level))
