"""JSON of any shape in, checked values out: what files say must not surprise their readers."""

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
        FormatError: If it is not JSON, or JSON of another kind.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(where, "text that is not JSON", "a JSON object") from error
    return an_object(where, value)


def an_object(where: str, value: Any) -> Mapping[str, Any]:
    """`value`, if it is an object.

    Raises:
        FormatError: If it is not.
    """
    if not isinstance(value, dict):
        raise FormatError(where, show(value), "a JSON object")
    return value


def a_list(where: str, value: Any) -> list[Any]:
    """`value`, if it is a list.

    Raises:
        FormatError: If it is not.
    """
    if not isinstance(value, list):
        raise FormatError(where, show(value), "a list")
    return value


def whole(where: str, value: Any, least: int, most: int) -> int:
    """`value`, if it is a whole number in a range.

    Raises:
        FormatError: If it is not.
    """
    if type(value) is not int or not least <= value <= most:
        raise FormatError(where, show(value), f"a whole number from {least} to {most}")
    return value


def numbers(where: str, value: Any, length: int, *, largest: float) -> F64:
    """`value`, if it is a list of `length` numbers of at most that magnitude.

    Raises:
        FormatError: If it is not.
    """
    items = a_list(where, value)
    if len(items) != length:
        raise FormatError(where, f"{len(items)} values", f"{length} numbers")
    for item in items:
        # False for NaN; whole numbers of JSON may be of any size.
        if type(item) not in (int, float) or not abs(item) <= largest:
            raise FormatError(where, show(item), f"a number of at most {largest:g}")
    return np.array(items, np.float64)


def show(value: Any) -> str:
    """A value of JSON as it may stand in a sentence."""
    text = reprlib.repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
