"""Tests that exact kernels are not contracted on a GPU."""

from __future__ import annotations

import re
import struct

import pytest

from usdsplat.kernels import ahead, signatures

from . import paper

EXACT = (
    "cuda.frame.project.see(load_floats)", "cuda.frame.project.see(load_packed)",
    "cuda.frame.project.see(load_floats,nodes)", "cuda.frame.project.place(shade_floats,nodes)",
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


FUSED = {base + form for base in (0x023, 0x02B) for form in (0x200, 0x400, 0x600, 0x800, 0xA00)}
"""Opcodes FFMA and DFMA of compute capability 9.0, the low 12 bits of an instruction's 16 bytes."""


def opcodes(elf: bytes) -> set[int]:
    """Those of all instructions of a file of machine code (ELF, little endian, 64 bits)."""
    (table,), (size, count, names) = (
        struct.unpack_from("<Q", elf, 0x28),
        struct.unpack_from("<HHH", elf, 0x3A),
    )
    headers = [struct.unpack_from("<IIQQQQ", elf, table + size * k) for k in range(count)]
    found = set()
    for name, _, _, _, first, length in headers:
        if elf.startswith(b".text", headers[names][4] + name):
            found |= {
                struct.unpack_from("<H", elf, at)[0] & 0xFFF
                for at in range(first, first + length, 16)
            }
    return found


def test_products_are_rounded_alone() -> None:
    """Oracle: NVIDIA's NVVM and assembler: of an exact kernel without library functions, no
    instruction multiplies and adds; a kernel that is not exact has such."""
    paper.require()
    from usdsplat.kernels.cuda import jit

    found = set(re.findall(r"\b(?:mul|fma)[.\w]*f32\b", ptx_of("sim.nearest.nearest")))
    assert found == {"mul.rn.f32"}
    for name, fuses in (("sim.nearest.nearest", False), ("sim.mls.gradients", True)):
        ahead._load_cuda_kernel(name)
        types = next(types for each, types in signatures.table("cuda") if each == name)
        code = jit.assemble(name, signatures.decode(types), paper.CAPABILITY)
        assert bool(opcodes(code) & FUSED) == fuses


@pytest.mark.parametrize("name", EXACT)
def test_nothing_is_left_to_be_contracted(name: str) -> None:
    """Oracle: NVIDIA's NVVM: the assembler contracts products and sums that do not say how they are
    rounded, and there are none; a kernel that is not exact has many."""
    paper.require()
    free = r"\b(?:mul|mad|add|sub)\.(?:ftz\.)?f(?:32|64)\b"
    assert re.findall(free, ptx_of(name)) == []
    assert re.findall(free, ptx_of("sim.mls.gradients")) != []
