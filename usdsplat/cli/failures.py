"""Explain in one sentence how a command ended, and write a report of what is not foreseen."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence

from usdsplat.cli import console
from usdsplat.core import interrupt
from usdsplat.core.text import shown

FOUND, UNFORESEEN, CLOSED = 2, 3, 141
"""Exit statuses: an explained error, an unforeseen one, and a stdout that its reader has closed."""
MEMORY = "found too little memory, expected more, or a smaller task"
_SAMPLE = 80
"""Length of text in a message [character]."""
_SIGNS = (
    "bad_alloc",
    "cannot allocate memory",
    "failed to map segment",  # the dynamic linker
    "can't start new thread",
    "unable to allocate memory",  # LLVM
    "error return without exception set",  # Python, where it could not make a MemoryError
)
"""Parts of messages of libraries that lack memory."""


def interrupted(error: KeyboardInterrupt) -> int:
    """Say that a signal ended the command, and how to go on; return the exit status."""
    status = interrupt.status(error)
    number = status - 128
    rest = f"; {interrupt.advice()}" if interrupt.advice() else ""
    console.complain(f"interrupted{interrupt.sender(number)}{rest}")
    return status


def explain(error: Exception, arguments: Sequence[str]) -> int:
    """Explain an exception that is none of ours; return the exit status.

    Args:
        error: The exception. Its traceback is written to a file if it is unforeseen.
        arguments: The command line after the program's name.
    """
    if interrupt.received():  # the interruption was lost, and this is what came of it
        return interrupted(interrupt.Interrupted(interrupt.received()))
    if isinstance(error, console.ResultsLost):
        if isinstance(error.error, BrokenPipeError):
            return CLOSED
        found = (error.error.strerror or str(error.error)).lower()
        console.complain(f"standard output: found {found}, expected a place to read or write")
        return FOUND
    if lacks_memory(error):
        console.complain(f"{command(arguments)}: {MEMORY}")
        return FOUND
    if isinstance(error, UnicodeError):
        sample = error.object if isinstance(error, UnicodeEncodeError | UnicodeDecodeError) else ""
        found = (
            f"text that is not UTF-8: {sample[:_SAMPLE]!r}" if sample else "text that is not UTF-8"
        )
        console.complain(f"{command(arguments)}: found {found}, expected UTF-8")
        return FOUND
    if isinstance(error, OSError):
        found = (error.strerror or str(error)).lower()
        place = os.fsdecode(error.filename) if _is_name(error.filename) else command(arguments)
        console.complain(f"{place}: found {found}, expected a place to read or write")
        return FOUND
    try:
        import traceback

        text = "".join(traceback.format_exception(error))
        found = f"an error that is not foreseen ({type(error).__name__})"
        return unforeseen(arguments, found, text)
    except Exception as second:
        if not lacks_memory(second):
            raise
        console.complain(f"{command(arguments)}: {MEMORY}")
        return FOUND


def unforeseen(arguments: Sequence[str], found: str, text: str) -> int:
    """Write a report, and say where it lies; return the exit status."""
    path = report(arguments, text)
    place = f"the report is in {path}" if path else "no report could be written"
    console.complain(f"{command(arguments)}: found {found}, expected none; {place}")
    return UNFORESEEN


def lacks_memory(error: BaseException) -> bool:
    """Return whether an exception, or one that caused it, is for lack of memory."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, MemoryError) or getattr(seen, "errno", None) == errno.ENOMEM:
            return True
        if any(sign in str(seen).lower() for sign in _SIGNS):
            return True
        seen = seen.__cause__ or (None if seen.__suppress_context__ else seen.__context__)
    return False


def text_lacks_memory(text: str) -> bool:
    """Return whether messages of libraries tell of a lack of memory."""
    return any(sign in text.lower() for sign in _SIGNS)


def command(arguments: Sequence[str]) -> str:
    """Return the name of the command for messages."""
    return shown(arguments[0]) if arguments else "usdsplat"


def report(arguments: Sequence[str], text: str) -> str:
    """Write a report that only the user can read, and return its path; "" if it cannot be written.

    Args:
        arguments: The command line after the program's name.
        text: Traceback, or messages of libraries.
    """
    import platform
    import secrets
    import tempfile
    from importlib import metadata

    lines = ["usdsplat " + " ".join(map(repr, arguments)), ""]
    for name in ("usdsplat", "numpy", "numba", "usd-core", "OpenImageIO", "PySide6-Essentials"):
        try:
            lines.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            lines.append(f"{name} is not installed")
    lines += [f"Python {sys.version}", platform.platform(), "", text]
    content = "\n".join(lines).encode("utf-8", "backslashreplace")
    try:
        name = f"usdsplat-report-{os.getpid()}-{secrets.token_hex(4)}.txt"
        path = os.path.join(tempfile.gettempdir(), name)
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
    except OSError:
        return ""
    return path


def _is_name(value: object) -> bool:
    return isinstance(value, str | bytes | os.PathLike)
