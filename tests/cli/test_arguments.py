"""Tests of arguments that are derived from the fields of dataclasses."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from usdsplat.cli.arguments import arguments_of, flag_names, flags_of, given, option, positional
from usdsplat.core.knobs import knob


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Knobs of every kind that a flag can be."""

    mode: str = knob("a", "how", choices=("a", "b"))
    level: int = knob(3, "how much", range=(0, 4))
    size: float = knob(1.5, "how large", unit="m")
    strict: bool = knob(True, "how strictly")


@dataclass(frozen=True, kw_only=True)
class Group:
    """Arguments that belong together."""

    words: Annotated[tuple[str, ...], option("WORD")] = ()
    """said one by one; may be
    repeated"""


@dataclass(frozen=True, kw_only=True)
class Wider(Group):
    """With another."""

    float_: Annotated[float | None, option(name="float")] = None
    """a number"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a command takes."""

    path: Annotated[Path, positional("FILE")]
    """where"""
    is_json: Annotated[bool, option(name="json")] = False
    """for machines"""
    wider: Wider = field(default_factory=Wider)


def test_fields_are_arguments_with_the_string_below_for_help():
    """Oracle: the classes above, by hand; inherited fields come first."""
    found = {each.dest: (each.flag, each.kind, each.text) for each in arguments_of(Options)}
    assert found == {
        ".path": ("FILE", Path, "where"),
        ".is_json": ("--json", bool, "for machines"),
        "wider.words": ("--words", str, "said one by one; may be repeated"),
        "wider.float_": ("--float", float, "a number"),
    }
    assert [each.dest for each in arguments_of(Options) if each.is_required] == [".path"]
    assert flag_names(Options) == {"json", "words", "float"}


def test_flags_may_be_some_of_the_knobs_and_have_others_beside_them():
    """Oracle: the names that are asked for; what is no knob is not given."""
    some: Any = flags_of(Settings, ("size", "strict"))

    @dataclass(frozen=True, kw_only=True)
    class More(some):
        """With a flag of another kind."""

        other: bool = False
        """something else"""

    assert [item.name for item in fields(some)] == ["size", "strict"]
    assert given(More(size=2.0, strict=False, other=True)) == {"size": 2.0, "strict": False}
