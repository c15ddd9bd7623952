"""Derived kernels in which what is `kernels.jit.exact` is not contracted on a GPU either.

NVVM makes one instruction of a product and a sum, wherever it may. A product that says how it is
rounded it leaves alone, so all products of such functions do.
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
from usdsplat.kernels.cuda.device import BLOCKS, THREADS, CudaDevice, Form, form

PRODUCT = "_product"
"""Name of what multiplies in place of `*`."""


def uncontracted(kernel: Callable[..., Any]) -> Form:
    """The form of a kernel, derived, in which exact functions give the CPU's bits."""

    @functools.cache
    def threads_of() -> Any:  # when it is launched: there need not be a compiler before
        source = getattr(kernel, "py_func", kernel)
        same = FunctionType(source.__code__, _with_exact(source), source.__name__)
        return cuda.jit(derive(same, THREADS))

    @form
    def launch(device: CudaDevice, *args: Any) -> None:
        threads_of()[BLOCKS, THREADS, device.stream](*args)

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
    source = function.py_func
    tree = ast.parse(textwrap.dedent(inspect.getsource(source)))
    definition = tree.body[0]
    assert isinstance(definition, ast.FunctionDef)
    definition.decorator_list = []
    names = {**_with_exact(source), PRODUCT: _product()}
    exec(
        compile(
            ast.fix_missing_locations(_Products().visit(tree)), source.__code__.co_filename, "exec"
        ),
        names,
    )
    return cuda.jit(device=True)(names[definition.name])


class _Products(ast.NodeTransformer):
    """Puts calls of PRODUCT in the place of products."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Mult):
            return node
        return ast.Call(ast.Name(PRODUCT, ast.Load()), [node.left, node.right], [])


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
