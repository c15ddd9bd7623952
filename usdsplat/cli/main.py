"""Pick the command, read its options, run it, and turn errors into one line and a status.

A command is a module of this package, with _ for -, that has a dataclass `Options`, whose fields
are its arguments, and `run(options)`, which returns the exit status. Its docstring is its help. It
may have `arranged(words)`, which puts what the user typed as its options can be read.
Only the module that is named gets loaded, and USD and Numba only once it runs, so help is there at
once.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
from collections.abc import Sequence
from typing import Any, Protocol

from usdsplat import __version__
from usdsplat.cli.flag_names import as_typed
from usdsplat.core.errors import BackendError, UsageError, UsdSplatError

COMMANDS = {
    "convert": "turn a capture into a stage, a stage into a capture, or one capture into another",
    "info": "say what is in a capture or a stage",
    "validate": "check the splats of a stage, each finding with its cure",
    "view": "look at a stage, or a capture, in a window or a browser",
    "render": "draw a stage, or a capture, to EXR or PNG",
    "simulate": "grow, push, conform or dissolve the splats of a stage; bake a layer",
    "match": "grade splats until they look like a plate, or like a colour chart",
    "demo": "make a capture, a stage, pictures and a sequence, to see it all work",
    "compile": "compile all kernels ahead, so that no later command waits for it",
    "plugin-path": "print what usdview needs to find our schemas and our viewport",
}

OVERVIEW = f"""usage: usdsplat COMMAND ...

Gaussian splats as ordinary citizens of a USD pipeline.

commands:
{chr(10).join(f"  {name:11} {text}" for name, text in COMMANDS.items())}

examples:
  usdsplat convert scan.ply scan.usdc
  usdsplat view scan.usdc
  usdsplat render scan.usdc -o scan.png
  usdsplat render shot.usd -o shot.####.exr --frames 1-24

usdsplat COMMAND --help tells more; usdsplat --version tells the version."""


class Command(Protocol):
    """What a command's module holds."""

    Options: type

    def run(self, options: Any) -> int:
        """Do it; return the exit status."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that `argv` names, without the program's own name; None takes the process's.

    Returns:
        0 when all is well, 1 when `validate` found errors, 2 for a mistake that one sentence on
        stderr explains, 130 after Ctrl-C. Anything else that escapes is a bug and keeps its
        traceback.
    """
    log = logging.getLogger("usdsplat")  # for programs; a command says itself what it leaves out
    log.addHandler(logging.NullHandler())
    log.propagate = False
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        status = _run(arguments)
        _say_what_is_not_kept()
        sys.stdout.flush()  # here, where a closed pipe is still ours to handle
        return status
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # Whoever read our output has seen enough; what is still buffered has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except UsdSplatError as error:
        is_ours = isinstance(error, (UsageError, BackendError)) or error.where.startswith("render ")
        where = as_typed(error.where, _flags_of(arguments)) if is_ours else error.where
        return _complain(f"{where}: found {error.found}, expected {error.expected}", 2)
    except OSError as error:
        if error.filename is None:  # nothing else is written to without a name
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        found = (error.strerror or str(error)).lower()
        place = error.filename or "standard output"
        return _complain(f"{place}: found {found}, expected a place to read or write", 2)


def _run(arguments: list[str]) -> int:
    """`main` without the handling of errors."""
    if not arguments:
        print(OVERVIEW, file=sys.stderr)
        return 2
    name, *rest = arguments
    if name in ("-h", "--help", "help"):
        print(OVERVIEW)
        return 0
    if name == "--version":
        print(f"usdsplat {__version__}")
        return 0
    if name not in COMMANDS:
        raise UsageError("command", repr(name), f"one of {', '.join(COMMANDS)}")
    command: Command = importlib.import_module(_module(name))
    from usdsplat.cli.parsing import parse
    from usdsplat.cli.renamed_flags import renamed

    arranged = getattr(command, "arranged", list)
    words = arranged(renamed(rest))
    options = parse(command.Options, name, command.__doc__ or "", words)
    if isinstance(options, int):
        return options
    return command.run(options)


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
    """Tell that the next command will compile again what this one has compiled."""
    store = sys.modules.get("usdsplat.kernels.store")
    if store is not None and store.refusal():
        expected = "expected a folder that can be written"
        print(f"usdsplat: compiled kernels: found {store.refusal()}, {expected}", file=sys.stderr)


def _complain(message: str, status: int) -> int:
    print(f"usdsplat: {message}", file=sys.stderr)
    return status
