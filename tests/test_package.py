"""Tests of the package as a whole."""

from __future__ import annotations

import graphlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import grimp
import pytest

import usdsplat

ROOT = Path(__file__).parents[1]


def loaded_by(statement):
    """Names of the modules that a fresh interpreter holds after a statement."""
    code = f"import sys; {statement}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_importing_the_package_loads_neither_pxr_nor_numba():
    """Oracle: sys.modules of a fresh interpreter."""
    assert not loaded_by("import usdsplat") & {"pxr", "numba", "numpy"}


@pytest.mark.parametrize("name", usdsplat.__all__)
def test_a_public_name_is_there_and_typed(name):
    """Oracle: the import system; and the stub that type checkers read."""
    found = getattr(usdsplat, name)
    assert inspect.ismodule(found) == (name in {"edit", "formats", "schema"})
    stub = (ROOT / "usdsplat" / "__init__.pyi").read_text()
    assert re.search(rf"^(from [\w.]+ import \w+ as {name}|{name} = \w+)$", stub, re.MULTILINE)


def test_an_unknown_name_is_an_attribute_error():
    """Oracle: Python's own modules."""
    with pytest.raises(AttributeError, match="no attribute 'Motor'"):
        _ = usdsplat.Motor


def test_imports_form_no_cycle():
    """Lazy imports and those for type checkers count. Oracle: Python's topological sort."""
    graph = grimp.build_graph("usdsplat")
    imports = {each: graph.find_modules_directly_imported_by(each) for each in graph.modules}
    order = list(graphlib.TopologicalSorter(imports).static_order())
    assert len(order) > 500


def test_formats_work_without_pxr_and_numba():
    """Oracle: sys.modules of a fresh interpreter."""
    assert not loaded_by("from usdsplat import formats") & {"pxr", "numba"}


def test_the_changelog_knows_the_version():
    """Oracle: the version that the package says it has."""
    assert f"## {usdsplat.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_the_readme_says_the_two_commands_first():
    """Oracle: the first code block of the README."""
    block = re.search(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert block is not None
    assert [line.split("#")[0].strip() for line in block[1].splitlines()] == [
        "make demo",
        "make test",
    ]


def test_the_readmes_pictures_and_links_exist():
    """Oracle: the files beside it."""
    links = re.findall(r"\]\(([^)#:]+)\)", (ROOT / "README.md").read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_the_readme_has_no_number_left_open():
    """Oracle: a number to be filled in is an upper-case word in braces."""
    assert re.findall(r"\{[A-Z]+\}", (ROOT / "README.md").read_text()) == []


def test_no_file_of_the_package_is_too_long_to_hold_one_idea():
    """Oracle: the house rule, 400 lines."""
    lengths = {p: len(p.read_text().splitlines()) for p in (ROOT / "usdsplat").rglob("*.py")}
    assert {p: n for p, n in lengths.items() if n > 400} == {}


@pytest.mark.parametrize("module", ["preview.session", "preview.saving", "preview.viewer"])
def test_what_a_window_shows_loads_no_qt(module):
    """Oracle: sys.modules of a fresh interpreter."""
    assert not any(name.startswith("PySide6") for name in loaded_by(f"import usdsplat.{module}"))
