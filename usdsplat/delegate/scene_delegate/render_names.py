"""Names of AOVs and colour spaces on render prims, as other programs spell them."""

from __future__ import annotations

import re

from usdsplat.images.aovs import is_light, light_name
from usdsplat.images.view import ALIASES

AOVS = {
    "color": "color",
    "Ci": "color",
    "rgba": "color",
    "beauty": "color",
    "C.*": "color",
    "C.*[LO]": "color",
    "C.*[<L.>O]": "color",
    "a": "color",
    "alpha": "color",
    "depth": "depth",
    "cameraDepth": "depth",
    "Z": "depth",
    "z": "depth",
    "ray:hitPz": "depth",
    "Zfront": "depthFront",
    "depthFront": "depthFront",
    "Zexp": "depthExpected",
    "depthExpected": "depthExpected",
    "Neye": "Neye",
    "N": "Neye",
    "Naxis": "Naxis",
    "confidence": "confidence",
    "occlusion": "occlusion",
    "P": "P",
    "Pworld": "P",
    "__Pworld": "P",
    "albedo": "albedo",
    "shadow": "shadow",
    "irradiance": "irradiance",
    "forward": "motionForward",
    "motionForward": "motionForward",
    "backward": "motionBackward",
    "motionBackward": "motionBackward",
    "cryptoObject": "cryptoObject",
    "crypto_object": "cryptoObject",
    "CryptoObject": "cryptoObject",
    "cryptoAsset": "cryptoAsset",
    "crypto_asset": "cryptoAsset",
    "CryptoAsset": "cryptoAsset",
    "cryptoMaterial": "cryptoMaterial",
    "crypto_material": "cryptoMaterial",
    "CryptoMaterial": "cryptoMaterial",
    "primId": "primId",
    "id": "primId",
    "instanceId": "instanceId",
    "elementId": "elementId",
    "splatId": "elementId",
}
"""`sourceName` of a RenderVar, in the spelling of Hydra, RenderMan, Arnold, Karma and our files ->
our AOV. Light path expressions of all light are the beauty. Names with another meaning elsewhere
(Hydra's `normal`, Arnold's `motionvector`, Karma's `ray:hitN`) are omitted."""

ALPHAS = ("a", "alpha")
"""`sourceName` of vars that request only the alpha of `color`."""

LINEAR = tuple(space for space in ALIASES if space.startswith("lin_"))
"""Names of the spaces that pictures can be rendered in."""


def light_of(source: str) -> str:
    """Return the AOV of the light group that a `sourceName` names, as AOV or in the light path
    expression of all its light; "" for any other name."""
    if path := re.fullmatch(r"C\.\*<L\.'([^']+)'>", source):
        return light_name(path[1])
    return source if is_light(source) else ""


def working_space(name: str) -> str:
    """Return the linear space that a config or USD calls `name`; "" for any other name."""
    spaces = {known.lower(): space for space in LINEAR for known in (space, *ALIASES[space])}
    return spaces.get(name.lower(), "")
