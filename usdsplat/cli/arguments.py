"""Derive the arguments of a command from the fields of a dataclass."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import textwrap
import types
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from usdsplat.cli.flag_names import spelled
from usdsplat.core.knobs import Knob, knobs

KNOB = "knob"
"""Metadata key of a flag's field; its value is the knob's name."""
_METAVARS = {float: "FLOAT", int: "INT", str: "TEXT", Path: "PATH"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Spelling and help text of an argument."""

    metavar: str | None = None
    name: str | None = None
    short: str = ""
    text: str | None = None
    excludes: str = ""
    further: str = ""
    """Pattern of the words that, after a value, are further values of the flag."""
    is_positional: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """One argument of a command: a field of its options, or of a group within them."""

    owner: str
    """Name of the group's field; empty for the options themselves."""
    name: str
    """Name of the field."""
    kind: type
    """Type of one value."""
    is_pair: bool
    """Whether the argument has the flags `--name` and `--no-name`, and neither is the default."""
    is_many: bool
    """Whether the argument takes any number of values."""
    is_required: bool
    shown: Shown
    text: str

    @property
    def dest(self) -> str:
        """Key of the argument in the parsed values."""
        return f"{self.owner}.{self.name}"

    @property
    def flag(self) -> str:
        """The flag with dashes, or the placeholder of a positional argument."""
        if self.shown.is_positional:
            return self.shown.metavar or self.name.upper()
        return f"--{self.shown.name or self.name.replace('_', '-')}"

    @property
    def value_name(self) -> str | None:
        """Placeholder of the value in the help; None for a boolean."""
        return _METAVARS.get(self.kind) if self.shown.metavar is None else self.shown.metavar

    @property
    def takes_value(self) -> bool:
        """Whether a value follows the flag."""
        return self.kind is not bool


def option(
    metavar: str | None = None,
    *,
    name: str | None = None,
    short: str = "",
    text: str | None = None,
    excludes: str = "",
    further: str = "",
) -> Any:
    """Return the spelling and help of a field, for use in Annotated.

    Args:
        metavar: Placeholder of the value.
        name: Name of the flag, if it differs from the field's.
        short: A short form, such as "-o".
        text: Help text, instead of the string below the field.
        excludes: A flag that cannot be combined with this one.
        further: Pattern of the words that, after a value, are further values of the flag.
    """
    return Shown(
        metavar=metavar, name=name, short=short, text=text, excludes=excludes, further=further
    )


def positional(metavar: str) -> Any:
    """Return the description of a positional argument, for use in Annotated."""
    return Shown(metavar=metavar, is_positional=True)


def flag_names(options: type) -> set[str]:
    """Return the names of all flags of a command, without dashes."""
    return {each.flag[2:] for each in arguments_of(options) if not each.shown.is_positional}


def flags_of(cls: type, names: Iterable[str] | None = None, *, about: str = "") -> type:
    """Make a dataclass with an optional flag for each knob of `cls`. None means "not given".

    A boolean knob has the flags `--name` and `--no-name`.

    Args:
        names: Only these knobs, in this order; None for all.
        about: Text that is shown above the flags.
    """
    known = {knob.name: knob for knob in knobs(cls)}
    made = make_dataclass(
        f"{cls.__name__}Flags",
        [
            (name, _flag(known[name]), field(default=None, metadata={KNOB: name}))
            for name in (known if names is None else names)
        ],
        frozen=True,
        kw_only=True,
    )
    made.__doc__ = about
    return made


def given(flags: Any) -> dict[str, Any]:
    """Return the given values of an instance of a class made by `flags_of`, or derived from one."""
    values = {item.metadata.get(KNOB): getattr(flags, item.name) for item in fields(flags)}
    return {knob: value for knob, value in values.items() if knob and value is not None}


def _flag(knob: Knob) -> Any:
    """Return the annotation of a flag. `core.knobs.checked` checks its values."""
    kind, metavar = knob.type, None
    if knob.choices and all(isinstance(choice, str) for choice in knob.choices):
        kind, metavar = str, "|".join(knob.choices)
    elif kind is str:
        metavar = "NAME"
    limits = "" if knob.range is None else f"{knob.range[0]:g} to {knob.range[1]:g}"
    numbers = " ".join(filter(None, (limits, knob.unit)))
    text = f"{knob.text} [{numbers}]" if numbers else knob.text
    return Annotated[kind | None, option(metavar, name=spelled(knob.name), text=text)]


@functools.cache  # a worker parses many command lines
def arguments_of(options: type, owner: str = "") -> tuple[Argument, ...]:
    """Return the arguments of a dataclass and of the dataclasses in its fields."""
    return tuple(_arguments_of(options, owner))


def _arguments_of(options: type, owner: str) -> Iterator[Argument]:
    hints = get_type_hints(options, include_extras=True)
    texts = _texts(options)
    for item in fields(options):
        hint = hints[item.name]
        kind, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if isinstance(kind, type) and is_dataclass(kind):
            yield from arguments_of(kind, item.name)
            continue
        shown = next((mark for mark in marks if isinstance(mark, Shown)), Shown())
        is_many = get_origin(kind) is tuple
        several = get_args(kind) if is_many or isinstance(kind, types.UnionType) else (kind,)
        yield Argument(
            owner=owner,
            name=item.name,
            kind=several[0],
            is_pair=several[0] is bool and item.default is None,
            is_many=is_many,
            is_required=item.default is MISSING and item.default_factory is MISSING,
            shown=shown,
            text=shown.text or texts.get(item.name, ""),
        )


def _texts(options: type) -> dict[str, str]:
    """Return the string below each field of a dataclass and of its bases."""
    found: dict[str, str] = {}
    for cls in reversed(options.__mro__):
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
        except (OSError, TypeError):  # built in, or made by `flags_of`
            continue
        body = tree.body if isinstance(tree, ast.ClassDef) else []
        for item, below in itertools.pairwise(body):
            if not (isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)):
                continue
            if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                found[item.target.id] = " ".join(str(below.value.value).split())
    return found
