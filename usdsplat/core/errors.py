"""Every error usdsplat raises on purpose: one root, one class per cure.

All carry one sentence of one shape, *where: found X, expected Y*. Each class also derives from the
built-in that a Python programmer would have caught anyway. The command line turns the root into one
line on stderr and exit status 2; anything else that escapes is a bug and keeps its traceback.
"""

from __future__ import annotations


class UsdSplatError(Exception):
    """Root of the family."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(f"{where}: found {found}, expected {expected}")
        self.where = where
        self.found = found
        self.expected = expected

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.where, self.found, self.expected)


class FormatError(UsdSplatError, ValueError):
    """A file is not what its suffix claims. Cure: fix or replace the file."""


class UnknownFormatError(UsdSplatError, LookupError):
    """No reader or writer has this suffix. Cure: choose one that is listed."""


class StageError(UsdSplatError, ValueError):
    """A stage, layer or prim cannot be used as asked. Cure: mend the stage or name another prim."""


class SchemaUnavailableError(UsdSplatError, RuntimeError):
    """USD built its schema registry before it knew ours. Cure: the line the message gives."""


class BackendError(UsdSplatError, RuntimeError):
    """The asked-for device is not usable here. Cure: pick one that is listed."""


class UsageError(UsdSplatError, ValueError):
    """An option has a value it cannot have. Cure: change the option."""


class OutputError(UsdSplatError, OSError):
    """A result cannot be written where it was asked for. Cure: another place or name."""
