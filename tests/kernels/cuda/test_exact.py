"""What is exact on the CPU is not contracted on a GPU."""

from __future__ import annotations

import re

import pytest

from usdsplat.kernels.cuda.device import form_of

from . import paper
from .launches import example, kernel_of, launches


def test_products_are_rounded_alone() -> None:
    """Oracle: NVIDIA's NVVM: of a kernel whose arithmetic is all exact, no instruction multiplies
    and adds, and every product says how it is rounded."""
    missing = paper.obstacle()
    if missing:
        pytest.skip(missing)
    kernel = "sim.nearest.nearest"
    (types,) = (t for name, t in launches() if name == kernel)
    with paper.compiling() as made:
        paper.device().run(kernel_of(kernel), *map(example, types))
    (code,) = made.values()
    assert set(re.findall(r"\b(?:mul|fma)[.\w]*f32\b", code)) == {"mul.rn.f32"}


@pytest.mark.parametrize("kernel", ["sim.nearest.nearest", "sim.bvh.find_closest"])
def test_a_gpu_runs_the_form_that_is_exact(kernel: str) -> None:
    """Oracle: where the form was made."""
    form = form_of(kernel_of(kernel))
    assert form is not None and form.__qualname__.startswith("uncontracted.")
