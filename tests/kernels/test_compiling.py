"""Hearing of compilation."""

from __future__ import annotations

import numba
import pytest

from usdsplat.kernels.compiling import on_compile


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled without the compiler")
def test_each_compilation_is_heard_of_once():
    """Oracle: Numba compiles a function for each new signature, and never again for the same."""

    @numba.njit
    def doubled(x):
        return x + x

    heard = []
    with on_compile(heard.append):
        assert doubled(1) == 2
        assert doubled(2) == 4
        assert heard == ["doubled"]
        assert doubled(1.5) == 3.0
    assert heard == ["doubled", "doubled"]
    assert doubled(1j) == 2j
    assert heard == ["doubled", "doubled"]
