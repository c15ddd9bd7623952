"""Tests of argument types as text."""

from __future__ import annotations

import numpy as np
import pytest
from numba import typeof

from usdsplat.kernels import signatures
from usdsplat.kernels.bins import grid_of


def unwritable(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3, "int64"),
        (np.float32(1), "float32"),
        (True, "bool"),
        (np.zeros((2, 3), np.float32), "f4:2C"),
        (unwritable(np.zeros(2, np.int32)), "i4:1Cr"),
        (np.zeros((4, 4), np.uint8)[::2, ::2], "u1:2A"),
        (np.asfortranarray(np.zeros((2, 3))), "f8:2F"),
        (grid_of(0, 0, 2, 2), "<bins.GRID>:1C"),
        ((1, (2.0, np.zeros(1, np.bool_))), "(int64,(float64,b1:1C))"),
        ((1, 2, 3), "(int64,int64,int64)"),
    ],
)
def test_types_go_to_text_and_back(value, text):
    """Oracle: Numba's own type of each value."""
    types = (typeof(value), typeof(1.5))
    assert signatures.encode(types) == f"{text} float64"
    assert signatures.decode(f"{text} float64") == types


@pytest.mark.parametrize("device", signatures.TABLES)
def test_every_line_of_a_table_can_be_read(device):
    """Oracle: the text itself, read and written again."""
    lines = signatures.table(device)
    assert len(lines) == len(set(lines)) > 100
    for _, types in lines:
        assert signatures.encode(signatures.decode(types)) == types
