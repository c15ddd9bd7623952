"""Tests of the histograms of a report."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.products.report.charts import BARS, histogram
from usdsplat.products.report.values import round_down


def test_bars_count_what_they_say() -> None:
    """Oracle: NumPy, and numbers that were laid out by hand."""
    even = histogram("a", np.linspace(0, 1, 60_001), limits=(0.0, 1.0))
    assert even.counts.sum() == 60_001 and abs(even.counts - 1000).max() <= 1
    powers = histogram("b", 10.0 ** np.linspace(-3, 1, 4001), logarithmic=True)
    assert powers.counts.sum() == 4001 and len(powers.counts) == BARS
    assert powers.median == pytest.approx(0.1)
    odd = histogram("c", np.array([0.0, np.nan, np.inf, -1, 2, 2]), logarithmic=True)
    assert (odd.counts.sum(), odd.beyond, odd.median) == (2, 4, 2)
    assert histogram("d", np.array([0.0]), logarithmic=True) is None
    same = histogram("e", np.full(9, 3.0))
    assert same.counts.sum() == 9 and same.edges[0] < 3 < same.edges[-1]
    outlier = histogram("f", np.append(np.linspace(0, 1, 9999), 1e9))
    assert outlier.edges[-1] < 1.1 and outlier.counts.sum() == 10_000


def test_round_numbers() -> None:
    """Oracle: by hand."""
    assert [round_down(x) for x in (1, 1.9, 2, 4.99, 5, 0.03)] == [1, 1, 2, 2, 5, 0.02]
