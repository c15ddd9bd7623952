"""Selection of seeds and test matrices: a few for `make test`, all for `make test-all`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def folded(values: Iterable[Any], keep: int = 1) -> list[Any]:
    """For `pytest.mark.parametrize`: the values, of which all but the first `keep` are slow."""
    return [
        value if k < keep else pytest.param(value, marks=pytest.mark.slow)
        for k, value in enumerate(values)
    ]


def folded_rows(rows: Iterable[tuple[Any, ...]], keep: int = 1) -> list[Any]:
    """The same of several arguments each."""
    return [
        row if k < keep else pytest.param(*row, marks=pytest.mark.slow)
        for k, row in enumerate(rows)
    ]
