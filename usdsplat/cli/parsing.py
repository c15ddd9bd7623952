"""Parse the arguments of a command into its options, with argparse."""

from __future__ import annotations

import argparse
import difflib
import functools
import inspect
import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, get_type_hints

from usdsplat.cli import console
from usdsplat.cli.arguments import Argument, arguments_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

_KINDS = {float: "a number", int: "a whole number"}
LARGEST = 2**31 - 1
"""Largest whole number that a flag takes; C++ libraries hold 32 bits."""
ELSEWHERE = {
    **dict.fromkeys(("--size", "--width", "--height", "--res", "--imagewidth"), "--resolution"),
    **dict.fromkeys(("--spp", "--pixelsamples"), "--samples"),
    **dict.fromkeys(("--gpu", "--cpu"), "--device"),
    **dict.fromkeys(("--workers", "--processes"), "--jobs"),
    "--bg": "--background",
    "--serve": "--web",
    "--rendersettingsprimpath": "--settings",
}
"""Flag of usdrecord, husk or another tool, in lower case -> our flag for the same."""
NARROWEST = 40
"""Least width of help [character]; argparse may not end on a narrower terminal."""


class _Mistake(Exception):
    """Signal arguments that cannot be parsed, with what was found and what was expected."""

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(found, expected)
        self.found, self.expected = found, expected


class _Formatter(argparse.RawDescriptionHelpFormatter):
    """Formatter of help that no terminal makes narrower than `NARROWEST`."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._width = max(self._width, NARROWEST)
        self._max_help_position = min(self._max_help_position, self._width - 20)


class _Parser(argparse.ArgumentParser):
    """argparse parser that raises errors, which `parse` explains."""

    def print_help(self, file: Any = None) -> None:
        console.say(self.format_help(), end="")  # argparse would swallow a closed pipe

    def error(self, message: str) -> NoReturn:
        raise _Mistake(repr(message), "other arguments")


class _Pair(argparse.BooleanOptionalAction):
    """Action for `--name` and `--no-name`, of which only one may be given."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        before = getattr(namespace, self.dest, None)
        super().__call__(parser, namespace, values, option_string)
        if before not in (None, getattr(namespace, self.dest)):
            raise _Mistake(" and ".join(self.option_strings), "one of them")


def parse(options: type[T], command: str, text: str, arguments: Sequence[str]) -> T | int:
    """Parse `arguments` into an instance of `options`.

    Args:
        options: A dataclass. Each field is an argument, with the string below it as help; a field
            that is itself a dataclass is a group of arguments.
        command: Name of the command.
        text: Description and examples, shown before the arguments.
        arguments: The command line after the command's name.

    Returns:
        An instance, or the exit status if there is nothing to run: 0 after help, 2 after an error,
        which has been explained in one line on stderr.
    """
    known = arguments_of(options)
    try:
        parser = _parser(options, command, text)
        words = _normalized(arguments, known)
        namespace, extra = parser.parse_known_args(words)
        given = vars(namespace)
        _check(given, extra, known)
        typed = [each for each in known if each.dest in given]
        return _made(options, {each.dest: _converted(each, given[each.dest]) for each in typed})
    except SystemExit:  # after the help
        return 0
    except argparse.ArgumentError as error:
        mistake = _Mistake(f"a value for {error.argument_name}", "none")
    except _Mistake as error:
        mistake = error
    sentence = f"{command}: found {mistake.found}, expected {mistake.expected}"
    console.complain(f"{sentence}; see 'usdsplat {command} --help'")
    return 2


@functools.cache  # a worker parses many command lines
def _parser(options: type, command: str, text: str) -> argparse.ArgumentParser:
    """Make the parser of a command."""
    known = arguments_of(options)
    places = " ".join(each.flag for each in known if each.shown.is_positional)
    parser = _Parser(
        prog=f"usdsplat {command}",
        usage=f"usdsplat {command} [-h] [OPTIONS] {places}".rstrip(),
        description=text.strip(),
        formatter_class=_Formatter,
        allow_abbrev=False,
        exit_on_error=False,
        argument_default=argparse.SUPPRESS,
    )
    hints = _hints(options)
    groups: dict[str, Any] = {"": parser}
    for each in known:
        if each.owner not in groups:
            about = inspect.cleandoc(hints[each.owner].__doc__ or "")
            title = f"{each.owner.replace('_', ' ')} options"
            groups[each.owner] = parser.add_argument_group(title, about)
        _add(groups[each.owner], each)
    return parser


def _add(parser: Any, argument: Argument) -> None:
    """Add one argument to a parser or to one of its groups."""
    shown, text = argument.shown, argument.text.replace("%", "%%")
    metavar = argument.value_name
    if shown.is_positional:
        nargs = "*" if argument.is_many else "?"
        parser.add_argument(argument.dest, metavar=metavar, nargs=nargs, help=text)
        return
    names = [shown.short] if shown.short else []
    how: dict[str, Any] = {"metavar": metavar, "action": "append" if argument.is_many else "store"}
    if argument.is_pair:
        how = {"action": _Pair}
    elif not argument.takes_value:
        how = {"action": "store_true"}
    parser.add_argument(*names, argument.flag, dest=argument.dest, help=text, **how)


def _normalized(words: Sequence[str], known: Sequence[Argument]) -> list[str]:
    """Return the words reordered so that argparse need not guess: positional arguments come first.

    Every value is joined to its flag, so that it may begin with a minus.

    Raises:
        _Mistake: If a flag lacks its value.
    """
    flags = {name: each for each in known for name in (each.flag, each.shown.short) if name}
    plain: list[str] = []
    options: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or word == "-":
            plain.append(word)
            continue
        typed, joined, value = word.partition("=")
        typed = typed.replace("_", "-")
        argument = flags.get(typed)
        if argument is None or not argument.takes_value:
            options.append(f"{typed}{joined}{value}")
            continue
        if not joined:
            if not rest or rest[0].startswith("--") or rest[0] in flags or rest[0] == "-h":
                raise _Mistake(f"{typed} without a value", "one")
            value = rest.pop(0)
        options.append(f"{argument.flag}={value}")
        while rest and (more := argument.shown.further) and re.fullmatch(more, rest[0]):
            options.append(f"{argument.flag}={rest.pop(0)}")
    return plain + options


def _check(given: dict[str, Any], extra: Sequence[str], known: Sequence[Argument]) -> None:
    """Raise an error for unknown, missing and mutually exclusive arguments.

    Raises:
        _Mistake: If there is one of these.
    """
    unknown = [word.partition("=")[0] for word in extra if word.startswith("-")]
    if unknown:
        flags = [each.flag for each in known if not each.shown.is_positional]
        meant = ELSEWHERE.get(unknown[0].lower())
        similar = [meant] if meant in flags else difflib.get_close_matches(unknown[0], flags, n=1)
        raise _Mistake(unknown[0], similar[0] if similar else "a known option")
    if extra:
        raise _Mistake(extra[0], "nothing more")
    lacking = [each for each in known if each.is_required and not given.get(each.dest)]
    missing = [each.flag.split()[-1] for each in lacking]  # the required part of "[IN ...] OUT"
    if missing:
        raise _Mistake(f"no {' and no '.join(missing)}", "one")
    typed = [each for each in known if each.dest in given]
    for each in typed:
        if each.shown.excludes in [other.flag for other in typed]:
            raise _Mistake(f"{each.flag} and {each.shown.excludes}", "one of them")


def _converted(argument: Argument, value: Any) -> Any:
    """Convert a value, or several, to the type of the field.

    Raises:
        _Mistake: If a value is not of this type.
    """
    if isinstance(value, bool):
        return value
    if argument.is_many:
        return tuple(argument.kind(each) for each in value)
    if isinstance(value, list):
        value = "--"  # Python 3.11 removes it, even from --output=--
    try:
        converted = argument.kind(value)
        if isinstance(converted, int) and abs(converted) > LARGEST:
            raise _Mistake(f"{argument.flag} {value!r}", f"a whole number of at most {LARGEST}")
        return converted
    except ValueError:
        expected = _KINDS.get(argument.kind, "another value")
        raise _Mistake(f"{argument.flag} {value!r}", expected) from None


@functools.cache
def _hints(options: type) -> dict[str, Any]:
    return get_type_hints(options)


def _made(options: type[T], values: dict[str, Any], owner: str = "") -> T:
    """Make an instance of the options with its groups. Arguments that are not given keep their
    default."""
    hints = _hints(options)
    found = {}
    for item in fields(options):
        if is_dataclass(hints[item.name]):
            found[item.name] = _made(hints[item.name], values, item.name)
        elif f"{owner}.{item.name}" in values:
            found[item.name] = values[f"{owner}.{item.name}"]
    return options(**found)
