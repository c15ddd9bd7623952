"""Tests that kernels are valid for CUDA with the types with which they are launched."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from usdsplat.kernels import ahead, normals, signatures, sim, store, thinning
from usdsplat.kernels.compiling import compile_time, on_compile
from usdsplat.kernels.cuda.device import form_of
from usdsplat.kernels.launch import Kernel

from . import paper
from .launches import kernel_of, name_of, source_of

CAPABILITIES = ((8, 0), (9, 0))
"""A GPU of 2020, and one of those that have instructions of their own."""
ON_THE_CPU = {
    "normals.density.deposit": "one thread for each grid, because sums depend on their order",
    "sim.bvh.build_order": "a tree is built top down, once for a mesh",
    "sim.bvh.fit_boxes": "from the leaves up, after it",
    "sim.carriers.throw": "darts land after others, once for a simulation",
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
    found = {}
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        members = vars(importlib.import_module(module.name)).values()
        for each in members:
            is_loop = isinstance(each, Kernel) or getattr(each, "targetoptions", {}).get("parallel")
            if is_loop and source_of(each).__module__ == module.name:
                found[name_of(each)] = each
    return found


KERNELS = _kernels(sim) | _kernels(thinning) | _kernels(normals)


def test_the_table_has_every_kernel() -> None:
    """Oracle: the loops for all threads that the folders have, and those of `cuda` itself."""
    assert set(KERNELS) <= {name for name, _ in signatures.table("cpu")}
    named = {name for name, _ in signatures.table("cuda")}
    assert set(KERNELS) - set(ON_THE_CPU) <= named | _written_for_a_gpu()
    missing = paper.obstacle()
    if missing is None:
        from usdsplat.kernels.cuda import jit

        for module in pkgutil.walk_packages(
            importlib.import_module("usdsplat.kernels.cuda").__path__, "usdsplat.kernels.cuda."
        ):
            importlib.import_module(module.name)
        assert {name for name in jit.KERNELS if name.startswith("cuda.")} <= named


def _written_for_a_gpu() -> set[str]:
    """Kernels of the CPU with a form of their own for a GPU, whose kernels have other names."""
    return {name for name, each in KERNELS.items() if not isinstance(each, Kernel) and each.gpu}


def test_the_cpu_runs_only_what_it_is_said_to() -> None:
    """Oracle: the list, with a reason for each: no kernel falls back unseen."""
    assert {name for name in KERNELS if form_of(kernel_of(name)) is None} <= set(ON_THE_CPU)
    assert [n for n in ON_THE_CPU if form_of(kernel_of(n)) is not None] == []


def test_compiling_for_a_gpu_is_heard_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the kernel's own name; numba-cuda warns of nothing that users cannot change."""
    paper.require()
    monkeypatch.setattr(store, "load", lambda key: None)  # nothing was compiled before
    from numba.cuda.core import config

    from usdsplat.kernels.cuda.sim.lists import _clear

    heard: list[str] = []
    with paper.compiling(), on_compile(heard.append), compile_time() as taken:
        _clear[1, 1](np.zeros(3, np.int16))
    assert "_clear" in heard
    assert taken() > 0
    assert config.CUDA_LOW_OCCUPANCY_WARNINGS == 0


@pytest.mark.parametrize("capability", CAPABILITIES, ids=lambda c: f"sm_{c[0]}{c[1]}")
@pytest.mark.parametrize(
    ("name", "types"),
    [pytest.param(*line, id=f"{k}-{line[0]}") for k, line in enumerate(signatures.table("cuda"))],
)
def test_a_kernel_is_assembled(name: str, types: str, capability: tuple[int, int]) -> None:
    """To machine code, for GPUs that are not here. Oracle: NVIDIA's compiler and assembler; a
    second process would find it."""
    paper.require()
    from usdsplat.kernels.cuda import jit

    ahead.compile_task(ahead.Task(device="cuda", capability=capability, name=name, types=types))
    key = jit.KERNELS[name]._cache.key(signatures.decode(types), capability)
    kept = store.load(key)
    assert kept is not None and b"\x7fELF" in kept, store.refusal()
    assert re.search(rb"nvptx|\.version \d", kept) is None, "its source is kept too"


@pytest.mark.parametrize("instruction", ["llvm.prefetch.p0i8"])
def test_what_cannot_be_assembled_is_an_error(instruction: str) -> None:
    """Oracle: the instruction that once broke every picture: NVVM takes it, no GPU knows it."""
    paper.require()
    from llvmlite import ir
    from numba import cuda
    from numba.cuda import types
    from numba.cuda.extending import intrinsic

    from usdsplat.kernels.cuda import jit

    @intrinsic
    def prefetch(typing: Any, array: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            from numba.core import cgutils

            byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
            function = cgutils.get_or_insert_function(builder.module, kind, instruction)
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            builder.call(function, [builder.bitcast(data, byte), number(0), number(3), number(1)])
            return context.get_dummy_value()

        return types.void(array), emit

    @cuda.jit
    def broken(out):
        prefetch(out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(jit.KERNELS, "broken", broken)
        patch.setattr(broken, "_cache", jit.KernelCache("broken", (), ""))
        with pytest.raises(Exception, match=r"prefetch|PTX|JitLink|assemble"):
            jit.assemble("broken", signatures.decode("f4:1C"), (9, 0))
