"""Divide work into parts that commands do side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from usdsplat.core.errors import UsageError
from usdsplat.core.pairs import whole_pair


@dataclass(frozen=True, slots=True)
class Part:
    """A share of some work, which is divided into `count` parts."""

    number: int
    """1 to `count`."""
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the value of `--part`, K/N.

        Raises:
            UsageError: If it is anything else.
        """
        found = whole_pair(text, "/")
        if found is None or found[0] > found[1]:
            raise UsageError("--part", repr(text), "K/N with K from 1 to N, such as 1/8")
        return cls(*found)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, total: int) -> range:
        """Return the numbers, from 0, of consecutive things that belong to this part.

        All parts together have each number below `total` once, and differ by one thing at most.
        """
        return range(total * (self.number - 1) // self.count, total * self.number // self.count)
