"""Tests that compilation is reported while it lasts, from any thread."""

from __future__ import annotations

import threading

import numba
import pytest

from usdsplat.preview.compiling import COMPILING, telling
from usdsplat.preview.values import Busy

OVER = Busy(what="")


def fresh():
    """A function that nobody has compiled yet."""
    return numba.njit(lambda x: x + 1)


def test_compiling_is_told_once_and_its_end_too():
    """Oracle: two functions are compiled, one after the other."""
    told = []
    with telling(told.append):
        fresh()(1)
        fresh()(2)
        assert told == [COMPILING]
    assert told == [COMPILING, OVER]


def test_an_end_may_be_told_before_the_work_is_over():
    """Oracle: what is compiled after it is told anew."""
    told = []
    with telling(told.append) as over:
        fresh()(1)
        over()
        over()
        fresh()(1)
    assert told == [COMPILING, OVER, COMPILING, OVER]


def test_nothing_is_told_of_what_was_compiled_before_or_by_others():
    """Oracle: a function that is known already, and a thread of somebody else's."""
    known, other = fresh(), fresh()
    known(1)
    told = []
    with telling(told.append):
        known(2)
        thread = threading.Thread(target=lambda: other(1))
        thread.start()
        thread.join()
    assert told == []


def test_a_failure_ends_it():
    """Oracle: the error goes on, and nobody is left waiting."""
    told = []
    with pytest.raises(ZeroDivisionError), telling(told.append):
        fresh()(1)
        raise ZeroDivisionError
    assert told == [COMPILING, OVER]
