"""Functions whose every rounding is settled on a GPU: in each kernel they give the same bits.

NVVM makes one instruction of a product and a sum wherever it may, and may do so otherwise in the
next kernel. Operations that say how they are rounded it leaves alone:

- `uncontracted` kernels: what is `kernels.jit.exact` rounds each product and each sum, as on the
  CPU.
- `contracted` functions: a product that is added to something, by `+` or `-`, is one operation with
  the sum; all other products are rounded alone. As fast as what NVVM makes. `+=` and `*=` are left
  to NVVM: none of these functions has one on floats.
"""

from __future__ import annotations

import ast
import functools
import inspect
import textwrap
from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import cuda

from usdsplat.kernels.cuda.derive import derive
from usdsplat.kernels.cuda.device import (
    BLOCKS,
    THREADS,
    CudaDevice,
    Form,
    derived_kernel,
    form,
    spread,
)
from usdsplat.kernels.cuda.support import is_compiled

PRODUCT, FUSED = "_product", "_fused"
"""Names of what multiplies in place of `*`, and of what multiplies and adds."""


def uncontracted(kernel: Callable[..., Any]) -> Form:
    """The form of a kernel, derived, in which exact functions give the CPU's bits."""

    @functools.cache
    def threads_of() -> Any:  # when it is launched: there need not be a compiler before
        source = getattr(kernel, "py_func", kernel)
        same = FunctionType(source.__code__, _with_exact(source), source.__name__)
        return derived_kernel(kernel, derive(same, THREADS), "uncontracted")

    if is_compiled():
        threads_of()  # for `usdsplat compile`, which looks through all there are

    @form
    def launch(device: CudaDevice, *args: Any) -> None:
        threads_of()[BLOCKS, THREADS, device.stream](*args)

    return launch


def contracted_spread(kernel: Callable[..., Any]) -> Form:
    """The form of a kernel whose items are blocks of threads, see `derive`, contracted in one way,
    and so are the functions that it calls."""
    source = getattr(kernel, "py_func", kernel)
    if not is_compiled():
        return spread(kernel)
    names = {**_with_contracted(source), PRODUCT: _product(), FUSED: _fused()}
    same = FunctionType(source.__code__, names, source.__name__)
    derived = derive(same, THREADS, spread=True, change=_Contractions())
    threads_of = derived_kernel(kernel, derived, "contracted, spread")

    @form
    def launch(device: CudaDevice, *args: Any) -> None:
        threads_of[BLOCKS, THREADS, device.stream](*args)

    return launch


def _with_exact(source: Any) -> dict[str, Any]:
    """What a function knows by name, its exact functions made for CUDA."""
    known = dict(source.__globals__)
    for name in source.__code__.co_names:
        if _is_exact(known.get(name)):
            known[name] = _for_cuda(known[name])
    return known


def _is_exact(value: Any) -> bool:
    """Whether Numba has been told to contract nothing in it; of plain Python nothing is known."""
    flags = getattr(value, "targetoptions", {}).get("fastmath")
    return isinstance(flags, set) and "contract" not in flags


@functools.cache
def _for_cuda(function: Any) -> Any:
    return _rewritten(function.py_func, _with_exact(function.py_func), _Products())


@functools.cache
def contracted(function: Any) -> Any:
    """The device function of a scalar one, and of those that it calls, contracted in one way.

    In each sum the left term is fused if it is a product, else the right one.
    """
    if not is_compiled():  # what only reads or simulates takes the function as it is
        return function
    return _rewritten(function.py_func, _with_contracted(function.py_func), _Contractions())


def _with_contracted(source: Any) -> dict[str, Any]:
    """What a function knows by name, its scalar functions made for CUDA and contracted."""
    known = dict(source.__globals__)
    for name in source.__code__.co_names:
        if "contract" in getattr(known.get(name), "targetoptions", {}).get("fastmath", ()):
            known[name] = contracted(known[name])
    return known


def _rewritten(source: Any, known: dict[str, Any], change: ast.NodeTransformer) -> Any:
    """The device function of a plain one, whose tree is changed."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(source)))
    definition = tree.body[0]
    assert isinstance(definition, ast.FunctionDef)
    definition.decorator_list = []
    names = {**known, PRODUCT: _product(), FUSED: _fused()}
    changed = ast.fix_missing_locations(change.visit(tree))
    exec(compile(changed, source.__code__.co_filename, "exec"), names)
    return cuda.jit(device=True)(names[definition.name])


class _Products(ast.NodeTransformer):
    """Puts calls of PRODUCT in the place of products."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Mult):
            return node
        return ast.Call(ast.Name(PRODUCT, ast.Load()), [node.left, node.right], [])


class _Contractions(_Products):
    """Puts calls of FUSED in the place of a product and a sum too."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        if not isinstance(node.op, ast.Add | ast.Sub):
            return super().visit_BinOp(node)
        left, right = _factors(node.left), _factors(node.right)
        minus = isinstance(node.op, ast.Sub)
        if left is not None:
            rest = ast.UnaryOp(ast.USub(), node.right) if minus else node.right
            terms = [*left, rest]
        elif right is not None:
            first = ast.UnaryOp(ast.USub(), right[0]) if minus else right[0]
            terms = [first, right[1], node.left]
        else:
            return super().visit_BinOp(node)
        return ast.Call(ast.Name(FUSED, ast.Load()), [self.visit(each) for each in terms], [])


def _factors(node: ast.expr) -> list[ast.expr] | None:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return [node.left, node.right]
    return None


@functools.cache
def _fused() -> Callable[[Any, Any, Any], Any]:
    """What multiplies two numbers and adds a third, rounded once, in a kernel."""
    from numba.cuda import types
    from numba.cuda.extending import overload  # type: ignore[attr-defined]  # numba-cuda's

    def fused(a, b, c):
        return a * b + c

    @overload(fused)
    def by_types(a, b, c):
        kinds = (a, b, c)
        if all(each == types.float32 for each in kinds):
            return lambda a, b, c: cuda.fma(a, b, c)
        if any(isinstance(each, types.Float) for each in kinds):
            return lambda a, b, c: cuda.fma(types.float64(a), types.float64(b), types.float64(c))
        return lambda a, b, c: a * b + c

    found: Callable[[Any, Any, Any], Any] = fused
    return found


@functools.cache
def _product() -> Callable[[Any, Any], Any]:
    """What multiplies two numbers, rounded to the nearest, in a kernel."""
    from numba.cuda import libdevice, types
    from numba.cuda.extending import overload  # type: ignore[attr-defined]  # numba-cuda's

    def product(a, b):
        return a * b

    @overload(product)
    def by_types(a, b):
        if a == types.float32 and b == types.float32:
            return lambda a, b: libdevice.fmul_rn(a, b)
        if isinstance(a, types.Float) or isinstance(b, types.Float):
            return lambda a, b: libdevice.dmul_rn(types.float64(a), types.float64(b))
        return lambda a, b: a * b

    found: Callable[[Any, Any], Any] = product
    return found
