"""Tests that everything the delegate launches can be assembled for CUDA with its actual types, and
is in the table of launches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.render.everything import CASES, DEEP, drawn, drawn_deep
from usdsplat.kernels.cuda.device import form_of
from usdsplat.kernels.device import CpuDevice

from . import paper
from .launches import name_of

SIZE, SPLATS = (40, 34), 40


class Drawing(CpuDevice):
    """The CPU, which draws, and a GPU on paper, for which all that it runs is compiled."""

    def __init__(self) -> None:
        super().__init__()
        self._paper = paper.device()
        self._paper.keep = np.array
        self._paper._lent = {}
        self.on_the_cpu: set[str] = set()

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` here, and compile it for there."""
        if form_of(kernel) is None:
            self.on_the_cpu.add(name_of(kernel))
        else:
            self._paper.run(kernel, *map(_blank, args))
        return super().run(kernel, *args)


def _blank(value: Any) -> Any:
    """An argument of the same type; arrays hold zeros, but for records, and are made so."""
    if isinstance(value, tuple):
        return tuple(map(_blank, value))
    if isinstance(value, np.ndarray):
        return value.copy() if value.dtype.names else np.zeros(value.shape, value.dtype)
    return (lambda _, shape, dtype: np.zeros(shape, dtype)) if callable(value) else value


@pytest.fixture(scope="module")
def device() -> Iterator[Drawing]:
    """While it is there, launches are compiled."""
    paper.require()
    with paper.compiling() as made:
        yield Drawing()
    assert made and all(b"\x7fELF" in code for code in made.values())


@pytest.mark.parametrize("name", CASES)
def test_a_picture_compiles(device: Drawing, name: str) -> None:
    """Oracle: NVIDIA's assembler; and no kernel falls back to the CPU."""
    drawn(device, CASES[name], size=SIZE, splats=SPLATS)
    assert not device.on_the_cpu


@pytest.mark.parametrize("name", DEEP)
def test_a_deep_picture_compiles(device: Drawing, name: str) -> None:
    """Oracle: NVIDIA's assembler; and no kernel falls back to the CPU."""
    drawn_deep(device, CASES[name], 0.01, size=SIZE, splats=SPLATS)
    assert not device.on_the_cpu
