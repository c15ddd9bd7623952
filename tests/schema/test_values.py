"""Tests of attribute values as NumPy arrays."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core.errors import StageError
from usdsplat.schema.values import integers, vectors


def test_numbers_that_do_not_fit_are_refused() -> None:
    """Numbers that do not fit 32 bits are refused, neither infinite nor other ones without a word.
    Oracle: the sentence."""
    with pytest.raises(StageError, match="points: found numbers that are not finite"):
        vectors("points", np.full((2, 3), 1e300), 3)
    with pytest.raises(StageError, match="counts: found the number 4294967299"):
        integers("counts", np.array([3, (1 << 32) + 3]))
