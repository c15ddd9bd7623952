"""Exceptions of usdsplat: one root class, and one class for each way to fix the problem.

Every message is one sentence on one line: *where: found X, expected Y*. Each class also derives
from the built-in exception that a Python programmer would catch. The command line prints the
message on stderr and exits with status 2. Any other exception that escapes is a bug; the command
line writes its traceback to a file, and exits with status 3.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from usdsplat.core.text import shown


class UsdSplatError(Exception):
    """Base class of all usdsplat exceptions."""

    def __init__(self, where: str, found: str, expected: str) -> None:
        super().__init__(shown(f"{where}: found {found}, expected {expected}"))
        self.where = where
        self.found = found
        self.expected = expected

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.where, self.found, self.expected)


class FormatError(UsdSplatError, ValueError):
    """The content of a file is invalid. Fix: repair or replace the file."""


class UnknownFormatError(UsdSplatError, LookupError):
    """No reader or writer supports this suffix. Fix: choose a listed one."""


class StageError(UsdSplatError, ValueError):
    """A stage, layer or prim is unusable for a task. Fix: correct the stage or choose another
    prim."""


class SchemaUnavailableError(UsdSplatError, RuntimeError):
    """USD built its schema registry without our plug-in. Fix: set the variable that the message
    names."""


class BackendError(UsdSplatError, RuntimeError):
    """The requested device is not usable here. Fix: choose a listed one."""


class UsageError(UsdSplatError, ValueError):
    """An option has an invalid value. Fix: change the option."""


class OutputError(UsdSplatError, OSError):
    """A result cannot be written. Fix: choose another target."""


class JobError(UsdSplatError, RuntimeError):
    """Tasks of a job failed. Fix: see their messages, then go on with --resume."""


class EarlierFilesError(OutputError):
    """Results cannot be put in place, nor the earlier ones put back. Fix: move the earlier ones
    back from the folders that the message names.

    Args:
        folders: Private folders that must not be removed, because earlier results are in them.
    """

    def __init__(
        self, where: str, found: str, expected: str, folders: Collection[Path] = ()
    ) -> None:
        super().__init__(where, found, expected)
        self.folders = folders


class StrictError(UsdSplatError, RuntimeError):
    """A strict command has findings. Fix: cure them, or run without --strict."""
