"""Select a command, parse its options, run it, and turn errors into one line and a status.

A command is a module of this package, with _ for -. It has a dataclass `Options`, whose fields are
its arguments, and `run(options, reporter)`, which returns the exit status. Its docstring is its
help. It may have `arranged(words)`, which reorders the command line before it is parsed, and
FORKS = True if it makes a `JobRunner` before it opens a stage.
Only the module of the command is loaded, and USD and Numba only when it runs. Help is therefore
shown at once.
"""

from __future__ import annotations

import importlib
import logging
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from usdsplat import __version__
from usdsplat.cli import console, failures
from usdsplat.cli.flag_names import as_typed
from usdsplat.core import interrupt
from usdsplat.core.errors import BackendError, EarlierFilesError, UsageError, UsdSplatError

if TYPE_CHECKING:
    from usdsplat.products.keeper import EngineKeeper

COMMANDS = {
    "convert": "convert captures to a stage, a stage to captures, or either to another of its kind",
    "lod": "build a tree with levels of detail of captures and stages of any size",
    "info": "describe a capture or a stage",
    "validate": "check stages for what other commands would stop at, and say how to fix it",
    "view": "show a stage or a capture in a window or a browser",
    "render": "render a stage or a capture to EXR or PNG",
    "simulate": "simulate the splats of a stage, and bake the result into a layer",
    "match": "grade splats to match a plate or a colour chart",
    "relight": "author the colours of splats under the lights of a stage, in a layer of their own",
    "normals": "author normals, confidence and occlusion of splats, in a layer of their own",
    "demo": "make a capture, a stage, pictures and sequences, as a tour of the features",
    "compile": "compile all kernels ahead of time, so that later commands do not wait for it",
    "worker": "carry out commands that another process sends",
    "doctor": "say what is on this machine, what is missing, and how to get it",
    "plugin-path": "print the plug-in folders for usdview and other USD applications",
}

OVERVIEW = f"""usage: usdsplat COMMAND ...

Gaussian splats in USD pipelines.

commands:
{chr(10).join(f"  {name:11} {text}" for name, text in COMMANDS.items())}

examples:
  usdsplat convert scan.ply scan.usdc
  usdsplat view scan.usdc
  usdsplat render scan.usdc -o scan.png
  usdsplat render shot.usd -o shot.####.exr --frames 1-24

usdsplat COMMAND --help describes a command; usdsplat --version prints the version."""


def main(argv: Sequence[str] | None = None, *, keeper: EngineKeeper | None = None) -> int:
    """Run the command in `argv`, which lacks the program's name. None stands for `sys.argv[1:]`.

    Args:
        argv: The command line.
        keeper: Keeps the stage open for the next command; None closes it.

    Returns:
        Exit status: 0 for success, 1 if `validate` found errors or a strict command has findings,
        2 for an error that is explained in one line on stderr, 3 for an unforeseen one, whose
        traceback is in a file that the line names, 130 after Ctrl-C, 141 if the reader of stdout
        has closed it, and 128 + the signal's number after another signal.
    """
    log = logging.getLogger("usdsplat")  # for programs; a command prints its own remarks
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    log.propagate = False
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        status = _run(arguments) if keeper is None else _run(arguments, keeper)
        _say_what_is_not_kept()
        if status != 128 + interrupt.received():
            interrupt.check()  # its exception may have been lost, see `core.interrupt`
        return status
    except KeyboardInterrupt as error:
        return failures.interrupted(error)
    except UsdSplatError as error:
        if interrupt.received():  # the interruption was lost, and this is what came of it
            if isinstance(error, EarlierFilesError):
                console.complain(str(error))  # nothing else says where they are
            return failures.interrupted(interrupt.Interrupted(interrupt.received()))
        is_ours = isinstance(error, (UsageError, BackendError)) or error.where.startswith("render ")
        where = as_typed(error.where, _flags_of(arguments)) if is_ours else error.where
        console.complain(f"{where}: found {error.found}, expected {error.expected}")
        return 2
    except Exception as error:
        return failures.explain(error, arguments)


def _run(arguments: list[str], keeper: EngineKeeper | None = None) -> int:
    """Run the command without handling errors, see `main`."""
    if not arguments:
        console.tell(OVERVIEW)
        return 2
    name, *rest = arguments
    if name in ("-h", "--help", "help"):
        console.say(OVERVIEW)
        return 0
    if name == "--version":
        console.say(f"usdsplat {__version__}")
        return 0
    if name not in COMMANDS:
        raise UsageError("command", repr(name), f"one of {', '.join(COMMANDS)}")
    command: Any = importlib.import_module(_module(name))
    from usdsplat.cli.parsing import parse
    from usdsplat.cli.renamed_flags import renamed
    from usdsplat.cli.reporting import reported

    arranged = getattr(command, "arranged", list)
    words = arranged(renamed(rest))
    options = parse(command.Options, name, command.__doc__ or "", words)
    if isinstance(options, int):
        return options
    with _holding(command, options):
        return reported(command, options, arguments, keeper=keeper)


def _holding(command: Any, options: Any) -> AbstractContextManager[None]:
    """Return a context in which workers of a job can be forked, if the command runs as one."""
    if not (getattr(command, "FORKS", False) and options.job.is_asked):
        return nullcontext()
    from usdsplat.cli.forking import held

    return held()


def _flags_of(arguments: list[str]) -> set[str]:
    """Return the flags of the command that was run, without dashes."""
    command = sys.modules.get(_module(arguments[0])) if arguments else None
    if command is None:
        return set()
    from usdsplat.cli.arguments import flag_names

    return flag_names(command.Options)


def _module(name: str) -> str:
    """Return the module of a command."""
    return f"usdsplat.cli.{name.replace('-', '_')}"


def _say_what_is_not_kept() -> None:
    """Print a remark if compiled kernels could not be stored."""
    store = sys.modules.get("usdsplat.kernels.store")
    if store is not None and store.refusal():
        expected = "expected a folder that can be written"
        console.remark(f"compiled kernels: found {store.refusal()}, {expected}")
