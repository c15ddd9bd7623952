"""Tests of the logic of CUDA kernels without a GPU: run each module of `simulated`."""

from __future__ import annotations

from pathlib import Path

import pytest

from .simulator import ROOT, run_simulated

MODULES = sorted(
    path for path in (Path(__file__).parent / "simulated").glob("*.py") if path.stem != "__init__"
)

SLOW = ("simulation", "solving")
"""Of the simulation, which a GPU computes only where it is asked to."""


@pytest.mark.parametrize(
    "module",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in SLOW else ())
        for path in MODULES
    ],
)
def test_the_simulated_gpu_passes(module: Path) -> None:
    """Oracle: the tests of the module, in a process where Numba simulates."""
    pytest.importorskip("greenlet", reason="the simulated GPU needs greenlet")
    run_simulated(str(module.relative_to(ROOT)))
