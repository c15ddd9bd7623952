"""Tests of parsing edits."""

from __future__ import annotations

import pytest

from usdsplat.core.edits import KINDS, Edit, parsed
from usdsplat.core.errors import UsageError


@pytest.mark.parametrize(
    ("name", "text", "values"),
    [
        ("translate", "1,-2,3e-1", (1, -2, 0.3)),
        ("rotate", "0, 90 ,0", (0, 90, 0)),
        ("scale", "0.01", (0.01,)),
        ("crop-box", "-1,-1,-1,1,1,1", (-1, -1, -1, 1, 1, 1)),
        ("crop-sphere", "0,0,0,0", (0, 0, 0, 0)),
        ("sh-degree", "4", (4,)),
        ("drop-outliers", "8,1.5", (8, 1.5)),
        ("decimate", "5000", (5000,)),
        ("decimate", "12.5%", (0.125,)),
        ("morton", "", ()),
    ],
)
def test_what_is_typed_becomes_an_edit_that_says_itself_again(name, text, values) -> None:
    """Oracle: the numbers; and the edit's own words, parsed again."""
    found = parsed(name, text)
    assert found.values == pytest.approx(values)
    said = str(found).partition(" ")
    assert parsed(said[0], said[2]) == found


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("translate", "1,2"),
        ("translate", "a,b,c"),
        ("translate", "nan,0,0"),
        ("translate", "inf,0,0"),
        ("rotate", ""),
        ("rotate", ",,"),
        ("scale", "0"),
        ("scale", "-1"),
        ("crop-box", "0,0,0,1,-1,1"),
        ("crop-sphere", "0,0,0,-1"),
        ("min-opacity", "1.5"),
        ("max-opacity", "-0.1"),
        ("min-size", "-1"),
        ("max-size", "-1"),
        ("sh-degree", "5"),
        ("sh-degree", "1.5"),
        ("drop-outliers", "0,2"),
        ("drop-outliers", "20"),
        ("drop-outliers", "20,-1"),
        ("decimate", "0"),
        ("decimate", "1.5"),
        ("decimate", "many%"),
        ("scale", "50%"),
        ("drop-nan", "1"),
        ("morton", "1"),
    ],
)
def test_other_numbers_are_refused_in_a_sentence(name, text) -> None:
    """Oracle: the kind's own words for what it takes."""
    with pytest.raises(UsageError) as caught:
        parsed(name, text)
    assert str(caught.value).startswith(f"edit {name}: found ")
    assert str(caught.value).endswith(f"expected {KINDS[name].expected or 'no number'}")


@pytest.mark.parametrize("text", ["0%", "100%", "-5%", "nan%"])
def test_a_share_is_between_nothing_and_all(text) -> None:
    """Oracle: the sentence."""
    with pytest.raises(UsageError, match="expected more than 0 % and less than 100 %"):
        parsed("decimate", text)


def test_an_edit_that_does_not_exist_is_refused() -> None:
    """Oracle: the list of those that do."""
    with pytest.raises(
        UsageError, match=r"^edit: found 'shear', expected one of translate, rotate"
    ):
        Edit(name="shear", values=(1,))
