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
        meaning="planar camera depth at which half of the pixel's coverage, surfaces included, is "
        "passed; inf where nothing is",
    ),
    Aov(
        name="Zfront",
        hydra="depthFront",
        channels=("Zfront",),
        kind="data",
        meaning="planar camera depth of the first thing that adds 1/255 or more to the pixel's "
        "coverage; inf where nothing is",
    ),
    Aov(
        name="Zexp",
        hydra="depthExpected",
        channels=("Zexp",),
        kind="data",
        meaning="mean planar camera depth, weighted by what each thing adds to the pixel's "
        "coverage; inf where nothing is",
    ),
    Aov(
        name="N",
        hydra="Neye",
        channels=("N.x", "N.y", "N.z"),
        kind="data",
        meaning="unit normal in camera space (x right, y up, z towards the eye), the mean weighted "
        "by what each thing adds to the pixel's coverage; 0 where nothing is",
    ),
    Aov(
        name="P",
        hydra="P",
        channels=("P.x", "P.y", "P.z"),
        kind="data",
        meaning="world position at Z, in scene units; 0 where nothing is",
    ),
    Aov(
        name="albedo",
        hydra="albedo",
        channels=("albedo.R", "albedo.G", "albedo.B"),
        kind="color",
        meaning="premultiplied colour without view dependence or light, in the space of "
        "colorInteropID",
    ),
    Aov(
        name="forward",
        hydra="motionForward",
        channels=("forward.u", "forward.v"),
        kind="data",
        meaning="pixels that what holds Z moves until the next frame; u right, v up; 0 where "
        "nothing is",
    ),
    Aov(
        name="backward",
        hydra="motionBackward",
        channels=("backward.u", "backward.v"),
        kind="data",
        meaning="pixels that what holds Z has moved since the previous frame; u right, v up; 0 "
        "where nothing is",
    ),
    Aov(
        name="cryptoObject",
        hydra="cryptoObject",
        channels=tuple(f"cryptoObject{rank:02}.{c}" for rank in range(3) for c in "RGBA"),
        kind="data",
        meaning="Cryptomatte of prim paths: hash and coverage of the six prims that cover most of "
        "the pixel, most first",
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
        meaning="row in the prim's arrays of the splat that holds Z, or face of the mesh that "
        "does; 4294967295 where nothing is",
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
