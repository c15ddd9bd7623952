"""CUDA kernels out of CPU loops: the items of a `prange` become threads.

A kernel qualifies if it is plain statements and then one `prange` loop. Its source is taken as it
is, but for these:

- `prange(n)` becomes a loop over every so-manieth item from the thread's own number on.
- Where the items are blocks of BLOCK rows, and nothing but the rows is written, a block is one row:
  BLOCK is 1.
- Where the body is one loop more, over as many items each time, both become one.
- Small arrays of a constant size are the thread's own.
- Where each item is a loop over a block's rows and then `out[item] = total`, a block of threads
  has the item: each makes a total of its own, by +=, |= or max, and `total` is what those make.
- Where the loop counts something that the kernel returns, threads add to `COUNTED`, one argument
  more.

So the loops are written once, and what they compute is the same expression on both devices.
"""

from __future__ import annotations

import ast
import copy
import inspect
import math
import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np

BLOCK = "BLOCK"
COUNTED = "_counted"
"""Name of the argument, (1,) i64, that receives what a kernel returns."""
PRIVATE = 2048
"""Bytes that a thread may have of its own: more would be slow."""


class Underivable(Exception):
    """The kernel is not one parallel loop."""


def derive(
    kernel: Callable[..., Any],
    threads: int,
    *,
    spread: bool = False,
    change: ast.NodeTransformer | None = None,
) -> Callable[..., None]:
    """The kernel as Python that each thread runs, for `cuda.jit` to compile; `counts` tells whether
    it has the argument `COUNTED`.

    Args:
        kernel: As the CPU runs it.
        threads: Of a block that it will be launched with, a power of two.
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
    counted = _counted(body)
    if counted is not None:
        body = body[:-1]
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
    totalled = None if spread else _totalled(loop)
    if spread:
        _spread(loop, source.__name__)
        _stride(loop, call.args[0], "block")
    elif totalled is not None:
        _share(loop, totalled, call.args[0], threads)
        names["_total"] = _TOTALS[totalled[1]]
    else:
        _flatten(loop, call)
        _stride(loop, call.args[0], "grid")
    function.body = [*body[:-1], loop]
    if counted is not None:
        function.args.args.append(ast.arg(COUNTED))
        text = f"if {counted} != 0:\n    cuda.atomic.add({COUNTED}, 0, {counted})"
        function.body += ast.parse(text).body
    if change is not None:
        change.visit(tree)
    ast.fix_missing_locations(tree)
    names["cuda"] = cuda
    exec(compile(tree, inspect.getsourcefile(source) or "?", "exec"), names)
    derived: Callable[..., None] = names[function.name]
    return derived


def counts(derived: Callable[..., None]) -> bool:
    """Whether a derived kernel has the argument `COUNTED`."""
    return COUNTED in inspect.signature(derived).parameters


def _counted(body: list[ast.stmt]) -> str | None:
    """What the kernel returns: a name that is 0 before the loop, if it returns anything."""
    last = body[-1] if body else None
    if not isinstance(last, ast.Return) or not isinstance(last.value, ast.Name):
        return None
    starts = f"{last.value.id} = 0"
    return last.value.id if any(ast.unparse(each) == starts for each in body) else None


_SHARES = {
    "grid": ("cuda.grid(1)", "cuda.gridsize(1)"),
    "block": ("cuda.blockIdx.x", "cuda.gridDim.x"),
}


def _expression(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _range(first: ast.expr, stop: ast.expr, step: str) -> ast.Call:
    return ast.Call(ast.Name("range", ast.Load()), [first, stop, _expression(step)], [])


def _stride(loop: ast.For, count: ast.expr, who: str) -> None:
    """Make it the loop over the share of `count` items that a thread, or a block, has."""
    first, step = _SHARES[who]
    loop.iter = _range(_expression(first), count, step)


_TOTALS: dict[str, type] = {"+": np.float64, "|": np.bool_, "max": np.float64}
"""How totals are made -> what they are."""


def _totalled(loop: ast.For) -> tuple[str, str] | None:
    """The name of what an item's loop over rows makes, and how; None where it is not just that."""
    if len(loop.body) != 3 or not isinstance(loop.body[1], ast.For):
        return None
    start, rows, end = loop.body
    if not (isinstance(start, ast.Assign) and isinstance(start.targets[0], ast.Name)):
        return None
    name = start.targets[0].id
    assert isinstance(loop.target, ast.Name) and isinstance(rows, ast.For)
    is_kept = (
        isinstance(end, ast.Assign)
        and ast.unparse(end.value) == name
        and isinstance(end.targets[0], ast.Subscript)
        and ast.unparse(end.targets[0].slice) == loop.target.id
    )
    changes = [
        node
        for node in ast.walk(rows)
        if isinstance(node, ast.Assign | ast.AugAssign)
        and name in [ast.unparse(each) for each in _targets(node)]
    ]
    makers = {_maker_of(node, name) for node in changes}
    if not is_kept or len(makers) != 1 or any(isinstance(n, ast.Break) for n in _own(rows.body)):
        return None
    maker = makers.pop()
    return None if maker is None else (name, maker)


def _targets(node: ast.Assign | ast.AugAssign) -> list[ast.expr]:
    return node.targets if isinstance(node, ast.Assign) else [node.target]


def _maker_of(node: ast.Assign | ast.AugAssign, name: str) -> str | None:
    """ "+" or "|" of `name += ...` and `name |= ...`, "max" of `name = max(name, ...)`."""
    if isinstance(node, ast.AugAssign):
        return {ast.Add: "+", ast.BitOr: "|"}.get(type(node.op))
    return "max" if ast.unparse(node.value).startswith(f"max({name}, ") else None


def _share(loop: ast.For, totalled: tuple[str, str], count: ast.expr, threads: int) -> None:
    """Make it the loop over items of a block of threads, which divide the rows among themselves."""
    name, maker = totalled
    _stride(loop, count, "block")
    rows, end = loop.body[1], loop.body[2]
    assert isinstance(rows, ast.For) and isinstance(rows.iter, ast.Call)
    first, last = rows.iter.args
    rows.iter = _range(_expression("_first + cuda.threadIdx.x"), last, "cuda.blockDim.x")
    begin = ast.parse("_first = 0").body[0]
    assert isinstance(begin, ast.Assign)
    begin.value = first
    two = "_totals[_me], _totals[_me + _half]"
    both = f"max({two})" if maker == "max" else two.replace(",", f" {maker}")
    meet = f"""
_totals = cuda.shared.array({threads}, _total)
_me = cuda.threadIdx.x
_totals[_me] = {name}
cuda.syncthreads()
_half = {threads // 2}
while _half > 0:
    if _me < _half:
        _totals[_me] = {both}
    cuda.syncthreads()
    _half //= 2
if _me == 0:
    {ast.unparse(end).removesuffix(name)}_totals[0]
cuda.syncthreads()
"""
    loop.body = [begin, loop.body[0], rows, *ast.parse(meet).body]


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
    first, end = inner.iter.args
    own = ast.BinOp(first, ast.Add(), _expression("cuda.threadIdx.x"))
    inner.iter = _range(own, end, "cuda.blockDim.x")


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
        dtype = ast.unparse(call.args[-1])
        try:
            shape = tuple(np.atleast_1d(eval(ast.unparse(call.args[0]), self._names)).tolist())
            size = math.prod(shape) * np.dtype(eval(dtype, self._names)).itemsize
        except NameError as error:
            raise Underivable(f"{target}: an array whose size is not constant") from error
        if size > PRIVATE:
            raise Underivable(f"{target}: {size} bytes for each thread")
        wide = shape[0] if len(shape) == 1 else shape
        lines = [f"{target} = cuda.local.array({wide}, {dtype})"]
        fill = _FILLS[maker] or (ast.unparse(call.args[1]) if maker == "full" else None)
        if fill is not None:
            lines += [f"{target}[...] = {fill}"] if len(shape) > 1 else [
                f"for _i in range({wide}):", f"    {target}[_i] = {fill}",
            ]  # fmt: skip
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
