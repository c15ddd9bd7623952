"""Arguments of a command, from the dataclass that describes them, by tyro."""

from __future__ import annotations

import contextlib
import io
import re
import sys
import textwrap
from collections.abc import Iterable
from dataclasses import field, fields, make_dataclass
from typing import Annotated, Any, TypeVar

import tyro
from tyro.conf import arg

from usdsplat.cli.flag_names import spelled
from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, knobs

T = TypeVar("T")

_FRAME = re.compile(r"^[│╭╰|+][─-]*\s?|[─-]*\s*[│╮╯|+]$")

NO = "no_"
"""What the name of a flag that turns its knob off begins with."""
KNOB = "knob"
"""What the fields of flags say they are for."""

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


def option(
    metavar: str | None = None,
    *,
    name: str | None = None,
    short: str = "",
    text: str | None = None,
) -> Any:
    """How a field is shown: its placeholder, another name, a short form; put it in Annotated.

    The string below a field, or `text`, says what its default means, so tyro's own remark is left
    out.
    """
    return arg(
        metavar=metavar,
        name=name,
        aliases=(short,) if short else None,
        help=text,
        help_behavior_hint="",
    )


def flags_of(cls: type, names: Iterable[str] | None = None, *, about: str = "") -> type:
    """Make a dataclass with an optional flag for each knob of `cls`; None is "not given".

    A knob that is on or off gets two, `--name` and `--no-name`.

    Args:
        names: Only these knobs, in this order; None for all.
        about: What they have in common, shown above them.
    """
    known = {knob.name: knob for knob in knobs(cls)}
    flags: list[tuple[str, Any, Any]] = []
    for name in known if names is None else names:
        knob = known[name]
        flags.append((name, _flag(knob), _not_given(knob)))
        if knob.type is bool:
            against = option(name=f"no-{spelled(name)}", text="the opposite")
            flags.append((f"{NO}{name}", Annotated[bool, against], _not_given(knob)))
    made = make_dataclass(f"{cls.__name__}Flags", flags, frozen=True, kw_only=True)
    made.__doc__ = about
    return made


def given(flags: Any) -> dict[str, Any]:
    """The values that were given, of an instance of what `flags_of` made, or of what inherits it.

    Raises:
        UsageError: If something is to be both on and off.
    """
    found: dict[str, Any] = {}
    for item in fields(flags):
        value, knob = getattr(flags, item.name), item.metadata.get(KNOB)
        if knob is None or value is None or value is False:
            continue
        if knob in found:
            flag = spelled(knob)
            raise UsageError(f"--{flag}", f"--no-{flag} too", "one of them")
        found[knob] = value if item.name == knob else False
    return found


def _not_given(knob: Knob) -> Any:
    """The default of a flag; a knob that is on or off has none that means it."""
    return field(default=False if knob.type is bool else None, metadata={KNOB: knob.name})


def _flag(knob: Knob) -> Any:
    """The annotation of a flag; `core.knobs.checked` says whether its value is a legal one."""
    kind, metavar = knob.type, None
    if knob.choices and all(isinstance(choice, str) for choice in knob.choices):
        kind, metavar = str, "|".join(knob.choices)
    elif kind is str:
        metavar = "NAME"
    limits = "" if knob.range is None else f"{knob.range[0]:g} to {knob.range[1]:g}"
    numbers = " ".join(filter(None, (limits, knob.unit)))
    text = f"{knob.text} [{numbers}]" if numbers else knob.text
    shown = option(metavar, name=spelled(knob.name), text=text)
    return Annotated[kind if kind is bool else kind | None, shown]


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
