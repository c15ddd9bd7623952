"""Tests of knobs. Oracle of all: the declaration of the dataclass below."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import checked, knob, knobs


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One knob of every kind."""

    tile: int = knob(16, "edge of a tile", unit="pixel", range=(1, 64), usd_type="uchar")
    cutoff: float = knob(0.5, "weakest contribution", range=(0.0, math.inf))
    above: float = knob(0.0, "at most zero", range=(-math.inf, 0.0))
    crop: tuple[float, float] | None = knob(None, "crop window", range=(0.0, 1.0))
    names: tuple[str, ...] = knob((), "prims to draw")
    quick: bool = knob(False, "fewer samples")
    mode: Literal["a", "b"] = knob("a", "which way")
    device: str = knob("auto", "where to run", choices=("auto", "cpu"))
    gain: float = knob(1.0, "multiplier")
    scratch: list[int] = field(default_factory=list)


def test_knobs_are_the_declared_fields_in_order() -> None:
    """Names, types, defaults, help, units, ranges and choices come out as declared."""
    listed = {item.name: item for item in knobs(Settings)}
    assert list(listed) == [
        "tile", "cutoff", "above", "crop", "names", "quick", "mode", "device", "gain",
    ]  # fmt: skip
    tile = listed["tile"]
    assert (tile.type, tile.default, tile.text) == (int, 16, "edge of a tile")
    assert (tile.unit, tile.range, tile.usd_type) == ("pixel", (1, 64), "uchar")
    assert listed["mode"].choices == ("a", "b")
    assert listed["device"].choices == ("auto", "cpu")
    assert listed["quick"].choices is None
    assert Settings().tile == 16


def test_legal_values_arrive_with_the_declared_type() -> None:
    """Whole numbers become real ones, sequences tuples, NumPy's numbers Python's."""
    made = checked(
        "here",
        Settings,
        {
            "tile": np.int64(8),
            "cutoff": 1,
            "crop": np.array([0.0, 1.0], np.float32),
            "names": ["/a", "/b"],
            "quick": True,
            "mode": "b",
            "device": "cpu",
        },
    )
    assert made.tile == 8 and type(made.tile) is int
    assert made.cutoff == 1.0 and type(made.cutoff) is float
    assert made.crop == (0.0, 1.0)
    assert made.names == ("/a", "/b")
    assert (made.quick, made.mode, made.device, made.gain) == (True, "b", "cpu", 1.0)
    assert checked("here", Settings, {"crop": None}).crop is None
    assert checked("here", Settings, {}) == Settings()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("tile", 0, r"0, expected 1 to 64 \[pixel\]"),
        ("tile", 65, r"65, expected 1 to 64 \[pixel\]"),
        ("tile", 1.5, r"1\.5, expected 1 to 64"),
        ("tile", True, "True, expected 1 to 64"),
        ("tile", "8", "'8', expected 1 to 64"),
        ("cutoff", -1e-9, "expected 0 or more"),
        ("cutoff", math.nan, "nan, expected 0 or more"),
        ("above", 1.0, "expected 0 or less"),
        ("gain", math.nan, "nan, expected float"),
        ("gain", True, "True, expected float"),
        ("gain", None, "None, expected float"),
        ("crop", (0.0, 2.0), "expected 0 to 1"),
        ("crop", (0.0,), "expected 0 to 1"),
        ("crop", 3, "3, expected 0 to 1"),
        ("names", "/a", "'/a', expected tuple"),
        ("names", [1], "expected tuple"),
        ("quick", 1, "1, expected bool"),
        ("mode", "c", "'c', expected one of a, b"),
        ("device", "gpu", "'gpu', expected one of auto, cpu"),
    ],
)
def test_other_values_are_refused_in_one_sentence(name: str, value: Any, expected: str) -> None:
    """The sentence names the place, the knob, the value and what is legal."""
    with pytest.raises(UsageError, match=rf"^/Render {name}: found .*{expected}"):
        checked("/Render", Settings, {name: value})


def test_an_unknown_name_is_refused_with_the_list_of_knobs() -> None:
    """Fields that are no knobs cannot be set either."""
    for name in ("tiles", "scratch"):
        with pytest.raises(
            UsageError, match=f"unknown setting '{name}', expected one of tile, cut"
        ):
            checked("/Render", Settings, {name: 1})
