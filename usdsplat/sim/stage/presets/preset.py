"""Values that describe a preset: its name, the author of its prims, and the option it takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from pxr import Usd

from usdsplat.core.errors import UsageError
from usdsplat.sim.stage.presets.scene import Scene

OptionName = Literal["style", "material", "target"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetOption:
    """The one option that a preset takes."""

    name: OptionName
    text: str
    """Its meaning, without a capital."""
    choices: tuple[str, ...] = ()
    """Legal values; empty for a file."""
    default: str | None = None
    """Value where none is given; None leaves the choice to the preset."""
    is_required: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The value of a preset's option: a name, or a stage where the option is a file."""

    name: str | None = None
    """One of the option's choices; None where none is given or the option is a file."""
    goal: Usd.Stage | None = None
    """The stage in the file; None without one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """A simulation that is ready to run."""

    name: str
    text: str
    """What it does, in a few words."""
    author: Callable[[Scene, Usd.Prim, Choice], None]
    """Authors parameters on the SplatSim prim and other prims beside it; takes the value of
    `option`."""
    option: PresetOption | None = None

    def chosen(self, given: Mapping[str, str | None]) -> str | None:
        """Return the value of the preset's option.

        Args:
            given: Values by the names of options; None where none is given.

        Raises:
            UsageError: If another option is given, the value is not legal, or one is missing.
        """
        own = self.option
        for name, value in given.items():
            if value is not None and (own is None or name != own.name):
                takes = "no option" if own is None else f"only --{own.name}"
                found = f"{value!r} and --preset {self.name}"
                raise UsageError(f"--{name}", found, f"none: {self.name} takes {takes}")
        if own is None:
            return None
        value = given.get(own.name)
        if value is None:
            if own.is_required:
                raise UsageError(f"--{own.name}", f"none and --preset {self.name}", own.text)
            return own.default
        if own.choices and value not in own.choices:
            raise UsageError(f"--{own.name}", repr(value), f"one of {', '.join(own.choices)}")
        return value
