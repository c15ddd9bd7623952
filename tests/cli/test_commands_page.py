"""Tests that docs/reference/commands.md is generated from the current commands."""

from __future__ import annotations

import importlib

from usdsplat.cli import commands_page
from usdsplat.cli.arguments import flag_names
from usdsplat.cli.main import COMMANDS


def test_the_committed_page_is_up_to_date() -> None:
    """Oracle: the generator, run again."""
    assert commands_page.TARGET.read_text(encoding="utf-8") == commands_page.page()


def test_every_command_and_flag_is_on_the_page() -> None:
    """Oracle: the options of each command."""
    sections = commands_page.page().split("\n## ")[1:]
    assert [each.splitlines()[0] for each in sections] == list(COMMANDS)
    for section in sections:
        module = importlib.import_module(
            f"usdsplat.cli.{section.splitlines()[0].replace('-', '_')}"
        )
        assert [flag for flag in flag_names(module.Options) if f"--{flag}" not in section] == []


def test_check_says_whether_a_page_is_stale(tmp_path, monkeypatch) -> None:
    """Oracle: no page, a page with other text, the written one."""
    target = tmp_path / "reference" / "commands.md"
    monkeypatch.setattr(commands_page, "TARGET", target)
    assert commands_page.main(["--check"]) == 1
    assert commands_page.main([]) == 0
    assert commands_page.main(["--check"]) == 0
    target.write_text("# All flags\n", encoding="utf-8")
    assert commands_page.main(["--check"]) == 1
