"""Names, parameters and parsed values of the edits of `convert`.

This module only describes edits; `interchange.editing` executes them. Lengths and positions are in
units of the capture, as `usdsplat info` prints them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from usdsplat.core.errors import UsageError

Numbers = tuple[float, ...]
Test = Callable[[Numbers], bool]


def _any(_: Numbers) -> bool:
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """A kind of edit."""

    text: str
    """Help text."""
    values: str = ""
    """Placeholder of its numbers in help; "" if it takes none."""
    count: int = 0
    """Number of values."""
    expected: str = ""
    """Description of valid values for error messages."""
    allows: Test = _any
    """Function that accepts or rejects finite numbers of the right count."""
    bare: str = ""
    """Default numbers as text; "" if they are required."""
    moves: bool = False
    """Whether the edit is an affine map."""
    keeps_rows: bool = False
    """Whether the number and order of the splats stay the same."""
    row_by_row: bool = True
    """Whether the result for a splat depends on that splat alone."""
    compiles: bool = False
    """Whether the edit runs compiled kernels."""


def _is_share(values: Numbers) -> bool:
    return 0 <= values[0] <= 1


def _is_box(values: Numbers) -> bool:
    return all(low <= high for low, high in zip(values[:3], values[3:], strict=True))


def _is_whole(value: float, least: int, most: float = math.inf) -> bool:
    return value == int(value) and least <= value <= most


KINDS: Mapping[str, Kind] = {
    "translate": Kind(
        text="move by an offset",
        values="X,Y,Z",
        count=3,
        expected="three numbers X,Y,Z",
        moves=True,
        keeps_rows=True,
    ),
    "rotate": Kind(
        text="rotate about the origin, about x, then y, then z, in degrees; harmonics rotate too",
        values="X,Y,Z",
        count=3,
        expected="three angles X,Y,Z in degrees",
        moves=True,
        keeps_rows=True,
    ),
    "scale": Kind(
        text="scale about the origin",
        values="S",
        count=1,
        expected="a positive number",
        allows=lambda values: values[0] > 0,
        moves=True,
        keeps_rows=True,
    ),
    "crop-box": Kind(
        text="keep splats whose centre is in a box, given by its minimum and maximum x, y, z",
        values="X,Y,Z,X,Y,Z",
        count=6,
        expected="six numbers: minimum and maximum x,y,z, in this order",
        allows=_is_box,
    ),
    "crop-sphere": Kind(
        text="keep splats whose centre is within R of a point",
        values="X,Y,Z,R",
        count=4,
        expected="four numbers X,Y,Z,R with R not negative",
        allows=lambda values: values[3] >= 0,
    ),
    "min-opacity": Kind(
        text="drop splats of lower opacity; splats below 0.0039 are invisible in any picture",
        values="A",
        count=1,
        expected="a number from 0 to 1",
        allows=_is_share,
    ),
    "max-opacity": Kind(
        text="drop splats of higher opacity",
        values="A",
        count=1,
        expected="a number from 0 to 1",
        allows=_is_share,
    ),
    "min-size": Kind(
        text="drop splats whose largest standard deviation is smaller",
        values="S",
        count=1,
        expected="a number that is not negative",
        allows=lambda values: values[0] >= 0,
    ),
    "max-size": Kind(
        text="drop splats whose largest standard deviation is larger",
        values="S",
        count=1,
        expected="a number that is not negative",
        allows=lambda values: values[0] >= 0,
    ),
    "drop-nan": Kind(text="drop splats with a number that is not finite"),
    "drop-outliers": Kind(
        text="drop floaters: splats whose mean distance to their N nearest neighbours exceeds the "
        "average by D standard deviations; default: 20,2",
        values="N,D",
        count=2,
        expected="N,D: a number of neighbours, 1 or more, and of standard deviations, 0 or more",
        allows=lambda values: _is_whole(values[0], 1) and values[1] >= 0,
        bare="20,2",
        row_by_row=False,
        compiles=True,
    ),
    "sh-degree": Kind(
        text="drop harmonics above this degree, 0 to 4; 0 leaves one colour for all directions",
        values="D",
        count=1,
        expected="a whole number from 0 to 4",
        allows=lambda values: _is_whole(values[0], 0, 4),
        keeps_rows=True,
    ),
    "decimate": Kind(
        text="merge similar neighbours until this number or percentage of splats is left",
        values="COUNT|PERCENT%",
        count=1,
        expected="a number of splats, or a percentage such as 25%",
        allows=lambda values: 0 < values[0] < 1 or _is_whole(values[0], 1),
        row_by_row=False,
        compiles=True,
    ),
    "morton": Kind(
        text="sort splats in Morton order, which keeps neighbours together", row_by_row=False
    ),
}
"""Kinds of edits by the name of their flag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """An edit of a cloud with its numbers.

    Raises:
        UsageError: If the edit is unknown, or does not accept these numbers.
    """

    name: str
    """One of `KINDS`."""
    values: Numbers = ()
    """Its numbers, in the order of `Kind.values`; a percentage is stored as a fraction below 1."""

    def __post_init__(self) -> None:
        if self.name not in KINDS:
            raise UsageError("edit", repr(self.name), f"one of {', '.join(KINDS)}")
        kind = self.kind
        fits = len(self.values) == kind.count and all(map(math.isfinite, self.values))
        if not fits or not kind.allows(self.values):
            found = _listed(self.values) or "no number"
            raise UsageError(f"edit {self.name}", found, kind.expected or "no number")

    @property
    def kind(self) -> Kind:
        """The kind of this edit."""
        return KINDS[self.name]

    def __str__(self) -> str:
        if self.name == "decimate" and self.values[0] < 1:
            return f"{self.name} {_listed((100 * self.values[0],))}%"
        return f"{self.name} {_listed(self.values)}".rstrip()


def parsed(name: str, text: str) -> Edit:
    """Parse an edit from the text of its flag, such as "0,90,0".

    Raises:
        UsageError: If the text contains no numbers, or the edit does not accept them.
    """
    share = name == "decimate" and text.endswith("%")
    try:
        values = tuple(float(part) for part in text.rstrip("%" * share).split(",")) if text else ()
    except ValueError:
        expected = KINDS[name].expected if name in KINDS else "numbers"
        raise UsageError(f"edit {name}", repr(text), expected) from None
    if share and not 0 < values[0] < 100:
        raise UsageError(f"edit {name}", text, "more than 0 % and less than 100 %")
    return Edit(name=name, values=(values[0] / 100,) if share else values)


def _listed(values: Numbers) -> str:
    """Return the numbers in the form of the flag's text."""
    return ",".join(f"{value:.9g}" for value in values)
