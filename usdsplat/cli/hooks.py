"""Report what is not foreseen in other threads, and where Python can raise nothing."""

from __future__ import annotations

import sys
import threading

from usdsplat.cli import failures
from usdsplat.core import interrupt

_has_failed = False


def install() -> None:
    """Replace Python's hooks, which print tracebacks."""
    threading.excepthook = _in_thread
    sys.unraisablehook = _unraisable


def status(status: int) -> int:
    """Return the exit status of a command: a thread that failed makes a success a failure."""
    return failures.UNFORESEEN if status == 0 and _has_failed else status


def _in_thread(args: threading.ExceptHookArgs) -> None:
    """Report the exception that ended a thread, unless it is an interruption."""
    global _has_failed
    if args.exc_value is None or not _is_news(args.exc_value):
        return
    _has_failed = True
    _report(args.exc_value, f"in thread {args.thread.name if args.thread else 'unknown'}")


def _unraisable(args: sys.UnraisableHookArgs) -> None:
    """Report an exception that nothing can catch, such as in `__del__`."""
    if args.exc_value is not None and _is_news(args.exc_value):
        _report(args.exc_value, f"{args.err_msg or 'ignored in'} {args.object!r}")


def _is_news(error: BaseException) -> bool:
    """Return whether an exception is neither an interruption nor its consequence."""
    return not (interrupt.received() or isinstance(error, KeyboardInterrupt | SystemExit))


def _report(error: BaseException, place: str) -> None:
    import traceback

    text = "".join(traceback.format_exception(error))
    found = f"an error that is not foreseen ({type(error).__name__})"
    failures.unforeseen(sys.argv[1:], found, f"{place}\n{text}")
