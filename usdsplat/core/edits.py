"""Edits as words: what each is called, which numbers it takes, and a value that says one.

They say what is asked for and load nothing; `interchange.editing` does it. Lengths and places are
numbers of the capture, as `usdsplat info` prints them.
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
    """One kind of edit."""

    text: str
    """What it does, for people."""
    values: str = ""
    """How its numbers are written; "" where it takes none."""
    count: int = 0
    """How many numbers."""
    expected: str = ""
    """What the numbers have to be, for people."""
    allows: Test = _any
    """Whether finite numbers of the right count are what is expected."""
    bare: str = ""
    """The numbers when none are typed; "" where they have to be."""
    moves: bool = False
    """Whether it is an affine map."""
    keeps_rows: bool = False
    """Whether splats stay as many as they were, in their order."""
    row_by_row: bool = True
    """Whether what becomes of a splat depends on that splat alone."""
    compiles: bool = False
    """Whether kernels do it."""


def _is_share(values: Numbers) -> bool:
    return 0 <= values[0] <= 1


def _is_box(values: Numbers) -> bool:
    return all(low <= high for low, high in zip(values[:3], values[3:], strict=True))


def _is_whole(value: float, least: int, most: float = math.inf) -> bool:
    return value == int(value) and least <= value <= most


KINDS: Mapping[str, Kind] = {
    "translate": Kind(
        text="move by so much",
        values="X,Y,Z",
        count=3,
        expected="three numbers X,Y,Z",
        moves=True,
        keeps_rows=True,
    ),
    "rotate": Kind(
        text="turn about the origin by degrees, about x, then y, then z; harmonics turn too",
        values="X,Y,Z",
        count=3,
        expected="three angles X,Y,Z in degrees",
        moves=True,
        keeps_rows=True,
    ),
    "scale": Kind(
        text="enlarge about the origin",
        values="S",
        count=1,
        expected="a positive number",
        allows=lambda values: values[0] > 0,
        moves=True,
        keeps_rows=True,
    ),
    "crop-box": Kind(
        text="keep splats whose centre is in a box: its least x, y, z and its greatest",
        values="X,Y,Z,X,Y,Z",
        count=6,
        expected="six numbers: the least x,y,z and the greatest",
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
        text="drop splats that are more transparent; no picture shows those below 0.0039",
        values="A",
        count=1,
        expected="a number from 0 to 1",
        allows=_is_share,
    ),
    "max-opacity": Kind(
        text="drop splats that are more opaque",
        values="A",
        count=1,
        expected="a number from 0 to 1",
        allows=_is_share,
    ),
    "min-size": Kind(
        text="drop splats whose longest standard deviation is shorter",
        values="S",
        count=1,
        expected="a number that is not negative",
        allows=lambda values: values[0] >= 0,
    ),
    "max-size": Kind(
        text="drop splats whose longest standard deviation is longer",
        values="S",
        count=1,
        expected="a number that is not negative",
        allows=lambda values: values[0] >= 0,
    ),
    "drop-nan": Kind(text="drop splats with a number that is not finite"),
    "drop-outliers": Kind(
        text="drop floaters: splats whose N nearest neighbours are farther away, on average, than "
        "is usual by D standard deviations; default: 20,2",
        values="N,D",
        count=2,
        expected="a number of neighbours, 1 or more, and one of deviations, 0 or more: N,D",
        allows=lambda values: _is_whole(values[0], 1) and values[1] >= 0,
        bare="20,2",
        row_by_row=False,
        compiles=True,
    ),
    "sh-degree": Kind(
        text="cut harmonics of a higher degree than this, 0 to 4; 0 is one colour from all sides",
        values="D",
        count=1,
        expected="a whole number from 0 to 4",
        allows=lambda values: _is_whole(values[0], 0, 4),
        keeps_rows=True,
    ),
    "decimate": Kind(
        text="merge neighbours that look alike until so many splats are left, or such a share",
        values="COUNT|PERCENT%",
        count=1,
        expected="a number of splats, or a share such as 25%",
        allows=lambda values: 0 < values[0] < 1 or _is_whole(values[0], 1),
        row_by_row=False,
        compiles=True,
    ),
    "morton": Kind(
        text="order splats along a Z-order curve: neighbours stand together", row_by_row=False
    ),
}
"""Every edit by the name of its flag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """One edit of a cloud.

    Raises:
        UsageError: If there is no such edit, or it does not take these numbers.
    """

    name: str
    """One of `KINDS`."""
    values: Numbers = ()
    """Its numbers, in the order in which the kind names them; a share is less than 1."""

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
        """What it is one of."""
        return KINDS[self.name]

    def __str__(self) -> str:
        if self.name == "decimate" and self.values[0] < 1:
            return f"{self.name} {_listed((100 * self.values[0],))}%"
        return f"{self.name} {_listed(self.values)}".rstrip()


def parsed(name: str, text: str) -> Edit:
    """An edit from what is typed behind its flag, such as "0,90,0".

    Raises:
        UsageError: If these are no numbers, or not those that the edit takes.
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
    """The numbers as they would be typed."""
    return ",".join(f"{value:.9g}" for value in values)
