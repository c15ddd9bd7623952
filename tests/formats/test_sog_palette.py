"""Tests of palettes. Oracles: plain k-means, and counting."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.formats.sog import palette


def silent(_done: int) -> None:
    pass


def nearest(rows, centres):
    """Oracle of a nearest centre: |c|^2 - 2 r.c, which is the squared distance but for |r|^2."""
    return ((centres**2).sum(axis=1) - 2 * rows.astype(np.float64) @ centres.T).argmin(axis=1)


def rms(rows, labels, table) -> float:
    return float(np.sqrt(np.mean((table[labels] - rows.reshape(len(rows), -1)) ** 2)))


@pytest.mark.parametrize(
    ("count", "size"),
    [(0, 0), (1, 1), (3, 2), (1000, 512), (1024, 1024), (131071, 65536), (10**7, 65536)],
)
def test_sizes_are_those_of_the_format(count, size):
    """Oracle: formats.md 2.5: min(64, 2^floor(log2(N / 1024))) * 1024."""
    assert palette.size_for(count) == size
    if count:
        assert size == min(64, 2.0 ** np.floor(np.log2(count / 1024))) * 1024


def test_rows_of_few_kinds_are_kept_exactly():
    """Oracle: a palette that has room for every kind need not err."""
    rng = np.random.default_rng(0)
    kinds = rng.normal(size=(4, 3, 3)).astype(np.float32)
    rows = kinds[rng.integers(0, 4, 3000)]
    labels, table = palette.palette(rows, silent)
    assert len(table) <= 2048 and labels.dtype == np.uint16
    assert rms(rows, labels, table) < 1e-6


def test_two_levels_err_little_more_than_one():
    """Oracle: plain k-means with all centres, ten rounds, in float64."""
    rng = np.random.default_rng(0)
    rows = (rng.normal(size=(1500, 9)) * np.linspace(0.1, 1, 9)).astype(np.float32)
    labels, table = palette.palette(rows.reshape(1500, 3, 3), silent)
    centres = rows[rng.permutation(1500)[: len(table)]].astype(np.float64)
    for _ in range(10):
        near = nearest(rows, centres)
        for i in np.unique(near):
            centres[i] = rows[near == i].mean(axis=0)
    near = nearest(rows, centres)
    assert rms(rows, labels, table) < 1.15 * rms(rows, near, centres)


def test_every_row_is_told_of_and_runs_agree():
    """Oracle: the number of rows; a second run."""
    rows = np.random.default_rng(0).normal(size=(5000, 15, 3)).astype(np.float32)
    told: list[int] = []
    labels, table = palette.palette(rows, told.append)
    assert told == sorted(told) and told[-1] == 5000
    assert labels.max() < len(table) <= 4096
    again = palette.palette(rows, silent)
    np.testing.assert_array_equal(labels, again[0])
    np.testing.assert_array_equal(table, again[1])


@pytest.mark.parametrize("faint", [0.0, 1e-6], ids=["none", "hardly any"])
def test_rows_without_harmonics_leave_the_palette_to_the_others(faint):
    """Oracle: all but a few of the 1000 others have an entry of their own; with one for every
    second splat, as the palette's size is, half of them would err by 1."""
    rng = np.random.default_rng(0)
    rows = (rng.normal(size=(8000, 15, 3)) * faint).astype(np.float32)
    rows[::8] = rng.normal(size=(1000, 15, 3))
    labels, table = palette.palette(rows, silent)
    assert len(table) <= 4096
    assert rms(rows, labels, table) < 0.05


def test_groups_of_one_row_leave_the_palette_its_size():
    """Oracle: labels have 16 bits, however the rows are spread."""
    counts = np.array([10**6, 0, *[1] * 254])
    for errors in (counts.astype(float), np.ones(256), np.zeros(256)):
        shares = palette._shares(counts, errors, 1 << 16)
        assert shares.sum() == (1 << 16 if errors[0] else 255)
        assert (np.minimum(counts, 1) <= shares).all() and (shares <= counts).all()
