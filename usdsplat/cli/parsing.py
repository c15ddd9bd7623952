"""Arguments of a command, from the dataclass that describes them, by tyro."""

from __future__ import annotations

import contextlib
import io
import re
import sys
import textwrap
from dataclasses import fields, make_dataclass
from typing import Annotated, Any, TypeVar

import tyro
from tyro.conf import arg

from usdsplat.core.knobs import Knob, knobs

T = TypeVar("T")

_FRAME = re.compile(r"^[│╭╰|+][─-]*\s?|[─-]*\s*[│╮╯|+]$")


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


def option(metavar: str | None = None, *, name: str | None = None, short: str = "") -> Any:
    """How a field is shown: its placeholder, another name, a short form; put it in Annotated.

    The string below a field says what its default means, so tyro's own remark is left out.
    """
    return arg(
        metavar=metavar, name=name, aliases=(short,) if short else None, help_behavior_hint=""
    )


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
    """The annotation of a flag; `core.knobs.checked` says whether its value is a legal one."""
    kind, metavar = knob.type, None
    if knob.choices and all(isinstance(choice, str) for choice in knob.choices):
        kind, metavar = str, "|".join(knob.choices)
    if kind is bool:
        kind = tyro.conf.FlagConversionOff[bool]  # on, off and not given are three things
    limits = f" [{knob.expected}]" if knob.range else ""
    text = f"{knob.text}{limits}; default: what the stage says"
    return Annotated[kind | None, arg(help=text, metavar=metavar, help_behavior_hint="")]


def _plain(complaint: str, command: str) -> str:
    """tyro's complaint without its box, title, rules and advice, which are not for logs."""
    lines = [_FRAME.sub("", line).rstrip() for line in complaint.splitlines()[1:]]
    said = textwrap.dedent("\n".join(line for line in lines if line.strip(" ─-"))).splitlines()
    advice = next((i for i, x in enumerate(said) if x.startswith("For full helptext")), None)
    return "\n".join(
        [f"usdsplat {command}: {said[0]}", *said[1:advice], f"usdsplat {command} --help tells more"]
    )
