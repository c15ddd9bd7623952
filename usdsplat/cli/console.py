"""Print results to stdout, progress, remarks and errors to stderr. Nothing else prints.

A stderr that cannot be written is ignored: the exit status is that of the work.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TextIO

from usdsplat.core.text import shown


class ResultsLost(Exception):
    """Signal that stdout cannot be written: closed by its reader, or full.

    Args:
        error: The system's error.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        self.error = error


def say(text: str = "", *, end: str = "\n") -> None:
    """Print results to stdout: lines, of which each is escaped as `shown` does.

    Raises:
        ResultsLost: If stdout cannot be written.
    """
    out = sys.stdout
    if out is None:  # closed before Python started
        return
    lines = "\n".join(map(shown, text.split("\n"))) + end
    encoding = getattr(out, "encoding", None) or "utf-8"
    try:
        out.write(lines.encode(encoding, "backslashreplace").decode(encoding))
        out.flush()
    except OSError as error:
        _abandon(out)
        raise ResultsLost(error) from error


def say_path(path: object) -> None:
    """Print the name of a file to stdout, byte for byte, so that a script gets the file's name.

    Raises:
        ResultsLost: If stdout cannot be written.
    """
    buffer = getattr(sys.stdout, "buffer", None)
    if buffer is None:  # a stream of characters only, such as that of a notebook
        say(str(path))
        return
    try:
        sys.stdout.flush()
        buffer.write(os.fsencode(f"{path}\n"))
        buffer.flush()
    except OSError as error:
        _abandon(sys.stdout)
        raise ResultsLost(error) from error


def complain(message: str) -> None:
    """Print the sentence of an error."""
    _write(f"usdsplat: {shown(message)}\n")


def tell(text: str) -> None:
    """Print lines to stderr, such as an overview."""
    _write(f"{text}\n")


def _write(text: str, stream: TextIO | None = None) -> None:
    """Write to a stream, by default stderr, if it can be written."""
    err = sys.stderr if stream is None else stream
    if err is None:
        return
    encoding = getattr(err, "encoding", None) or "utf-8"
    try:
        err.write(text.encode(encoding, "backslashreplace").decode(encoding))
        err.flush()
    except (OSError, ValueError):  # ValueError: closed by Python code
        _abandon(err)


def _abandon(stream: TextIO) -> None:
    """Discard what is left in the buffer of a stream, which Python would write at its exit."""
    with suppress(OSError, ValueError):  # a stream without a file descriptor keeps its buffer
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def remark(text: str) -> None:
    """Print a message to the user that is neither a result nor an error."""
    _write(f"usdsplat: {shown(text)}\n")


PICTURES = "compiling kernels, once for each kind of picture; it takes up to half a minute"


def announce_compilation(text: str = PICTURES) -> Callable[[str], None]:
    """Return a function to call for each compiled kernel; it prints `text` the first time only."""
    spoken = False

    def announce(kernel: str) -> None:
        nonlocal spoken
        if not spoken:
            spoken = True
            remark(text)

    return announce


def print_json(value: Any) -> None:
    """Print a value as JSON to stdout, with null for numbers that are not finite.

    Stages may contain such numbers anywhere, and JSON cannot represent them.
    """
    import json

    say(json.dumps(_with_null(value), indent=2, allow_nan=False))


def _with_null(value: Any) -> Any:
    """Return a value with None for every number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _with_null(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_null(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Terminal:
    """stderr for `rich`, which may be closed while a bar is shown."""

    def __init__(self) -> None:
        self._stream = sys.stderr  # before `rich` replaces it

    def write(self, text: str) -> int:
        _write(text, self._stream)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
