"""Knobs as a panel shows them: what kind of editor, which limits, which words.

for editor in editors_of(settings):
    show(editor)                                  # a label, a slider, a list of choices, ...
settings = with_value(settings, "sh_degree", 2)   # refused in a sentence if it is none
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeVar

T = TypeVar("T")
Kind = Literal["bool", "int", "float", "choice", "text", "vector", "color"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Editor:
    """One value that a user may change. All of it can be written as JSON."""

    name: str
    """What `with_value` or `set_parameter` calls it."""
    label: str
    """What a user reads, such as "SH degree"."""
    kind: Kind
    value: Any
    """bool, int, float, str, or a tuple of numbers; None for one that `none_label` speaks of."""
    default: Any = None
    """What it is where nobody says anything."""
    none_label: str = ""
    """What None means, such as "unlimited"; "" for a value that is never None."""
    minimum: float | None = None
    """Lowest legal number, of each part of a vector; None for no limit."""
    maximum: float | None = None
    soft_range: tuple[float, float] = (0.0, 1.0)
    """What a slider spans; a number typed may be any legal one."""
    step: float = 0.01
    """By which an arrow changes it."""
    is_whole: bool = False
    """Whether the parts of a vector are whole numbers."""
    unit: str = ""
    choices: tuple[str, ...] = ()
    help: str = ""
    group: str = ""
    """A heading to put it under."""
    is_animated: bool = False
    """Whether it has samples over time; `value` is that of the time that was asked for."""
    is_authored: bool = True
    """Whether somebody says so, rather than it being the default."""
    is_read_only: bool = False
    """Whether it can be looked at, not changed."""


def editors_of(instance: Any) -> tuple[Editor, ...]:
    """One editor for each knob of a dataclass's instance, in order of declaration."""
    raise NotImplementedError


def with_value(instance: T, name: str, value: Any) -> T:
    """The same settings, one of them changed.

    Raises:
        UsageError: If there is none of that name, or it cannot have that value.
    """
    raise NotImplementedError
