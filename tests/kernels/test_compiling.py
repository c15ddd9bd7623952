"""Tests of compile messages."""

from __future__ import annotations

import threading
import time

import numba
import pytest

from usdsplat.kernels.compiling import compile_time, compiled, on_compile


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


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled without the compiler")
def test_what_another_thread_compiles_is_its_own_business():
    """Oracle: two windows, of which one compiles, and only that one hears of it."""

    @numba.njit
    def tripled(x):
        return 3 * x

    here, there = [], []

    def compiles():
        with on_compile(there.append):
            tripled(1)

    with on_compile(here.append):
        thread = threading.Thread(target=compiles)
        thread.start()
        thread.join()
    assert (here, there) == ([], ["tripled"])


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled without the compiler")
def test_time_is_counted_while_compiling_only():
    """Oracle: 0 before, more after a compilation and within the wall time, the same after a call
    that compiles nothing."""

    @numba.njit
    def halved(x):
        return x / 2

    start = time.perf_counter()
    with compile_time() as compiled:
        assert compiled() == 0
        halved(1.0)
        taken = compiled()
        assert 0 < taken < time.perf_counter() - start
        halved(2.0)
        assert compiled() == taken


def test_what_is_said_to_be_compiled_is_heard_of_too():
    """Oracle: the name that is told, and the wall time around a context that lasts."""
    heard = []
    start = time.perf_counter()
    with on_compile(heard.append), compile_time() as taken:
        assert taken() == 0
        with compiled("sorting"):
            assert heard == ["sorting"]
            time.sleep(0.01)
        assert 0.01 <= taken() < time.perf_counter() - start
    with compiled("nobody listens"):
        pass
    assert heard == ["sorting"]
