"""Tests of tables of 256 numbers. Oracles: closed forms, and conditions of optimal tables."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.formats.sog import codebook


@pytest.mark.parametrize("kinds", [1, 2, 255, 256])
def test_few_kinds_of_numbers_are_kept_exactly(kinds):
    """Oracle: as many kinds as entries need no rounding."""
    rng = np.random.default_rng(0)
    some = rng.normal(size=kinds).astype(np.float32)
    values = rng.permutation(np.tile(some, 5)).reshape(kinds, 5)
    table = codebook.codebook(values)
    assert table.shape == (256,) and np.all(np.diff(table) >= 0)
    np.testing.assert_array_equal(table[codebook.encode(values, table)], values)


def test_evenly_spread_numbers_get_an_even_table():
    """Oracle: a quantiser of a uniform spread errs by its step / sqrt(12)."""
    values = np.random.default_rng(0).uniform(-3, 5, 200_000)
    table = codebook.codebook(values)
    error = table[codebook.encode(values, table)] - values
    assert np.sqrt(np.mean(error**2)) == pytest.approx(8 / 256 / np.sqrt(12), rel=0.02)


def test_bell_shaped_numbers_err_as_theory_says():
    """Oracle: Panter & Dite 1951: a normal spread of deviation 1 errs by sqrt(sqrt(3) pi / 2) / 256
    at best."""
    values = np.random.default_rng(0).normal(size=300_000)
    table = codebook.codebook(values)
    error = table[codebook.encode(values, table)] - values
    assert np.sqrt(np.mean(error**2)) < 1.05 * np.sqrt(np.sqrt(3) * np.pi / 2) / 256


def test_far_numbers_do_not_take_the_table_from_the_others():
    """Oracle: two entries for the two of them, the rest for a uniform spread."""
    values = np.random.default_rng(0).uniform(0, 1, 100_000)
    values[:2] = 1e9, -1e12
    table = codebook.codebook(values)
    error = table[codebook.encode(values, table)] - values
    assert error[0] == error[1] == 0
    assert np.sqrt(np.mean(error[2:] ** 2)) < 1.05 / 254 / np.sqrt(12)


def test_a_code_is_that_of_the_nearest_number():
    """Oracle: all distances."""
    rng = np.random.default_rng(0)
    table = np.sort(rng.normal(size=256))
    values = rng.normal(size=(300, 3))
    nearest = np.abs(values[..., None] - table).argmin(axis=-1)
    np.testing.assert_array_equal(codebook.encode(values, table), nearest)


def test_no_numbers_have_a_table_too():
    """Oracle: a file of no splats is a file."""
    table = codebook.codebook(np.empty((0, 3)))
    assert table.tolist() == [0] * 256
    assert codebook.encode(np.empty((0, 3)), table).shape == (0, 3)
