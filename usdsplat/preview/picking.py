"""Pick the prim and splat under the pointer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from usdsplat.core.sh import dc_to_rgb
from usdsplat.preview.document import Document
from usdsplat.preview.reading import PixelProbe, Vector, read, read_window, vector
from usdsplat.render.scene import RenderScene, matrix

REACH = 3
"""Maximum distance from the pointer [pixel]."""
AOVS = ("primId", "instanceId", "elementId", "P")


@dataclass(frozen=True, slots=True, kw_only=True)
class Splat:
    """A splat with the values of its prim."""

    center: Vector
    """Centre in the prim's local space [scene unit]."""
    world_center: Vector
    scales: Vector
    """Standard deviations along its own axes [scene unit]."""
    rotation: tuple[float, float, float, float]
    """Unit quaternion (w, x, y, z), from its axes to the prim."""
    opacity: float
    """Peak opacity [0..1]."""
    color: Vector
    """Colour without view dependence, in the trained colour space; may exceed 0..1."""
    sh_degree: int
    id: int
    """Id, or its row if it has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picked:
    """A picked splat or mesh face."""

    path: str
    """Path of the prim."""
    instance: int
    """Index in its point instancer, or 0."""
    kind: Literal["splats", "mesh"]
    element: int
    """Row of the splat in its prim's arrays, or face of the mesh."""
    position: Vector
    """Picked position in the world [scene unit]."""
    splat: Splat | None = None
    """None for a mesh."""


def pick(document: Document, x: float, y: float) -> Picked | None:
    """Return what is visible at a pixel of the viewport, or within `REACH` of it, or None.

    It is the splat or surface at half of the pixel's coverage at full quality.

    Args:
        document: Document whose last picture is used.
        x, y: Position from the viewport's top left [pixel].
    """
    reading = read(document, x, y, AOVS, reach=REACH)
    if reading is None:
        return None
    at = _nearest(reading)
    if at is None:
        return None
    number, index, element = (int(reading.arrays[name][at]) for name in AOVS[:3])
    path = reading.prims[number]
    splat = _splat(reading.side.scene.engine.render_scene, path, index, element)
    return Picked(
        path=path,
        instance=index,
        kind="mesh" if splat is None else "splats",
        element=element,
        position=vector(reading.arrays["P"][at]),
        splat=splat,
    )


def in_box(
    document: Document, left: float, top: float, right: float, bottom: float
) -> tuple[str, ...]:
    """Return the paths of the prims that are visible in a box of the viewport, sorted.

    A prim counts if, in a pixel there, it is the one at the depth where half of the pixel's
    coverage is reached. In a comparison, the side in the middle of the box decides.

    Args:
        document: Document whose last picture is used.
        left, top, right, bottom: Edges from the viewport's top left [pixel].
    """
    shown = document.shown
    if shown is None:
        return ()
    width, height = shown.picture.state.size
    x0, y0 = max(0, math.floor(left)), max(0, math.floor(top))
    x1, y1 = min(width, math.ceil(right)), min(height, math.ceil(bottom))
    if x0 >= x1 or y0 >= y1:
        return ()
    side = shown.side_at(0.5 * (left + right))
    ids = read_window(side, (width, height), (x0, y0, x1, y1), ("primId",))["primId"]
    prims = side.scene.engine.drawn_paths()
    return tuple(prims[number] for number in np.unique(ids[ids >= 0]))


def _nearest(reading: PixelProbe) -> tuple[int, int] | None:
    """Return row and column of the hit nearest to the pointer."""
    rows, columns = np.nonzero(reading.arrays["primId"] >= 0)
    if rows.size == 0:
        return None
    apart = (rows - reading.row) ** 2 + (columns - reading.column) ** 2
    nearest = int(np.argmin(apart))
    return (int(rows[nearest]), int(columns[nearest])) if apart[nearest] <= REACH**2 else None


def _splat(scene: RenderScene, path: str, index: int, row: int) -> Splat | None:
    """Return the values of a splat; None if the prim is not a field."""
    for _, field, instance in scene.drawn():
        if (instance.path, instance.index) != (path, index):
            continue
        cloud, to_world = field.spec.cloud, matrix(instance.transform)
        center = cloud.positions[row]
        w, i, j, k = cloud.rotations[row].tolist()
        return Splat(
            center=vector(center),
            world_center=vector(to_world[:3, :3] @ center + to_world[:3, 3]),
            scales=vector(cloud.scales[row]),
            rotation=(w, i, j, k),
            opacity=float(cloud.opacities[row]),
            color=vector(dc_to_rgb(cloud.sh[row, 0])),
            sh_degree=cloud.sh_degree,
            id=int(row if cloud.ids is None else cloud.ids[row]),
        )
    return None
