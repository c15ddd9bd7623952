"""The AOVs of deep pictures: their channels and meaning.

A sample belongs to one prim, so its Cryptomatte has one rank: the hash, and as coverage the
sample's own opacity, which like A applies to the sample alone. The second rank of the layer is 0,
and there are no further layers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.images.aovs import AOVS
from usdsplat.images.exr_bytes import Channels

MEANINGS = {
    "color": "premultiplied linear radiance of one sample in the space of colorInteropID; A = its "
    "opacity",
    "Z": "planar camera depth of the sample",
    "id": "index in usdsplat:ids of the sample's prim",
    "instanceId": "index in its point instancer of the sample's instance",
    "splatId": "row in the prim's arrays of the sample's splat, or face of its mesh",
}
CRYPTOMATTE = "Cryptomatte of the sample: R = hash of its name, G = its opacity, B = A = 0"


CRYPTOMATTES = ("cryptoObject",)
"""Cryptomattes of deep pictures: those whose name follows from a sample's prim."""
DEEP_AOVS = tuple(name for name in AOVS if name in MEANINGS or name in CRYPTOMATTES)
"""AOVs that a deep picture can have."""
ALWAYS = ("color", "Z")
"""AOVs that every deep picture has."""


def id_channels(aovs: tuple[str, ...]) -> Channels:
    """Return the channels of all AOVs except color and Z, sorted by name."""
    found: Channels = {}
    for name in aovs:
        if AOVS[name].kind == "id":
            found |= dict.fromkeys(AOVS[name].channels, np.dtype("<u4"))
        elif name in CRYPTOMATTES:
            found |= dict.fromkeys(AOVS[name].channels[:4], np.dtype("<f4"))
    return dict(sorted(found.items()))


def deep_channels(
    aovs: tuple[str, ...], color: npt.DTypeLike = np.float16, *, merged: bool
) -> Channels:
    """Return the channels of a file with these AOVs.

    Args:
        aovs: AOVs beside color and Z, which every file has.
        color: Type of the colour and of the opacity.
        merged: Whether samples have a ZBack.
    """
    channels: Channels = dict.fromkeys("ABGR", np.dtype(color))
    channels |= dict.fromkeys(("Z", "ZBack")[: 1 + merged], np.dtype("<f4"))
    return channels | id_channels(aovs)


def meanings(aovs: tuple[str, ...]) -> dict[str, str]:
    """Return the header entries that describe AOVs; color and Z are always described."""
    names = dict.fromkeys((*ALWAYS, *aovs))
    return {f"usdsplat:aov:{name}": MEANINGS.get(name, CRYPTOMATTE) for name in names}
