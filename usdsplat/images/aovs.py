"""The AOVs of pictures: names, channels, precision and meaning.

An entry of `AOVS` has the name of an AOV, its EXR channels, its precision, and its meaning, which
is written to the file's header.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from usdsplat.core.errors import UsageError
from usdsplat.images import cryptomatte

LIGHT = "light_"
"""Prefix of the names of AOVs of light groups."""
CAPTURED = "light_captured"
"""Name of the AOV of the rest of the colour, which no light group contributes."""
EVERY_LIGHT = ("lights", "light_*")
"""Names in requests that stand for the AOVs of all light groups."""

_EMPTY = "; inf in empty pixels"
"""End of the meaning of every depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aov:
    """An AOV: one output of a render."""

    name: str
    """Name in requests, and key in a band of pixels."""
    hydra: str
    """Name in the renderer (Hydra's, where it has one)."""
    channels: tuple[str, ...]
    """EXR channels, in the order of the array's last axis; with one channel there is no such
    axis."""
    kind: Literal["color", "data", "id"]
    """Colour may be stored as half; data is float32; ids are uint32, in a separate part."""
    meaning: str
    """Meaning in one sentence, for the file's header."""

    @property
    def is_cryptomatte(self) -> bool:
        """Whether it is a layer of Cryptomatte."""
        return self.name in cryptomatte.LAYERS

    def with_rank(self, rank: int) -> Aov:
        """Return the AOV with the channels for `rank` pairs of id and coverage.

        Only layers of Cryptomatte have such pairs.
        """
        if not self.is_cryptomatte:
            return self
        return replace(self, channels=cryptomatte.channels(self.name, rank))

    @property
    def is_depth(self) -> bool:
        """Whether empty pixels are inf."""
        return self.meaning.endswith(_EMPTY)

    def meaning_with(self, empty_depth: float) -> str:
        """Return the meaning in a file in which empty pixels have this depth."""
        return self.meaning.replace(_EMPTY, f"; {empty_depth:g} in empty pixels")


def _cryptomatte(layer: str, what: str) -> Aov:
    """Return the AOV of a layer of Cryptomatte with the default number of ranks."""
    return Aov(
        name=layer,
        hydra=layer,
        channels=cryptomatte.channels(layer, cryptomatte.RANK),
        kind="data",
        meaning=f"Cryptomatte of {what}: hash and coverage of those with the largest coverage of "
        "the pixel, in descending order",
    )


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
        "reached; inf in empty pixels",
    ),
    Aov(
        name="Zfront",
        hydra="depthFront",
        channels=("Zfront",),
        kind="data",
        meaning="planar camera depth of the first splat or surface that adds 1/255 or more to the "
        "pixel's coverage; inf in empty pixels",
    ),
    Aov(
        name="Zexp",
        hydra="depthExpected",
        channels=("Zexp",),
        kind="data",
        meaning="mean planar camera depth, weighted by contributions to the pixel's coverage; inf "
        "in empty pixels",
    ),
    Aov(
        name="N",
        hydra="Neye",
        channels=("N.x", "N.y", "N.z"),
        kind="data",
        meaning="unit normal of surfaces in camera space (x right, y up, z towards the eye), the "
        "mean weighted by contributions to the pixel's coverage; 0 in empty pixels",
    ),
    Aov(
        name="Naxis",
        hydra="Naxis",
        channels=("Naxis.x", "Naxis.y", "Naxis.z"),
        kind="data",
        meaning="unit normal as N, but from the thinnest axes of the splats, turned to the eye; 0 "
        "in empty pixels",
    ),
    Aov(
        name="confidence",
        hydra="confidence",
        channels=("confidence",),
        kind="data",
        meaning="confidence of N, from 1 on flat sheets to 0 in a volume, the mean weighted by "
        "contributions to the pixel's coverage; 0 in empty pixels",
    ),
    Aov(
        name="occlusion",
        hydra="occlusion",
        channels=("occlusion",),
        kind="data",
        meaning="part of the sky above the splats that others of their field hide, the mean "
        "weighted by contributions to the pixel's coverage; 0 on surfaces and in empty pixels",
    ),
    Aov(
        name="P",
        hydra="P",
        channels=("P.x", "P.y", "P.z"),
        kind="data",
        meaning="world position at Z, in scene units; 0 in empty pixels",
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
        name="shadow",
        hydra="shadow",
        channels=("shadow.R", "shadow.G", "shadow.B"),
        kind="data",
        meaning="light that arrives relative to that without shadows, of shadow catchers if there "
        "are any, else of everything, the mean weighted by contributions to the pixel's coverage; "
        "1 in empty pixels",
    ),
    Aov(
        name="irradiance",
        hydra="irradiance",
        channels=("irradiance.R", "irradiance.G", "irradiance.B"),
        kind="data",
        meaning="light that arrives, with shadows, as a white surface reflects it (irradiance / "
        "pi), linear, in the primaries of the working space, the mean weighted by contributions to "
        "the pixel's coverage; 0 in empty pixels",
    ),
    Aov(
        name="forward",
        hydra="motionForward",
        channels=("forward.u", "forward.v"),
        kind="data",
        meaning="motion of the splat or surface at Z until the next frame, in pixels; u right, "
        "v up; 0 in empty pixels",
    ),
    Aov(
        name="backward",
        hydra="motionBackward",
        channels=("backward.u", "backward.v"),
        kind="data",
        meaning="motion of the splat or surface at Z since the previous frame, in pixels; u right, "
        "v up; 0 in empty pixels",
    ),
    _cryptomatte("cryptoObject", "prims, named by path"),
    _cryptomatte(
        "cryptoAsset",
        "assets, named by path: the nearest component model at or above a prim, else the nearest "
        "prim with assetInfo, else the root prim",
    ),
    _cryptomatte(
        "cryptoMaterial", "bound materials, named by path; default where no material is bound"
    ),
    Aov(
        name="id",
        hydra="primId",
        channels=("id",),
        kind="id",
        meaning="index in usdsplat:ids of the prim at Z; 4294967295 in empty pixels",
    ),
    Aov(
        name="instanceId",
        hydra="instanceId",
        channels=("instanceId",),
        kind="id",
        meaning="index in its point instancer of the instance at Z; 4294967295 in empty pixels",
    ),
    Aov(
        name="splatId",
        hydra="elementId",
        channels=("splatId",),
        kind="id",
        meaning="row in the prim's arrays of the splat at Z, or face of the mesh at Z; 4294967295 "
        "in empty pixels",
    ),
)

AOVS = {aov.name: aov for aov in _ALL}
"""AOVs by name, without those of light groups, whose names come from the stage."""


_BY_EITHER_NAME = {aov.hydra: aov for aov in _ALL} | AOVS


def is_light(name: str) -> bool:
    """Return whether a name is that of an AOV of a light group, or of the light that is left."""
    return re.fullmatch(f"{LIGHT}[A-Za-z0-9_]+", name) is not None


def light_name(group: str) -> str:
    """Return the name of the AOV of a light group. Other characters than ASCII letters, digits and
    underscores, which layers of compositors cannot have, are underscores."""
    name = LIGHT + re.sub("[^A-Za-z0-9_]", "_", group)
    return f"{name}_" if name == CAPTURED else name


def aov_named(name: str) -> Aov:
    """Return the AOV of a name; it may be that of a light group.

    Raises:
        KeyError: If there is none.
    """
    if not is_light(name):
        return AOVS[name]
    what = f"lights of group {name.removeprefix(LIGHT)}"
    if name == CAPTURED:
        what = "light that no light of the stage explains"
    return Aov(
        name=name,
        hydra=name,
        channels=tuple(f"{name}.{channel}" for channel in "RGB"),
        kind="color",
        meaning=f"part of the premultiplied colour by {what}, in the space of colorInteropID; all "
        "parts add up to color in display mode splats",
    )


def find_aovs(names: Sequence[str], *, where: str = "AOVs") -> tuple[Aov, ...]:
    """Return the AOVs called `names`, names of files or of the renderer, in that order.

    Raises:
        UsageError: If a name is unknown or repeated, or there is none.
    """
    for name in names:
        if name not in _BY_EITHER_NAME and not is_light(name):
            raise UsageError(where, repr(name), f"one of {', '.join(AOVS)}, lights")
    found = tuple(_BY_EITHER_NAME.get(name) or aov_named(name) for name in names)
    if not found or len(set(found)) < len(found):
        raise UsageError(where, repr(",".join(names)), "one or more names, each once")
    return found
