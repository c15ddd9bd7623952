"""Arguments of a command, from the dataclass that describes them, by tyro."""

from __future__ import annotations

import contextlib
import io
import re
import sys
from dataclasses import fields, make_dataclass
from typing import Annotated, Any, Literal, TypeVar

import tyro
from tyro.conf import arg

from usdsplat.core.knobs import Knob, knobs

T = TypeVar("T")

_FRAME = re.compile(r"^[│╭╰]─*\s?|─*\s*[│╮╯]$")


def parse(options: type[T], command: str, text: str, arguments: list[str]) -> T | int:
    """Read `arguments` as `options`.

    Args:
        options: A dataclass; each field is an argument with the string below it for help.
        command: Name of the command.
        text: What it does, with examples; shown before the arguments.
        arguments: What the user typed after the command's name.

    Returns:
        An instance, or the exit status when there is nothing to run: 0 after help, 2 after a
        mistake, which was explained on stderr in a few plain lines.
    """
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                options,
                prog=f"usdsplat {command}",
                description=text.strip(),
                args=arguments,
                config=(
                    tyro.conf.FlagCreatePairsOff,
                    tyro.conf.OmitArgPrefixes,
                    tyro.conf.DisallowNone,
                ),
            )
    except SystemExit as end:
        if not end.code:
            return 0
        print(_plain(complaint.getvalue(), command), file=sys.stderr)
        return 2


def flags_of(cls: type) -> type:
    """Make a dataclass with one optional flag for each knob of `cls`; None is "not given"."""
    return make_dataclass(
        f"{cls.__name__}Flags",
        [(knob.name, _flag(knob), None) for knob in knobs(cls)],
        frozen=True,
        kw_only=True,
    )


def given(flags: Any) -> dict[str, Any]:
    """The values that were given, of an instance of what `flags_of` made."""
    values = {item.name: getattr(flags, item.name) for item in fields(flags)}
    return {name: value for name, value in values.items() if value is not None}


def _flag(knob: Knob) -> Any:
    """The annotation of a flag: the knob's choices or type, and its help with unit and range."""
    kind = Literal[knob.choices] if knob.choices else knob.type
    limits = f" [{knob.expected}]" if knob.range else ""
    return Annotated[kind | None, arg(help=f"{knob.text}{limits}; default: what the stage says")]


def _plain(complaint: str, command: str) -> str:
    """tyro's complaint without its box, rules and advice, which are not for logs."""
    lines = [_FRAME.sub("", line).rstrip() for line in complaint.splitlines()]
    wanted = []
    for line in lines:
        if line.lstrip().startswith("For full helptext"):
            break
        if line.strip("─ "):
            wanted.append(line)
    first, *rest = wanted
    title = first.strip("─ ").lower()
    return "\n".join(
        [f"usdsplat {command}: {title}", *rest, f"usdsplat {command} --help tells more"]
    )
