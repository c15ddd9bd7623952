"""What may be in a picture besides its colour, and what each thing means in a file.

One entry of `AOVS` says how an AOV is called when it is asked for, which EXR channels it fills, how
exactly it must be kept, and its meaning, which goes into the file beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Aov:
    """One output of a render."""

    name: str
    """The name it is asked for by, and its key in a band of pixels."""
    hydra: str
    """What a renderer calls it."""
    channels: tuple[str, ...]
    """EXR channels, in the order of the array's last axis; one channel has no such axis."""
    kind: Literal["color", "data", "id"]
    """Colour may be kept as half; data is float32; ids are uint32, in a part of their own."""
    meaning: str
    """One sentence for whoever opens the file."""


_ALL = (
    Aov(
        name="color",
        hydra="color",
        channels=("R", "G", "B", "A"),
        kind="color",
        meaning="premultiplied radiance in the space of colorInteropID; A = 1 - transmittance",
    ),
    Aov(
        name="Z",
        hydra="depth",
        channels=("Z",),
        kind="data",
        meaning="planar camera depth at which half of the pixel's coverage is passed; "
        "inf where nothing is",
    ),
    Aov(
        name="id",
        hydra="primId",
        channels=("id",),
        kind="id",
        meaning="number of the prim that holds Z, its place in usdsplat:ids; 4294967295 where "
        "nothing is",
    ),
    Aov(
        name="instanceId",
        hydra="instanceId",
        channels=("instanceId",),
        kind="id",
        meaning="number in its point instancer of the instance that holds Z; 4294967295 where "
        "nothing is",
    ),
    Aov(
        name="splatId",
        hydra="elementId",
        channels=("splatId",),
        kind="id",
        meaning="row in the prim's arrays of the splat that holds Z; 4294967295 where nothing is",
    ),
)

AOVS = {aov.name: aov for aov in _ALL}
"""Every AOV that a file can hold, by name."""


_BY_EITHER_NAME = {aov.hydra: aov for aov in _ALL} | AOVS


def find_aovs(names: Sequence[str], *, where: str = "AOVs") -> tuple[Aov, ...]:
    """Return the AOVs called `names`, in a file's words or a renderer's, in that order.

    Raises:
        UsageError: If one is unknown, asked for twice, or there is none at all.
    """
    for name in names:
        if name not in _BY_EITHER_NAME:
            raise UsageError(where, repr(name), f"one of {', '.join(AOVS)}")
    found = tuple(_BY_EITHER_NAME[name] for name in names)
    if not found or len(set(found)) < len(found):
        raise UsageError(where, repr(",".join(names)), "one or more names, each once")
    return found
