"""Parse edit flags, whose order matters, from a command line with files and flags in any order."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import fields, make_dataclass
from typing import Annotated, Any

from usdsplat.cli.arguments import option
from usdsplat.core.edits import KINDS, Edit, Kind, parsed

_NUMBERS = re.compile(r"[-+\d.,eE%]+")


def _placeholder(kind: Kind) -> str:
    """Return the placeholder of an edit flag's value."""
    return f"[{kind.values}]" if kind.bare else kind.values


def _flags() -> type:
    """Make a dataclass with a field for each kind of edit, which collects PLACE:VALUE for each
    use."""
    made = [
        (
            name.replace("-", "_"),
            Annotated[tuple[str, ...], option(_placeholder(kind), text=kind.text)],
            (),
        )
        for name, kind in KINDS.items()
    ]
    flags = make_dataclass("EditFlags", made, frozen=True, kw_only=True)
    flags.__doc__ = "Edits of the splats, applied in the order of the flags."
    return flags


EditFlags: Any = _flags()


def arranged(words: Sequence[str], switches: Collection[str]) -> list[str]:
    """Return a command line with positional arguments first and numbered edits.

    argparse loses the order of options with different names, and accepts no files after options
    that follow files. For example, "a --scale 2 b --morton" becomes "a b --scale=0:2 --morton=1:".

    Args:
        words: The command line.
        switches: Options other than edits that take no value.
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


def words_of_edits(flags: Any) -> tuple[str, ...]:
    """Return the words of an `EditFlags` on a command line that is not arranged yet."""
    found = []
    for item in fields(flags):
        for text in getattr(flags, item.name):
            place, _, value = text.partition(":")
            flag = f"--{item.name.replace('_', '-')}"
            found.append((int(place), f"{flag}={value}" if value else flag))
    return tuple(word for _, word in sorted(found))


def edits_of(flags: Any) -> tuple[Edit, ...]:
    """Return the edits of an `EditFlags` in the order of the command line.

    Raises:
        UsageError: If the values do not fit an edit.
    """
    typed = []
    for item in fields(flags):
        for text in getattr(flags, item.name):
            place, _, value = text.partition(":")
            typed.append((int(place), item.name.replace("_", "-"), value))
    return tuple(parsed(name, value) for _, name, value in sorted(typed))
