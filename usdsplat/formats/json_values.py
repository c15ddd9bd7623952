"""Parse untrusted JSON into checked values."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.errors import FormatError


def parse_object(where: str, text: bytes) -> Mapping[str, Any]:
    """Parse a JSON object; the caller has bounded the length of `text`.

    Raises:
        FormatError: If it is not JSON, or not an object.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(where, "text that is not JSON", "a JSON object") from error
    return an_object(where, value)


def an_object(where: str, value: Any) -> Mapping[str, Any]:
    """Return `value` if it is an object.

    Raises:
        FormatError: If it is not.
    """
    if not isinstance(value, dict):
        raise FormatError(where, show(value), "a JSON object")
    return value


def a_list(where: str, value: Any) -> list[Any]:
    """Return `value` if it is a list.

    Raises:
        FormatError: If it is not.
    """
    if not isinstance(value, list):
        raise FormatError(where, show(value), "a list")
    return value


def whole(where: str, value: Any, least: int, most: int) -> int:
    """Return `value` if it is a whole number in a range.

    Raises:
        FormatError: If it is not.
    """
    if type(value) is not int or not least <= value <= most:
        raise FormatError(where, show(value), f"a whole number from {least} to {most}")
    return value


def numbers(where: str, value: Any, length: int, *, largest: float) -> F64:
    """Return `value` as an array if it is `length` numbers of at most that magnitude.

    Raises:
        FormatError: If it is not.
    """
    return np.array(number_list(where, value, length, largest=largest), np.float64)


def number_list(where: str, value: Any, length: int, *, largest: float) -> list[float]:
    """Return `value` if it is a list of `length` numbers of at most that magnitude.

    Raises:
        FormatError: If it is not.
    """
    items = a_list(where, value)
    if len(items) != length:
        raise FormatError(where, f"{len(items)} values", f"{length} numbers")
    for item in items:
        # NaN fails the comparison; integers in JSON may have any size.
        if type(item) not in (int, float) or not abs(item) <= largest:
            raise FormatError(where, show(item), f"a number of at most {largest:g}")
    return items


def show(value: Any) -> str:
    """Return a JSON value, shortened for an error message."""
    text = reprlib.repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
