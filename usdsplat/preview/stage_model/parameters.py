"""The parameters of a stage's simulations and affectors, as a panel shows and changes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pxr import Usd

from usdsplat.preview.knob_model import Editor
from usdsplat.preview.stage_model.edits import Edits


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterPrim:
    """One prim with parameters."""

    path: str
    type_name: str
    """"SplatSim", or the shape of an affector."""
    is_simulation: bool
    editors: tuple[Editor, ...]
    """Named as on command lines, such as "rd:patternScale"; of applied groups only."""


def editors(stage: Usd.Stage, *, time: float | None = None) -> tuple[ParameterPrim, ...]:
    """Every simulation and every affector of a stage, in its order."""
    raise NotImplementedError


def set_parameter(
    edits: Edits,
    path: str,
    name: str,
    value: Any,
    *,
    time: float | None = None,
    merge: str | None = None,
) -> None:
    """Change a parameter, also while its simulation runs.

    Args:
        edits: Of the stage.
        path: Of the SplatSim prim or the affector.
        name: Such as "rd:patternScale" or "deform:bend:angle".
        value: As its editor has it.
        time: Time code of a sample; None sets it for all times, whatever samples there are.
        merge: As for `Edits.step`.

    Raises:
        StageError: If there is no such prim, or no such deformer or driver on it.
        UsageError: If there is no such parameter, or it cannot have that value.
    """
    raise NotImplementedError
