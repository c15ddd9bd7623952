"""Probe a pixel: displayed colour, AOV values, rendered colour, position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.images.aovs import find_aovs
from usdsplat.preview.document import Document
from usdsplat.preview.reading import Vector, read, vector
from usdsplat.preview.values import Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class Probed:
    """The values of a pixel of the viewport."""

    x: int
    y: int
    """Position from the viewport's top left [pixel]."""
    aov: str
    """Name of the displayed AOV, as in files."""
    shown: Vector
    """Displayed RGB [0..1] of the last picture."""
    values: tuple[float, ...]
    """Values of the AOV at full quality; ids are integers, depths may be infinite."""
    channels: tuple[str, ...]
    """Channel names of `values`, as in files."""
    rendered: tuple[float, float, float, float]
    """Premultiplied colour before view, exposure and gamma, in the picture's own space."""
    position: Vector | None
    """Position in the world [scene unit]; None in an empty pixel."""
    path: str
    """Path of the visible prim; "" in an empty pixel."""
    element: int
    """Row of the splat, or face of the mesh; -1 in an empty pixel."""


def probe(document: Document, x: float, y: float) -> Probed | None:
    """Return the values of a pixel of the viewport; None without a picture.

    Args:
        document: Document whose last picture is used.
        x, y: Position from the viewport's top left [pixel].
    """
    shown = document.shown
    if shown is None:
        return None
    look = shown.side_at(x).look
    (aov,) = find_aovs((look.aov,))
    wanted = tuple(dict.fromkeys((aov.hydra, "color", "P", "primId", "elementId")))
    reading = read(document, x, y, wanted)
    if reading is None:
        return None
    at = {name: pixels[reading.row, reading.column] for name, pixels in reading.arrays.items()}
    number = int(at["primId"])
    red, green, blue, alpha = at["color"].tolist()
    return Probed(
        x=reading.x,
        y=reading.y,
        aov=aov.name,
        shown=_seen(shown.picture, reading.x, reading.y),
        values=tuple(np.atleast_1d(at[aov.hydra]).tolist()),
        channels=aov.with_rank(look.settings.crypto_rank).channels,
        rendered=(red, green, blue, alpha),
        position=vector(at["P"]) if number >= 0 else None,
        path=reading.prims[number] if number >= 0 else "",
        element=int(at["elementId"]),
    )


def _seen(picture: Picture, x: int, y: int) -> Vector:
    """Return the displayed colour of a pixel of the viewport."""
    rows, columns = picture.image.shape[:2]
    row, column = int(y / picture.scale), int(x / picture.scale)
    red, green, blue = picture.image[min(row, rows - 1), min(column, columns - 1)].tolist()
    return red / 255, green / 255, blue / 255
