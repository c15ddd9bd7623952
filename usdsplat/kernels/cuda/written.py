"""Which of its arguments a kernel may write, read off its source: the others need not come back.

Names that stand for an argument, or for a part of it, count as it does; what a kernel calls is
looked into; and of what cannot be looked into the worst is assumed.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from usdsplat.kernels.launch import Kernel

_PARTS = ("view", "reshape", "ravel", "T")
"""Methods and attributes that give an array on the same memory."""
_READERS = ("shape", "size", "copy", "sum", "min", "max", "any", "all", "astype")
EVERYONE = frozenset(range(256))
_READING = threading.RLock()
_KNOWN: dict[Any, frozenset[int]] = {}
"""Kernel -> places of the arguments: a property of the sources."""


def written(kernel: Callable[..., Any]) -> frozenset[int]:
    """Places, from 0, of the arguments that `kernel` may write."""
    if isinstance(kernel, Kernel):
        return kernel.writes
    source = getattr(kernel, "py_func", kernel)
    with _READING:  # or another thread would be given what is half known
        if source not in _KNOWN:
            _KNOWN[source] = frozenset()  # of one that calls itself
            _KNOWN[source] = _read(source)
        return _KNOWN[source]


def _read(source: Any) -> frozenset[int]:
    try:
        function = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
    except (OSError, TypeError):  # it is not Python's
        return EVERYONE
    assert isinstance(function, ast.FunctionDef)
    names = [each.arg for each in function.args.args]
    found = _Reader(source, names)
    before = -1
    while before != (before := sum(map(len, found.aliases.values()))):
        for statement in function.body:  # until no name stands for more
            found.visit(statement)
    return frozenset(names.index(each) for each in found.written)


class _Reader(ast.NodeVisitor):
    """What the statements of a function do to its arguments."""

    def __init__(self, source: Any, names: list[str]) -> None:
        self._source = source
        self.aliases = {name: {name} for name in names}
        """Name -> arguments that it may stand for."""
        self.written: set[str] = set()

    def visit_Assign(self, node: ast.Assign) -> None:
        """Names get what they stand for."""
        for target in node.targets:
            self._bind(target, node.value)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """`a[i] += b` writes; `a += b` would, of an array, too."""
        self.written |= self._roots(node.target)
        self.generic_visit(node)

    def visit_For(self, node: ast.For) -> None:
        """Rows of an array may be what a loop gives."""
        self._bind(node.target, node.iter)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """What is called may write what it is given."""
        called = self._called(node.func)
        if isinstance(node.func, ast.Attribute) and not inspect.ismodule(called):
            owner = self._roots(node.func.value)
            if node.func.attr not in (*_PARTS, *_READERS):
                self.written |= owner
        parts = [self._roots(each) for each in node.args]
        if called is not None and hasattr(called, "py_func"):
            called = called.py_func
        if inspect.isfunction(called) and not _is_foreign(called):
            for place in written(called):
                self.written |= parts[place] if place < len(parts) else set()
        elif not _is_harmless(called):
            for part in parts:
                self.written |= part
        self.generic_visit(node)

    # --- private ---------------------------------------------------------------------------

    def _bind(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Subscript):
            self.written |= self._roots(target)
        elif isinstance(target, ast.Tuple | ast.List):
            same = isinstance(value, ast.Tuple) and len(value.elts) == len(target.elts)
            for k, each in enumerate(target.elts):
                self._bind(each, value.elts[k] if same else value)  # type: ignore[attr-defined]
        elif isinstance(target, ast.Name):
            self.aliases.setdefault(target.id, set()).update(self._roots(value))

    def _roots(self, node: ast.expr) -> set[str]:
        """Arguments that the value of an expression may be, or be a part of."""
        if isinstance(node, ast.Name):
            return set(self.aliases.get(node.id, ()))
        if isinstance(node, ast.Subscript | ast.Starred):
            return self._roots(node.value)
        if isinstance(node, ast.Attribute):
            return set() if node.attr in _READERS else self._roots(node.value)
        if isinstance(node, ast.Call):
            func = node.func
            is_part = isinstance(func, ast.Attribute) and func.attr in _PARTS
            return self._roots(func.value) if is_part else set()  # type: ignore[attr-defined]
        if isinstance(node, ast.Tuple):
            return set().union(*(self._roots(each) for each in node.elts))
        if isinstance(node, ast.IfExp):
            return self._roots(node.body) | self._roots(node.orelse)
        return set()

    def _called(self, func: ast.expr) -> Any:
        """What is called, as far as the function's globals tell."""
        if isinstance(func, ast.Name):
            scope = self._source.__globals__
            return scope.get(func.id, getattr(builtins, func.id, None))
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name):
            owner = self._source.__globals__.get(func.value.id)
            return getattr(owner, func.attr, None) if owner is not None else len
        return len  # a method of some expression, of which `visit_Call` knows


def _is_foreign(called: Any) -> bool:
    return not str(called.__module__).startswith(("usdsplat", "tests", "benchmarks"))


def _is_harmless(called: Any) -> bool:
    """Whether it is known to write nothing: mathematics, and what makes numbers."""
    if called is None:
        return False
    module = str(getattr(called, "__module__", ""))
    return (
        isinstance(called, type | np.ufunc)
        or called in (len, range, abs, min, max, int, float, round, enumerate, zip)
        or module.startswith(("math", "numba", "numpy"))
        or getattr(math, getattr(called, "__name__", ""), None) is called
    )
