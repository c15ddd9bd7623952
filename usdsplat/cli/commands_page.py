"""Write docs/reference/commands.md, the page of all commands and flags, from their options.

python -m usdsplat.cli.commands_page [--check]
"""

from __future__ import annotations

import importlib
import inspect
import itertools
import sys
from collections.abc import Iterable, Iterator, Sequence
from types import ModuleType
from typing import get_type_hints

from usdsplat.cli.arguments import Argument, arguments_of
from usdsplat.cli.main import COMMANDS
from usdsplat.core.generated_page import REFERENCE, keep_page, table_text

TARGET = REFERENCE / "commands.md"

_HEAD = """# All flags

All commands and flags, as `usdsplat COMMAND --help` prints them. [How commands
behave](../commands.md) has what they share: exit statuses, findings, files.

This page is generated from the options of the commands by `python -m usdsplat.cli.commands_page`.
"""


def page() -> str:
    """Return the text of the page."""
    parts = [_HEAD]
    for name, text in COMMANDS.items():
        module = importlib.import_module(f"usdsplat.cli.{name.replace('-', '_')}")
        parts.append(f"\n## {name}\n\n{text.capitalize()}.\n")
        parts += _description(module)
        parts += _tables(name, module.Options)
    return "".join(parts)


def _description(module: ModuleType) -> Iterator[str]:
    """Yield what the help of a command says after its first line: examples and notes."""
    _, *paragraphs = inspect.cleandoc(module.__doc__ or "").split("\n\n")
    for paragraph in paragraphs:
        title, _, rest = paragraph.partition("\n")
        if title.endswith(":") and rest.startswith("  "):
            yield f"\n**{title[:-1].capitalize()}**\n\n```text\n{inspect.cleandoc(rest)}\n```\n"
        else:
            yield f"\n{paragraph}\n"


def _tables(name: str, options: type) -> Iterator[str]:
    """Yield a table of the arguments of each group, under its title."""
    hints = get_type_hints(options)
    for owner, group in itertools.groupby(arguments_of(options), key=lambda each: each.owner):
        if owner:
            about = inspect.cleandoc(hints[owner].__doc__ or "")
            yield f"\n### {name}: {owner.replace('_', ' ')}\n"
            yield f"\n{about}\n" if about else ""
        yield "\n| argument | meaning |\n|---|---|\n"
        yield from _rows(group)


def _rows(arguments: Iterable[Argument]) -> Iterator[str]:
    """Yield a row for each argument."""
    for each in arguments:
        words = [each.shown.short, each.flag] if each.shown.short else [each.flag]
        if each.is_pair:
            words.append(f"--no-{each.flag[2:]}")
        value = each.value_name if each.takes_value and not each.shown.is_positional else ""
        spelled = table_text(f"{', '.join(words)} {value}".strip())
        yield f"| `{spelled}` | {table_text(each.text)} |\n"


def main(arguments: Sequence[str]) -> int:
    """Write the page, or with --check return 1 if the stored one differs."""
    return keep_page(TARGET, page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
