"""Arguments of a command, from the dataclass that describes them, by tyro."""

from __future__ import annotations

import contextlib
import io
import math
import re
import sys
import textwrap
from dataclasses import fields, make_dataclass
from typing import Annotated, Any, TypeVar

import tyro
from tyro.conf import arg

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, knobs

T = TypeVar("T")

_FRAME = re.compile(r"^[│╭╰|+][─-]*\s?|[─-]*\s*[│╮╯|+]$")

_KINDS = {"FLOAT": "a number", "INT": "a whole number"}


def parse(options: type[T], command: str, text: str, arguments: list[str]) -> T | int:
    """Read `arguments` as `options`.

    Args:
        options: A dataclass; each field is an argument with the string below it for help.
        command: Name of the command.
        text: What it does, with examples; shown before the arguments.
        arguments: What the user typed after the command's name.

    Returns:
        An instance, or the exit status when there is nothing to run: 0 after help, 2 after a
        mistake, which was explained on stderr in a sentence.
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
        print(f"usdsplat: {_sentence(complaint.getvalue(), command)}", file=sys.stderr)
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


def time_code(value: float | None) -> float | None:
    """The value of `--time`.

    Raises:
        UsageError: If it is not finite: NaN is how USD writes the default time.
    """
    if value is not None and not math.isfinite(value):
        raise UsageError("--time", f"{value:g}", "the number of a frame")
    return value


def resolution_of(text: str | None) -> tuple[int, int] | None:
    """The value of `--resolution`, WIDTHxHEIGHT, as two numbers.

    Raises:
        UsageError: If it is anything else.
    """
    if text is None:
        return None
    match = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text)
    if not match:
        raise UsageError("--resolution", repr(text), "two numbers of pixels, such as 1920x1080")
    return int(match[1]), int(match[2])


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


def _sentence(complaint: str, command: str) -> str:
    """tyro's complaint, which is many lines in a box, as one line of our shape."""
    lines = [_FRAME.sub("", line).rstrip() for line in complaint.splitlines()[1:]]
    said = textwrap.dedent("\n".join(line for line in lines if line.strip(" ─-")))
    said = said.partition("For full helptext")[0].strip()
    found, expected = _found_and_expected(said)
    return f"{command}: found {found}, expected {expected}; see 'usdsplat {command} --help'"


def _found_and_expected(said: str) -> tuple[str, str]:
    """What tyro says in its own words; what it may say some day is passed on as it is."""
    flat = " ".join(said.split())
    if match := re.match(r"Unrecognized options: ([^ ,]+)", flat):
        meant = re.search(r"Perhaps you meant: (--\S+)", flat)
        is_flag = match[1].startswith("-")
        return match[1], meant[1] if meant else "a known option" if is_flag else "nothing more"
    if flat.startswith("Missing from"):
        names = re.findall(r"^ {4}(\S+)$", said, re.MULTILINE)
        return f"no {' and no '.join(names)}", "one"
    if match := re.match(r"Missing value for argument '(\S+)'", flat):
        return f"{match[1]} without a value", "one"
    if match := re.match(r"Arguments (.+) are not allowed together", flat):
        return match[1], "one of them"
    if match := re.match(r"Error parsing (\S+): no type matching (\S+) .*?from \[(.*?)\]", flat):
        return f"{match[1]} {match[3]}", _KINDS.get(match[2], match[2])
    return repr(flat), "other arguments"
