"""What is exact on the CPU is not contracted on a GPU."""

from __future__ import annotations

import math
import re

import pytest
from numba import cuda
from numba.core import types as numba_types

from usdsplat.kernels import ahead, signatures
from usdsplat.kernels.cuda import jit
from usdsplat.kernels.cuda.device import form_of

from . import paper
from .launches import kernel_of


def ptx_of(name: str, types: str) -> str:
    """What NVVM makes of a kernel."""
    ahead._load_cuda_kernel(name)
    signature = numba_types.void(*signatures.decode(types))
    with jit._compiling_for(paper.CAPABILITY):
        code: str = cuda.compile(
            jit.KERNELS[name].py_func, signature, device=False, cc=paper.CAPABILITY, abi="numba"
        )[0]
    return code


def test_products_are_rounded_alone() -> None:
    """Oracle: NVIDIA's NVVM: of a kernel whose arithmetic is all exact, no instruction multiplies
    and adds, and every product says how it is rounded."""
    paper.require()
    name = "sim.nearest.nearest"
    (types,) = (t for n, t in signatures.table("cuda") if n == name)
    assert set(re.findall(r"\b(?:mul|fma)[.\w]*f32\b", ptx_of(name, types))) == {"mul.rn.f32"}


def test_what_decides_is_contracted_in_one_way() -> None:
    """Oracle: NVIDIA's NVVM, on a kernel that only takes a logarithm: no other product of kernels
    that project is left to be contracted as it pleases."""
    paper.require()

    def free(code: str) -> int:
        return len(re.findall(r"\b(?:mul|mad)\.(?:ftz\.)?f(?:32|64)\b", code))

    @cuda.jit
    def logarithm(out):
        out[0] = math.log(out[0])

    signature = numba_types.void(*signatures.decode("f4:1C"))
    with jit._compiling_for(paper.CAPABILITY):
        code = cuda.compile(
            logarithm.py_func, signature, device=False, cc=paper.CAPABILITY, abi="numba"
        )[0]
    tables = dict(signatures.table("cuda"))
    for form in ("load_floats", "load_packed"):
        name = f"cuda.frame.project.see({form})"
        found = ptx_of(name, tables[name])
        assert "fma.rn.f32" in found and "fma.rn.f64" in found
        assert free(found) <= free(code), name


@pytest.mark.parametrize("kernel", ["sim.nearest.nearest", "sim.bvh.find_closest"])
def test_a_gpu_runs_the_form_that_is_exact(kernel: str) -> None:
    """Oracle: where the form was made."""
    form = form_of(kernel_of(kernel))
    assert form is not None and form.__qualname__.startswith("uncontracted.")
