"""Return the command line of options, the inverse of `parsing.parse`."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

from usdsplat.cli.arguments import Argument, arguments_of


def words_of(options: Any) -> tuple[str, ...]:
    """Return the words after the name of a command that are parsed into `options`.

    Options with their default value are left out.
    """
    words: list[str] = []
    kind: type = type(options)
    for each in arguments_of(kind):
        owner = getattr(options, each.owner) if each.owner else options
        value = getattr(owner, each.name)
        if each.is_required or value != _default(owner, each.name):
            words += _typed(each, value)
    return tuple(words)


def _typed(argument: Argument, value: Any) -> list[str]:
    """Return the words of one argument."""
    if argument.shown.is_positional:
        return [str(each) for each in value] if argument.is_many else [str(value)]
    if not argument.takes_value:
        return [argument.flag if value else f"--no-{argument.flag[2:]}"]
    values = value if argument.is_many else (value,)
    return [f"{argument.flag}={_text(each)}" for each in values]


def _text(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def _default(owner: Any, name: str) -> Any:
    """Return the default of a field."""
    item = next(each for each in fields(owner) if each.name == name)
    return item.default if item.default_factory is MISSING else item.default_factory()
