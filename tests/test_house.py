"""Tests of house rules that no linter checks."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "usdsplat"
MOST = 8
"""Parameters of a function; more become values with names."""


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of a function's parameters, without `self` and `cls`."""
    arguments = node.args
    every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    return [each.arg for each in every if each.arg not in ("self", "cls")]


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """("file:name", function) of every function of the package outside `kernels`."""
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0] == "kernels":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{place.as_posix()}:{node.name}", node


def test_no_function_has_more_than_eight_parameters() -> None:
    """Oracle: the syntax trees of all modules outside `kernels`."""
    found = [(name, len(parameters(node))) for name, node in functions()]
    assert len(found) > 1000
    assert [name for name, count in found if count > MOST] == []


LEFT = {
    "Shot", "Prepared", "Visible", "Painter", "PlainPicture", "Behind", "Thinning", "Filling",
    "Reading", "Writing", "Sums", "Moments", "Scratch", "Laying", "Wanted", "Goal", "Way", "Desk",
    "Bridge", "Newest",
}  # fmt: skip
"""Names of classes that the house's table of names replaces."""


def test_no_class_has_a_name_that_was_replaced() -> None:
    """Oracle: the syntax trees of all modules."""
    found = {
        node.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }
    assert len(found) > 300
    assert found & LEFT == set()
