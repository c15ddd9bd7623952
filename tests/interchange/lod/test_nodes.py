"""Tests of the making of nodes."""

from __future__ import annotations

import numpy as np

from usdsplat.interchange.lod.nodes import chunk_numbers
from usdsplat.interchange.lod.partition import Branch, Span


def leaf(count=1):
    """A leaf of some splats."""
    span = Span(first=np.array([0]), last=np.array([count]), low=0, high=1)
    return Branch(span=span)


def inner(*children):
    """A node."""
    return Branch(span=leaf().span, children=children)


def test_chunks_are_numbered_breadth_first():
    """Oracle: closed form: the root, its two inner children, then theirs."""
    low = inner(leaf(), leaf())
    left, right = inner(leaf(), low), inner(leaf(), leaf())
    root = inner(left, leaf(), right)
    numbers = chunk_numbers(root)
    assert [numbers[id(node)] for node in (root, left, right, low)] == [1, 2, 3, 4]
    assert len(numbers) == 4
