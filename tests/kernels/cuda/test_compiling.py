"""Kernels compile for CUDA with the types that they are launched with."""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from usdsplat.kernels import sim, thinning
from usdsplat.kernels.compiling import compile_time, on_compile
from usdsplat.kernels.cuda.device import form_of

from . import paper
from .launches import example, kernel_of, launches, name_of

ON_THE_CPU = {
    "sim.bvh.build_order": "a tree is built top down, once for a mesh",
    "sim.bvh.fit_boxes": "from the leaves up, after it",
    "sim.carriers.throw": "darts land one after the other, once for a simulation",
    "sim.distance_field.spread": "fronts that follow each other, once for a mesh",
    "sim.laplacian.merge": "rows that fill each other, only where a reaction conserves",
    "sim.laplacian.missing": "counts before that",
    "sim.nearest.plant": "a tree is divided in place, level by level",
    "sim.normals.orient": "signs that spread along a tree, once for lists",
    "sim.seeds.parts": "a search through a graph, once for a simulation",
    "sim.winding.fit_dipoles": "from the leaves up, once for a mesh",
    "thinning.pairs.match": "the cheapest pair first: what is taken next depends on it",
}
"""Kernels that the CPU runs for a GPU too, and why: what depends on its own last step."""


def _kernels(package: ModuleType) -> dict[str, Callable[..., Any]]:
    """Loops for all threads of the modules of a folder, by name."""
    import importlib
    import pkgutil

    found = {}
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        members = vars(importlib.import_module(module.name)).values()
        for each in members:
            options = getattr(each, "targetoptions", {})
            if options.get("parallel") and each.py_func.__module__ == module.name:
                found[name_of(each)] = each
    return found


KERNELS = _kernels(sim) | _kernels(thinning)


@functools.cache
def _obstacle() -> str | None:
    return paper.obstacle()


def test_the_table_has_every_kernel() -> None:
    """Oracle: the loops for all threads that the folders have."""
    assert set(KERNELS) <= {name for name, _ in launches()}


def test_the_cpu_runs_only_what_it_is_said_to() -> None:
    """Oracle: the list, with a reason for each: no kernel falls back unseen."""
    assert {n for n, _ in launches() if form_of(kernel_of(n)) is None} <= set(ON_THE_CPU)
    assert [n for n in ON_THE_CPU if form_of(kernel_of(n)) is not None] == []


def test_compiling_for_a_gpu_is_heard_of() -> None:
    """Oracle: the kernel's own name; numba-cuda warns of nothing that users cannot change."""
    if _obstacle():
        pytest.skip(_obstacle())
    from numba.cuda.core import config

    from usdsplat.kernels.cuda.device import _clear

    heard: list[str] = []
    with paper.compiling(), on_compile(heard.append), compile_time() as taken:
        _clear[1, 1](np.zeros(3, np.int16))
    assert "_clear" in heard
    assert taken() > 0
    assert config.CUDA_LOW_OCCUPANCY_WARNINGS == 0


@pytest.mark.parametrize(
    ("name", "types"), [pytest.param(n, t, id=n) for n, t in launches() if n not in ON_THE_CPU]
)
def test_a_kernel_compiles(name: str, types: list[str]) -> None:
    """Oracle: NVIDIA's NVVM, for an H100's kind, with what tests have launched it with."""
    if _obstacle():
        pytest.skip(_obstacle())
    with paper.compiling() as made:
        paper.device().run(kernel_of(name), *map(example, types))
    assert made and all(".entry" in code for code in made.values())
