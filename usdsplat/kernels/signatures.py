"""Convert argument types to and from text, and read the tables of all launched kernels.

    int64 float32 bool      numbers
    f4:2C                   an array of float32 with two axes, contiguous; `A` any strides, `F`
    f4:2Cr                  the same, read-only
    <bins.GRID>:1C          an array of records
    (i4:1C,f4:2C)           a tuple

A table has one line for each kernel and each combination of argument types with which it is
launched. `usdsplat compile` compiles the tables.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

RECORDS = (
    "bins.GRID", "crop.CROP", "lighting.LIGHT", "position.VIEW", "project.CAMERA", "shade.MATERIAL",
    "texture.LEVEL", "triangles.APPEARANCE", "triangles.VIEW",
)  # fmt: skip
"""Record types of kernel arguments: module and name."""
HERE = "usdsplat.kernels"
TABLES = {"cpu": "launched.txt", "cuda": "cuda/launched.txt"}
"""Device -> file of its table, relative to this module."""


def table(device: str) -> list[tuple[str, str]]:
    """Return (kernel, argument types) of all kernels that a device launches."""
    return read(Path(__file__).parent / TABLES[device])


def read(path: Path) -> list[tuple[str, str]]:
    """Return (kernel, argument types) of each line of a file."""
    lines = path.read_text().splitlines()
    return [(name, types) for name, _, types in (line.partition(" ") for line in lines) if name]


def encode(types: Iterable[Any]) -> str:
    """Return Numba argument types as text."""
    return " ".join(map(_text, types))


def decode(text: str) -> tuple[Any, ...]:
    """Return the Numba types of a text that `encode` returned.

    Raises:
        ValueError: If `text` is not of that form.
    """
    return tuple(map(_type, _parts(text, " ")))


# --- private -------------------------------------------------------------------------------


def _text(given: Any) -> str:
    types: Any = _numba_types()
    if isinstance(given, types.Array):
        ends = ("" if given.mutable else "r") + ("" if given.aligned else "u")
        return f"{_item(given.dtype)}:{given.ndim}{given.layout}{ends}"
    if isinstance(given, types.BaseTuple):
        return f"({','.join(map(_text, given.types))})"
    return str(given)


def _item(given: Any) -> str:
    from numba.np.numpy_support import as_dtype

    dtype = as_dtype(given)
    if dtype.names is None:
        return str(dtype.str[1:])
    for name, record in _records().items():
        if record == dtype:
            return f"<{name}>"
    raise ValueError(f"record {dtype}: found none of {', '.join(RECORDS)}")


def _type(text: str) -> Any:
    from numba.np.numpy_support import from_dtype

    types: Any = _numba_types()
    if text.startswith("("):
        return types.Tuple([_type(each) for each in _parts(text[1:-1], ",")])
    item, colon, form = text.partition(":")
    if not colon:
        return getattr(types, "boolean" if text == "bool" else text)
    dtype = _records()[item[1:-1]] if item.startswith("<") else np.dtype(item)
    return types.Array(
        from_dtype(dtype), int(form[0]), form[1], readonly="r" in form[2:], aligned="u" not in form
    )


def _numba_types() -> Any:
    from numba.core import types

    return types


def _parts(text: str, between: str) -> Sequence[str]:
    """Split a text, but not within brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == between and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [each for each in parts if each]


@functools.cache
def _records() -> dict[str, np.dtype[Any]]:
    found = {}
    for name in RECORDS:
        module, _, record = name.rpartition(".")
        found[name] = getattr(importlib.import_module(f"{HERE}.{module}"), record)
    return found
