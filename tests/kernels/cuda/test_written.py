"""What kernels may write."""

from __future__ import annotations

import inspect

import pytest

from usdsplat.kernels.cuda.written import EVERYONE, written

from . import derivable
from .launches import kernel_of


def names_of(kernel) -> set[str]:
    """Of the arguments that it may write."""
    names = list(inspect.signature(kernel.py_func).parameters)
    return {names[k] for k in written(kernel)}


def test_writes_through_calls_parts_and_tuples_are_seen() -> None:
    """Oracle: the loop, read by eye."""
    assert names_of(derivable.by_others) == {"rows", "parts", "out"}


@pytest.mark.parametrize(
    ("kernel", "changed"),
    [
        ("sim.reaction.gray_scott", {"out"}),
        ("sim.settle.settle", {"speeds", "positions", "velocities", "since"}),
        ("sim.contact.contact", {"positions", "velocities", "since", "near", "counts"}),
        ("sim.nearest.plant", {"points", "index", "boxes"}),
        ("sim.bvh.find_closest", {"out"}),
    ],
)
def test_what_kernels_say_that_they_write(kernel: str, changed: set[str]) -> None:
    """Oracle: their docstrings."""
    assert names_of(kernel_of(kernel)) == changed


def test_of_what_has_no_source_the_worst_is_assumed() -> None:
    """Oracle: the contract."""
    assert written(len) == EVERYONE
