"""Tests of numbers in sentences."""

from __future__ import annotations

from usdsplat.core.wording import said_bytes


def test_sizes_are_said_with_a_digit_that_matters():
    """Oracle: by hand."""
    assert said_bytes(2.5 * 2**30) == "2.50 GiB"
    assert said_bytes(300 * 2**20) == "300 MiB"
    assert said_bytes(0.25 * 2**20) == "0.2 MiB"
