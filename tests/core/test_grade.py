"""Tests of the valid values of a grade."""

from __future__ import annotations

import math
from typing import Any

import pytest

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.grade import Grade


def test_the_neutral_grade_is_in_range() -> None:
    """Oracle: no error."""
    Grade().check("grade ")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"temperature": 500.0}, "grade temperature: found 500, expected 1000 to 25000"),
        ({"tint": math.nan}, "grade tint: found nan, expected -0.05 to 0.05"),
        ({"saturation": -1.0}, "grade saturation: found -1, expected 0 to 1000"),
        ({"gain": (1.0, math.inf, 1.0)}, "grade gain: found inf, expected a finite number"),
        ({"matrix": (math.nan,) * 9}, "grade matrix: found nan, expected a finite number"),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(values: dict[str, Any], message: str) -> None:
    """Oracle: the sentence, as the ranges are documented."""
    with pytest.raises(UsageError) as caught:
        Grade(**values).check("grade ")
    assert str(caught.value) == message


def test_the_class_of_the_error_is_the_caller_s() -> None:
    """Oracle: the class that was asked for."""
    with pytest.raises(StageError):
        Grade(exposure=1e9).check("/Splats ", error=StageError)
