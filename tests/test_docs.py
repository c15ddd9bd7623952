"""Tests of the documentation: its code blocks, its commands, and its list of public names."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest
from pxr import Sdf

import usdsplat
from usdsplat import formats
from usdsplat.cli.main import COMMANDS, main
from usdsplat.cli.parsing import parse

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
RUN = ("python.md", "simulate.md", "view.md")
"""Pages whose Python is run."""


def blocks(path, *languages):
    """The code blocks of a page in these languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", path.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    return [code for language, code in found if language in languages]


def commands(path):
    """The command lines of usdsplat on a page, as words; those with an ellipsis are no examples."""
    for code in blocks(path, "sh", ""):
        for line in code.replace("\\\n", " ").splitlines():
            for part in re.split(r" · |;|&&| \| ", re.sub(r"(^|\s)#.*", "", line)):
                if part.strip().startswith("usdsplat ") and "…" not in part:
                    yield shlex.split(part)[1:]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_command_line_is_one_that_the_parser_takes(path, capsys):
    """Oracle: the parser of each command."""
    for name, *words in commands(path):
        if name.startswith("--"):
            continue
        assert name in COMMANDS, (path.name, name)
        module = importlib.import_module(f"usdsplat.cli.{name.replace('-', '_')}")
        words = module.arranged(words) if hasattr(module, "arranged") else words
        parsed = parse(module.Options, name, module.__doc__, words)
        assert not isinstance(parsed, int), (path.name, name, words, capsys.readouterr().err)


def test_there_are_command_lines_on_most_pages():
    """Oracle: a pattern that finds nothing would test nothing."""
    assert sum(1 for path in PAGES for _ in commands(path)) > 120


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_usda_is_read_by_usd(path):
    """Oracle: USD's own parser."""
    for code in blocks(path, "usda"):
        text = code if code.startswith("#usda") else f"#usda 1.0\n{code}"
        assert Sdf.Layer.CreateAnonymous(".usda").ImportFromString(text), code


def test_python_uses_public_names_alone():
    """Oracle: the syntax trees of what users copy."""
    codes = [(path.name, code) for path in PAGES for code in blocks(path, "python")]
    codes += [(path.name, path.read_text()) for path in (ROOT / "examples").glob("*.py")]
    imported = [
        (where, node.module, alias.name)
        for where, code in codes
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("usdsplat")
        for alias in node.names
    ]
    assert len(imported) > 20
    private = [
        each for each in imported if each[1] != "usdsplat" or each[2] not in usdsplat.__all__
    ]
    assert private == []


@pytest.mark.parametrize("name", RUN)
def test_python_of_the_guides_runs(name, tmp_path, monkeypatch):
    """Oracle: an error of the code, and the files that it says it writes."""
    monkeypatch.chdir(tmp_path)
    formats.write(usdsplat.procedural_capture(2000), "scan.ply")
    assert main(["simulate", "--preset", "grow", "scan.ply", "-o", "grow.usda", "-q"]) == 0
    namespace = {"__name__": name}
    for code in blocks(ROOT / "docs" / name, "python"):
        exec(compile(code, name, "exec"), namespace)
    if name == "python.md":
        assert Path("scan.0001.exr").is_file() and namespace["smaller"].shape == (1080, 1920, 4)
    if name == "simulate.md":
        assert len(namespace["cloud"].positions) >= 2000
    if name == "view.md":
        assert Path("scan.png").is_file()


def test_the_page_of_the_api_has_every_public_name():
    """Oracle: `__all__`."""
    text = (ROOT / "docs" / "reference" / "api.md").read_text()
    modules = {"usdsplat.core.edit": "edit"}
    named = re.findall(r"auto(?:class|function|module):: (?:usdsplat\.)?(\S+)", text)
    found = {modules.get(f"usdsplat.{each}", each) for each in named}
    assert found == set(usdsplat.__all__)
