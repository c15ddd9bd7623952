"""Tests of arguments from dataclasses, and of flags from knobs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import pytest

from usdsplat.cli.arguments import flags_of, given, positional
from usdsplat.cli.parsing import parse
from usdsplat.core.knobs import checked, knob, knobs


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Knobs of every kind that a flag can be."""

    mode: str = knob("a", "how", choices=("a", "b"))
    level: int = knob(3, "how much", range=(0, 4))
    size: float = knob(1.5, "how large", unit="m")
    strict: bool = knob(True, "how strictly")


Flags: Any = flags_of(Settings)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What a command takes."""

    name: Annotated[str, positional("NAME")]
    """whose"""
    settings: Flags = field(default_factory=Flags)


def test_flags_that_are_not_given_are_no_opinion():
    """Oracle: an empty mapping, so that the knobs' own defaults hold."""
    options = parse(Options, "try", "Try.", ["x"])
    assert options.name == "x"
    assert given(options.settings) == {}


def test_flags_that_are_given_are_values_of_the_knobs():
    """Oracle: the values on the command line, taken by core.knobs.checked."""
    argv = ["x", "--mode", "b", "--level", "0", "--size", "2", "--no-strict"]
    values = given(parse(Options, "try", "Try.", argv).settings)
    assert values == {"mode": "b", "level": 0, "size": 2.0, "strict": False}
    assert checked("try", Settings, values) == Settings(**values)


def test_what_is_on_or_off_can_be_said_either_way(capsys):
    """Oracle: the two flags; both at once are one sentence."""
    assert given(parse(Options, "try", "Try.", ["x", "--strict"]).settings) == {"strict": True}
    assert parse(Options, "try", "Try.", ["x", "--strict", "--no-strict"]) == 2
    said = "usdsplat: try: found --strict and --no-strict, expected one of them; see "
    assert capsys.readouterr().err.startswith(said)


def test_help_comes_from_the_knobs(capsys):
    """Oracle: text, choices and range of every knob; a knob that is on or off has one line."""
    assert parse(Options, "try", "Try it.\n\nexamples:\n  usdsplat try x\n", ["--help"]) == 0
    out = capsys.readouterr().out
    assert "usage: usdsplat try" in out
    assert "  usdsplat try x\n" in out
    assert all(item.text in out for item in knobs(Settings))
    assert "--mode a|b" in out
    assert "[0 to 4]" in out
    assert "--strict, --no-strict" in out
    assert "(default" not in out


def test_a_value_may_begin_with_a_minus_and_a_place_come_last():
    """Oracle: the value and the name as they were typed, underscores for dashes too."""
    for argv in (["--size", "-2.5", "x"], ["--size=-2.5", "x"], ["x", "--size", "-2.5"]):
        options = parse(Options, "try", "Try.", argv)
        assert (options.name, given(options.settings)) == ("x", {"size": -2.5})
    assert given(parse(Options, "try", "Try.", ["x", "--no_strict"]).settings) == {"strict": False}


def test_a_value_may_be_two_dashes():
    """Oracle: the value as it was typed."""
    options = parse(Options, "try", "Try.", ["x", "--mode=--"])
    assert given(options.settings) == {"mode": "--"}


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        ([], "found no NAME, expected one"),
        (["x", "y"], "found y, expected nothing more"),
        (["x", "--level", "much"], "found --level 'much', expected a whole number"),
        (["x", "--size", "big"], "found --size 'big', expected a number"),
        (["x", "--level"], "found --level without a value, expected one"),
        (["x", "--level", "--size", "2"], "found --level without a value, expected one"),
        (["x", "--strict=yes"], "found a value for --strict/--no-strict, expected none"),
        (["x", "--levl", "3"], "found --levl, expected --level"),
        (["x", "--qqqqqqqq"], "found --qqqqqqqq, expected a known option"),
    ],
)
def test_mistakes_are_one_sentence(argv, sentence, capsys):
    """Oracle: written out by hand; the shape of all our errors, with the cure at the end."""
    assert parse(Options, "try", "Try.", argv) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"usdsplat: try: {sentence}; see 'usdsplat try --help'\n")
