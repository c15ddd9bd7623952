"""CUDA kernels out of CPU loops: the items of a `prange` become threads.

A kernel qualifies if it is plain statements and then one `prange` loop. Its source is taken as it
is, but for these:

- `prange(n)` becomes a loop over every so-manieth item from the thread's own number on.
- Where the items are blocks of BLOCK rows, and nothing but the rows is written, a block is one row:
  BLOCK is 1.
- Where the body is one loop more, over as many items each time, both become one.
- Small arrays of a constant size are the thread's own.

So the loops are written once, and what they compute is the same expression on both devices.
"""

from __future__ import annotations

import ast
import copy
import inspect
import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np

BLOCK = "BLOCK"


class Underivable(Exception):
    """The kernel is not one parallel loop."""


def derive(kernel: Callable[..., Any], *, spread: bool = False) -> Callable[..., None]:
    """The kernel as Python that each thread runs, for `cuda.jit` to compile.

    Args:
        spread: An item is a block of threads, and its last loop's items are theirs: plain
            statements come before it, and its items do not wait for each other.

    Raises:
        Underivable: If it is not one `prange` loop with what threads can have.
    """
    from numba import cuda, prange

    source = getattr(kernel, "py_func", kernel)
    names = dict(source.__globals__)
    tree = ast.parse(textwrap.dedent(inspect.getsource(source)))
    function = tree.body[0]
    assert isinstance(function, ast.FunctionDef)
    function.decorator_list = []
    body = _without_docstring(function.body)
    parallels = [
        node
        for node in ast.walk(function)
        if isinstance(node, ast.Call) and _calls(node, names, prange)
    ]
    if not body or len(parallels) != 1 or not isinstance(body[-1], ast.For):
        raise Underivable(f"{source.__name__}: not one prange loop at the end")
    loop = body[-1]
    if loop.iter is not parallels[0] or any(_writes(node) for node in body[:-1]):
        raise Underivable(f"{source.__name__}: more than one prange loop after plain statements")
    call = parallels[0]
    if len(call.args) != 1:
        raise Underivable(f"{source.__name__}: prange from elsewhere than 0")
    if BLOCK in names and _mentions(call.args[0], BLOCK):
        names[BLOCK] = 1
    loop.body = _Private(names).statements(loop.body)
    if spread:
        _spread(loop, source.__name__)
    else:
        _flatten(loop, call)
    function.body = [*body[:-1], _strided(loop, call.args[0], "block" if spread else "grid")]
    ast.fix_missing_locations(tree)
    names["cuda"] = cuda
    exec(compile(tree, inspect.getsourcefile(source) or "?", "exec"), names)
    derived: Callable[..., None] = names[function.name]
    return derived


_SHARES = {
    "grid": ("cuda.grid(1)", "cuda.gridsize(1)"),
    "block": ("cuda.blockIdx.x", "cuda.gridDim.x"),
}


def _strided(loop: ast.For, count: ast.expr, who: str) -> ast.For:
    """The loop over the share of `count` items that a thread, or a block, has."""
    first, step = _SHARES[who]
    loop.iter = ast.parse(f"range({first}, 0, {step})", mode="eval").body
    loop.iter.args[1] = count  # type: ignore[attr-defined]
    return loop


def _spread(loop: ast.For, name: str) -> None:
    """Give the items of the last loop within to the threads of a block."""
    inner = loop.body[-1]
    if (
        not isinstance(inner, ast.For)
        or not (isinstance(inner.iter, ast.Call) and isinstance(inner.iter.func, ast.Name))
        or inner.iter.func.id != "range"
        or len(inner.iter.args) != 2
        or any(_writes(node) for node in loop.body[:-1])
    ):
        raise Underivable(
            f"{name}: not plain statements and then a loop from one number to another"
        )
    text = ast.parse("range(0 + cuda.threadIdx.x, 0, cuda.blockDim.x)", mode="eval").body
    first, end = inner.iter.args
    text.args[0].left, text.args[1] = first, end  # type: ignore[attr-defined]
    inner.iter = text


def _flatten(loop: ast.For, call: ast.Call) -> None:
    """Make one loop of two where the inner one is all there is, and as long each time."""
    if len(loop.body) != 1 or not isinstance(loop.body[0], ast.For):
        return
    inner = loop.body[0]
    assert isinstance(loop.target, ast.Name)
    bounds = inner.iter
    if (
        inner.orelse
        or not isinstance(inner.target, ast.Name)
        or not (isinstance(bounds, ast.Call) and isinstance(bounds.func, ast.Name))
        or bounds.func.id != "range"
        or len(bounds.args) != 1
        or _mentions(bounds.args[0], loop.target.id)
        or any(isinstance(node, ast.Break) for node in _own(inner.body))
    ):
        return
    wide = bounds.args[0]
    text = f"{loop.target.id} = _item // _wide\n{inner.target.id} = _item % _wide"
    head = ast.parse(text).body
    for statement in head:
        for node in ast.walk(statement):
            if isinstance(node, ast.BinOp):
                node.right = copy.deepcopy(wide)
    loop.target = ast.Name("_item", ast.Store())
    loop.body = [*head, *inner.body]
    call.args[0] = ast.BinOp(call.args[0], ast.Mult(), copy.deepcopy(wide))


def _own(body: list[ast.stmt]) -> list[ast.AST]:
    """Nodes of statements, but not of loops within: a `break` there is theirs."""
    found: list[ast.AST] = []
    pending: list[ast.AST] = list(body)
    while pending:
        node = pending.pop()
        found.append(node)
        if not isinstance(node, ast.For | ast.While):
            pending.extend(ast.iter_child_nodes(node))
    return found


class _Private:
    """Arrays that are made within the loop: each thread has its own, of a constant size."""

    def __init__(self, names: dict[str, Any]) -> None:
        self._names = names

    def statements(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """`body` with them made as CUDA makes them."""
        out: list[ast.stmt] = []
        for statement in body:
            for name in ("body", "orelse"):
                nested = getattr(statement, name, None)
                if nested:
                    setattr(statement, name, self.statements(nested))
            out.extend(self._made(statement))
        return out

    def _made(self, statement: ast.stmt) -> list[ast.stmt]:
        if not isinstance(statement, ast.Assign):
            return [statement]
        pairs = [(statement.targets[0], statement.value)]
        if isinstance(statement.value, ast.Tuple) and isinstance(statement.targets[0], ast.Tuple):
            pairs = list(zip(statement.targets[0].elts, statement.value.elts, strict=True))
        if not any(self._maker(value) for _, value in pairs):
            return [statement]
        out: list[ast.stmt] = []
        for target, value in pairs:
            maker = self._maker(value)
            if maker is None:
                out.append(ast.Assign([target], value))
                continue
            assert isinstance(value, ast.Call)
            out.extend(self._array(ast.unparse(target), maker, value))
        return out

    def _maker(self, value: ast.expr) -> str | None:
        """Which of NumPy's makers of arrays is called, if one is."""
        if not isinstance(value, ast.Call) or not isinstance(value.func, ast.Attribute):
            return None
        of = value.func.value
        is_numpy = isinstance(of, ast.Name) and self._names.get(of.id) is np
        return value.func.attr if is_numpy and value.func.attr in _FILLS else None

    def _array(self, target: str, maker: str, call: ast.Call) -> list[ast.stmt]:
        try:
            shape = eval(ast.unparse(call.args[0]), self._names)
        except NameError as error:
            raise Underivable(f"{target}: an array whose size is not constant") from error
        if not isinstance(shape, int | np.integer):
            raise Underivable(f"{target}: an array of more than one axis")
        dtype = ast.unparse(call.args[-1])
        lines = [f"{target} = cuda.local.array({int(shape)}, {dtype})"]
        fill = _FILLS[maker] or (ast.unparse(call.args[1]) if maker == "full" else None)
        if fill is not None:
            lines += [f"for _i in range({int(shape)}):", f"    {target}[_i] = {fill}"]
        return ast.parse("\n".join(lines)).body


_FILLS: dict[str, str | None] = {"empty": None, "zeros": "0", "ones": "1", "full": None}
"""Makers of arrays, and what they fill them with."""


def _without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    first = body[0] if body else None
    is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return body[1:] if is_text else body


def _calls(node: ast.Call, names: dict[str, Any], called: Any) -> bool:
    return isinstance(node.func, ast.Name) and names.get(node.func.id) is called


def _mentions(node: ast.AST, name: str) -> bool:
    return any(isinstance(each, ast.Name) and each.id == name for each in ast.walk(node))


def _writes(statement: ast.stmt) -> bool:
    """Whether a statement may do more than name a value."""
    if not isinstance(statement, ast.Assign):
        return True
    return any(
        isinstance(node, ast.Subscript) for target in statement.targets for node in ast.walk(target)
    )
