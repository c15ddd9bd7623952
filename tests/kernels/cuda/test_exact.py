"""Kernels that are exact are not contracted on a GPU."""

from __future__ import annotations

import re

import pytest

from usdsplat.kernels import ahead, signatures

from . import paper

EXACT = (
    "cuda.frame.project.see(load_floats)", "cuda.frame.project.see(load_packed)",
    "cuda.frame.project.place(shade_floats)", "cuda.frame.project.place(shade_packed)",
    "cuda.project._project", "radiance.radiance", "sim.bvh.find_closest", "sim.bvh.find_hits",
)  # fmt: skip
"""Kernels whose decisions, or whose colours, others must repeat."""


def ptx_of(name: str) -> str:
    """What NVVM makes of a kernel."""
    from usdsplat.kernels.cuda import jit

    ahead._load_cuda_kernel(name)
    types = next(types for each, types in signatures.table("cuda") if each == name)
    return jit.source_of(name, signatures.decode(types), paper.CAPABILITY)


def test_products_are_rounded_alone() -> None:
    """Oracle: NVIDIA's NVVM: of an exact kernel without library functions, no instruction
    multiplies and adds, and every product says how it is rounded."""
    paper.require()
    found = set(re.findall(r"\b(?:mul|fma)[.\w]*f32\b", ptx_of("sim.nearest.nearest")))
    assert found == {"mul.rn.f32"}


@pytest.mark.parametrize("name", EXACT)
def test_nothing_is_left_to_be_contracted(name: str) -> None:
    """Oracle: NVIDIA's NVVM: the assembler contracts products and sums that do not say how they are
    rounded, and there are none; a kernel that is not exact has many."""
    paper.require()
    free = r"\b(?:mul|mad|add|sub)\.(?:ftz\.)?f(?:32|64)\b"
    assert re.findall(free, ptx_of(name)) == []
    assert re.findall(free, ptx_of("sim.mls.gradients")) != []
