"""Encode splats as the images and the `meta.json` of SOG version 2.

Source: PlayCanvas, "The SOG Format". Splats are in Morton order, so that neighbouring pixels are
similar and compress well.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import morton
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.encoding import encode_smallest_three, quantize
from usdsplat.core.errors import OutputError
from usdsplat.formats import webp
from usdsplat.formats.cloud_builder import threads
from usdsplat.formats.sog import codebook, palette
from usdsplat.formats.sog.meta import PALETTE_COLUMNS, ROTATION_TAG

Codes = npt.NDArray[np.uint8]

SMALLEST_LOGARITHM = -20.0
"""Smallest logarithm of a scale: 0 has none."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EncodedSog:
    """An encoded SOG that is not written yet."""

    images: Mapping[str, bytes]
    """WebP data by their default file names."""
    sections: Mapping[str, Any]
    """Contents of `meta.json`; each image is named under "files" of one section."""

    def meta(self, names: Mapping[str, str]) -> bytes:
        """Return the text of `meta.json`; `names` maps default image names to actual ones."""
        named = {
            key: value | {"files": [names.get(name, name) for name in value["files"]]}
            if isinstance(value, dict) and "files" in value
            else value
            for key, value in self.sections.items()
        }
        return json.dumps(named, allow_nan=False).encode()


def encode(
    target: str,
    cloud: SplatCloud,
    *,
    antialiased: bool,
    told: Callable[[int], None],
    sort: bool = True,
) -> EncodedSog:
    """Encode splats.

    Args:
        target: Name of the target in error messages.
        cloud: Finite splats; ids and velocities are not stored.
        antialiased: Whether the splats are meant for the antialiased projection.
        told: Receives the number of finished splats from time to time.
        sort: Whether to sort them in Morton order; else they keep theirs.

    Raises:
        OutputError: If there are more splats than an image can have pixels.
    """
    if len(cloud) > webp.LONGEST_SIDE**2:
        raise OutputError(target, f"{len(cloud)} splats", f"at most {webp.LONGEST_SIDE**2}")
    order = morton.order(cloud.positions) if sort else np.arange(len(cloud))
    images: dict[str, Codes] = {}
    sections: dict[str, Any] = {
        "version": 2,
        "asset": {"generator": "usdsplat"},
        "count": len(cloud),
        "means": _means(cloud.positions[order], images),
        "scales": _scales(cloud.scales[order], images),
        "quats": _rotations(cloud.rotations[order], images),
        "sh0": _colors(cloud.sh[order, 0], cloud.opacities[order], images),
    }
    if antialiased:
        # The specification's key and the tool's.
        sections |= {"antialias": True, "model": "antialiased"}
    if cloud.sh_degree:
        sections["shN"] = _harmonics(cloud, order, images, told)
    with threads() as workers:
        packed = dict(zip(images, workers.map(webp.encode, images.values()), strict=True))
    told(len(cloud))
    return EncodedSog(images=packed, sections=sections)


def _means(positions: F32, images: dict[str, Codes]) -> dict[str, Any]:
    """Encode positions: 16 bits per axis of sign(x) ln(1 + |x|), low and high bytes apart."""
    places = positions.astype(np.float64)
    logarithms = np.copysign(np.log1p(np.abs(places)), places)
    lower, upper = np.zeros(3), np.zeros(3)
    if len(places):
        lower, upper = logarithms.min(axis=0), logarithms.max(axis=0)
    codes = quantize(logarithms, lower, upper, 65535)
    images["means_l.webp"] = _image(codes & 255)
    images["means_u.webp"] = _image(codes >> 8)
    files = ["means_l.webp", "means_u.webp"]
    return {"mins": lower.tolist(), "maxs": upper.tolist(), "files": files}


def _scales(scales: F32, images: dict[str, Codes]) -> dict[str, Any]:
    """Encode logarithms of scales by a table."""
    smallest = np.float32(np.exp(SMALLEST_LOGARITHM))
    return _by_table("scales.webp", np.log(np.maximum(scales, smallest)), images)


def _rotations(rotations: F32, images: dict[str, Codes]) -> dict[str, Any]:
    """Encode three components of rotations, and the index of the largest in alpha."""
    largest, codes = encode_smallest_three(rotations, top=255)
    images["quats.webp"] = _image(codes, ROTATION_TAG + largest)
    return {"files": ["quats.webp"]}


def _colors(dc: F32, opacities: F32, images: dict[str, Codes]) -> dict[str, Any]:
    """Encode degree 0 by a table, and opacity in alpha."""
    return _by_table("sh0.webp", dc, images, alpha=quantize(opacities, 0, 1, 255))


def _harmonics(
    cloud: SplatCloud,
    order: npt.NDArray[np.intp],
    images: dict[str, Codes],
    told: Callable[[int], None],
) -> dict[str, Any]:
    """Encode harmonics as labels of a palette, and the palette by a table, 64 entries a row."""
    labels, entries = palette.palette(cloud.sh[:, 1:], told)
    table = codebook.codebook(entries)
    rows = max(-(-len(entries) // PALETTE_COLUMNS), 1)
    rest = cloud.sh.shape[1] - 1
    texels = np.zeros((rows * PALETTE_COLUMNS, rest, 4), np.uint8)
    texels[..., 3] = 255
    texels[: len(entries), :, :3] = codebook.encode(entries, table).reshape(-1, rest, 3)
    images["shN_centroids.webp"] = texels.reshape(rows, -1, 4)
    ordered = labels[order]
    images["shN_labels.webp"] = _image(np.stack([ordered & 255, ordered >> 8], axis=1))
    return {
        "count": len(entries),
        "bands": cloud.sh_degree,
        "codebook": table.tolist(),
        "files": ["shN_centroids.webp", "shN_labels.webp"],
    }


def _by_table(
    name: str, values: F32, images: dict[str, Codes], alpha: npt.NDArray[Any] | int = 255
) -> dict[str, Any]:
    """Encode values as an image of indices into a table fitted to them."""
    table = codebook.codebook(values)
    images[name] = _image(codebook.encode(values, table), alpha)
    return {"codebook": table.tolist(), "files": [name]}


def _image(codes: npt.NDArray[Any], alpha: npt.NDArray[Any] | int = 255) -> Codes:
    """Return up to three channels and alpha as a nearly square image, a pixel for each row."""
    width, height = webp.size_for(len(codes))
    pixels = np.zeros((height * width, 4), np.uint8)
    pixels[:, 3] = 255
    pixels[: len(codes), : codes.shape[1]] = codes
    pixels[: len(codes), 3] = alpha
    return pixels.reshape(height, width, 4)
