"""Checkpoints: every bit of a simulation's states in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat import __version__
from usdsplat.core.errors import FormatError
from usdsplat.sim.arrays_file import load_arrays, save_arrays
from usdsplat.sim.state import ARRAYS, State

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Checkpoint:
    """The states of all fields of a simulation after a frame."""

    time: float
    """Frame that the states belong to [time code]."""
    states: Mapping[str, State]
    """States by the path of the field."""
    parameter_hash: str
    code_version: str = __version__
    extras: Mapping[str, Array] = field(default_factory=dict)
    """Further arrays by name."""


def save(target: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint, replacing the file at `target` as a whole.

    Raises:
        OutputError: If the file cannot be written.
    """
    arrays: dict[str, Array] = {f"extra|{key}": value for key, value in checkpoint.extras.items()}
    scalars = []
    for number, (path, state) in enumerate(checkpoint.states.items()):
        scalars.append({"path": path, "step": state.step, "next_id": state.next_id})
        arrays |= {f"{number}|{name}": array for name, array in state.per_splat()}
        others = sorted(state.globals.items())  # so that the bytes do not depend on their order
        arrays |= {f"{number}|globals:{key}": array for key, array in others}
    meta = {
        "time": checkpoint.time,
        "parameterHash": checkpoint.parameter_hash,
        "codeVersion": checkpoint.code_version,
        "states": scalars,
    }
    save_arrays(target, arrays, meta)


def load(source: Path) -> Checkpoint:
    """Read a checkpoint, bit for bit.

    Arrays are new. If `sh` and `rest_sh` were the same array, they are the same array again.

    Raises:
        FormatError: If the file is damaged or not a checkpoint.
    """
    arrays, meta = load_arrays(source)
    try:
        states = {
            entry["path"]: _state(arrays, f"{number}|", entry)
            for number, entry in enumerate(meta["states"])
        }
        return Checkpoint(
            time=meta["time"],
            states=states,
            parameter_hash=meta["parameterHash"],
            code_version=meta["codeVersion"],
            extras=_under(arrays, "extra|"),
        )
    except (KeyError, TypeError) as error:
        raise FormatError(str(source), f"no {error}", "a checkpoint of a simulation") from error


def time_of(source: Path) -> float:
    """Return the frame of a checkpoint, without reading its states.

    Raises:
        FormatError: If the file is damaged or not a checkpoint.
    """
    meta = load_arrays(source, mapped=True, checked=False)[1]
    try:
        return float(meta["time"])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(str(source), f"no {error}", "a checkpoint of a simulation") from error


def _state(arrays: Mapping[str, Array], prefix: str, entry: Mapping[str, Any]) -> State:
    mine = _under(arrays, prefix)
    return State(
        **{name: mine[name] for name in ARRAYS},
        step=entry["step"],
        next_id=entry["next_id"],
        memory=_under(mine, "memory:"),
        globals=_under(mine, "globals:"),
    )


def _under(arrays: Mapping[str, Array], prefix: str) -> dict[str, np.ndarray]:
    """Return the arrays whose names start with a prefix, without the prefix."""
    return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
