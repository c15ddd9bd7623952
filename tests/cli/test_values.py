"""Tests of parsing values of options."""

from __future__ import annotations

import pytest

from usdsplat.cli.values import bytes_of, crop_of, names_of, overscan_of
from usdsplat.core.errors import UsageError


@pytest.mark.parametrize(
    ("text", "size"),
    [("800M", 800 * 2**20), ("6G", 6 * 2**30), ("1.5k", 1536), ("123", 123), ("2 GiB", 2**31)],
)
def test_bytes_have_binary_suffixes(text, size):
    """Oracle: powers of 1024 by hand."""
    assert bytes_of(text) == size


@pytest.mark.parametrize("text", ["", "G", "-1G", "0", "6X", "nan", "1e9"])
def test_other_bytes_are_refused(text):
    """Oracle: an error that names the option."""
    with pytest.raises(UsageError, match=r"^--memory-limit: found .*, expected bytes such as"):
        bytes_of(text)


def test_overscan_is_told_for_all_sides_for_pairs_or_for_each():
    """Oracle: left, top, right, bottom by hand."""
    assert overscan_of("8") == (8, 8, 8, 8)
    assert overscan_of("8,4") == (8, 4, 8, 4)
    assert overscan_of("1, 2, 3, 4") == (1, 2, 3, 4)


@pytest.mark.parametrize("text", ["", "x", "-1", "1,2,3", "1.5", "99999"])
def test_other_overscan_is_refused(text):
    """Oracle: an error that names the option."""
    with pytest.raises(UsageError, match=r"^--overscan: found .*, expected 1, 2 or 4 whole"):
        overscan_of(text)


def test_a_crop_is_four_pixels():
    """Oracle: the numbers as they are typed; they may lie outside."""
    assert crop_of("-4,0,20,12") == (-4, 0, 20, 12)


@pytest.mark.parametrize("text", ["1,2,3", "4,0,4,9", "0,9,4,8", "a,b,c,d"])
def test_a_crop_without_area_is_refused(text):
    """Oracle: an error that names the option."""
    with pytest.raises(UsageError, match=r"^--crop: found .*, expected four whole numbers"):
        crop_of(text)


def test_what_is_not_given_is_no_opinion():
    """Oracle: None."""
    assert [read(None) for read in (bytes_of, crop_of, overscan_of, names_of)] == [None] * 4
