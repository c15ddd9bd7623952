"""Edits as flags whose order counts, among words that may stand in any."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import fields, make_dataclass
from typing import Annotated, Any

from usdsplat.cli.arguments import option
from usdsplat.core.edits import KINDS, Edit, Kind, parsed

_NUMBERS = re.compile(r"[-+\d.,eE%]+")


def _placeholder(kind: Kind) -> str:
    """How the value of a flag is shown."""
    return f"[{kind.values}]" if kind.bare else kind.values


def _flags() -> type:
    """A dataclass with a field for each kind of edit: PLACE:VALUE for each time it is typed."""
    made = [
        (
            name.replace("-", "_"),
            Annotated[tuple[str, ...], option(_placeholder(kind), text=kind.text)],
            (),
        )
        for name, kind in KINDS.items()
    ]
    flags = make_dataclass("EditFlags", made, frozen=True, kw_only=True)
    flags.__doc__ = "What is done to the splats on the way, in the order in which it is typed."
    return flags


EditFlags: Any = _flags()


def arranged(words: Sequence[str], switches: Collection[str]) -> list[str]:
    """Words of a command line, those that are no options first, edits with their places.

    A parser forgets in which order options of several names stood, and takes no files behind
    options after files before them. So "a --scale 2 b --morton" becomes "a b --scale=0:2
    --morton=1:".

    Args:
        words: What the user typed.
        switches: Options that take no value, edits left out.
    """
    plain: list[str] = []
    options: list[str] = []
    rest, place = list(words), 0
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or word == "-":
            plain.append(word)
            continue
        flag, joined, value = word.partition("=")
        kind = KINDS.get(flag.removeprefix("--").replace("_", "-"))
        follows = bool(rest) and not rest[0].startswith("--")
        if kind is None:
            takes = follows and not joined and flag not in switches
            options += [word, rest.pop(0)] if takes else [word]
            continue
        if not joined and kind.count:
            fits = follows and (not kind.bare or _NUMBERS.fullmatch(rest[0]))
            value = rest.pop(0) if fits else kind.bare
        options.append(f"{flag}={place}:{value}" if value or not kind.count else flag)
        place += 1
    return plain + options


def edits_of(flags: Any) -> tuple[Edit, ...]:
    """The edits that were typed, in their order, of an `EditFlags`.

    Raises:
        UsageError: If numbers are not those that an edit takes.
    """
    typed = []
    for item in fields(flags):
        for text in getattr(flags, item.name):
            place, _, value = text.partition(":")
            typed.append((int(place), item.name.replace("_", "-"), value))
    return tuple(parsed(name, value) for _, name, value in sorted(typed))
