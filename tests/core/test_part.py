"""Tests of parts of some work."""

from __future__ import annotations

from itertools import chain

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.core.part import Part


@pytest.mark.parametrize("total", [0, 1, 5, 6, 100])
@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_parts_share_all_things_evenly_and_in_order(total, count):
    """Oracle: the numbers; lengths differ by one at most."""
    shares = [Part(number, count).of(total) for number in range(1, count + 1)]
    assert list(chain(*shares)) == list(range(total))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


@pytest.mark.parametrize("text", ["", "1", "0/2", "3/2", "1/0", "a/b", "1/2/3"])
def test_other_texts_are_no_part(text):
    """Oracle: the sentence; a part is written as it was read."""
    with pytest.raises(UsageError, match=r"--part: found .*, expected K/N"):
        Part.parse(text)
    assert str(Part.parse("2/3")) == "2/3"
