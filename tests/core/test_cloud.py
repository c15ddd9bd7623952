"""Tests of the checks of `SplatCloud`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from usdsplat.core.cloud import SplatCloud


def arrays(n: int = 2, count: int = 4) -> dict[str, Any]:
    """Arguments of a legal cloud."""
    return {
        "positions": np.zeros((n, 3), np.float32),
        "scales": np.ones((n, 3), np.float32),
        "rotations": np.zeros((n, 4), np.float32),
        "opacities": np.ones(n, np.float32),
        "sh": np.zeros((n, count, 3), np.float32),
    }


@pytest.mark.parametrize(("count", "degree"), [(1, 0), (4, 1), (9, 2), (16, 3), (25, 4)])
def test_length_and_degree_follow_from_the_arrays(count: int, degree: int) -> None:
    """Oracle: (degree + 1)^2 coefficients."""
    cloud = SplatCloud(**arrays(3, count))
    assert (len(cloud), cloud.sh_degree) == (3, degree)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("positions", np.zeros((2, 3))),
        ("scales", np.ones((3, 3), np.float32)),
        ("rotations", np.zeros((2, 3), np.float32)),
        ("opacities", np.ones((2, 1), np.float32)),
        ("sh", np.zeros((2, 5, 3), np.float32)),
        ("sh", np.zeros((2, 12), np.float32)),
        ("ids", np.zeros(2, np.int32)),
        ("velocities", np.zeros((2, 2), np.float32)),
    ],
)
def test_a_wrong_shape_or_dtype_is_refused_by_name(name: str, array: np.ndarray) -> None:
    """Oracle: the shapes and dtypes in the docstrings of the fields."""
    with pytest.raises(ValueError, match=rf"^SplatCloud\.{name}: found .*, expected"):
        SplatCloud(**(arrays() | {name: array}))
