"""Compute boxes of prims in the world, as corners, for outlines and framing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.render.fields import Box
from usdsplat.render.scene import Drawn, DrawnMesh, RenderScene, matrix
from usdsplat.render.specs import FieldSpec, MeshSpec

Point = tuple[float, float, float]
Corners = tuple[Point, ...]
"""Eight corners [scene unit], or none. Corner i is at the maximum of x, y and z where bits 0, 1
and 2 of i are set, so an edge joins two whose numbers differ in one bit."""

SIGMAS = 4.0
"""Number of standard deviations beyond which a splat is invisible."""
HIGH = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], np.float64)


def corners(box: Box, to_world: F64 | None = None) -> Corners:
    """Return the world-space corners of a box; `to_world` is the 4x4 matrix of its space."""
    points = box[0] + HIGH * (box[1] - box[0])
    if to_world is not None:
        points = points @ to_world[:3, :3].T + to_world[:3, 3]
    return tuple((x, y, z) for x, y, z in points.tolist())


def around(points: Iterable[Point]) -> Box | None:
    """Return the axis-aligned bounding box of points, or None without points."""
    array = np.array(list(points), np.float64)
    return (array.min(axis=0), array.max(axis=0)) if array.size else None


def drawn(scene: RenderScene, path: str) -> Corners:
    """Return the box of everything drawn at or below a path; () if nothing is.

    The box of a single instance is aligned with its own axes, that of several with the world's.
    Distant outliers are ignored.
    """
    return of_each(scene, (path,))[path]


def of_each(scene: RenderScene, paths: Sequence[str]) -> dict[str, Corners]:
    """Return what `drawn` returns for each of some paths, in their order, in one pass."""
    found: dict[str, list[Corners]] = {path: [] for path in paths}
    for _, thing, instance in _things(scene) if found else ():
        over = [found[path] for path in _upwards(instance.path) if path in found]
        box = scene.subject_of(thing) if over else None
        if box is not None:
            placed = corners(box, matrix(instance.transform))
            for each in over:
                each.append(placed)
    return {path: _joined(each) for path, each in found.items()}


class Reach:
    """Bounding boxes of everything visible, for clipping: conservative, and fast for splats that
    change every frame."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[FieldSpec | MeshSpec, Box | None]] = {}

    def of(self, scene: RenderScene) -> Box | None:
        """Return the box of a scene; None if it is empty."""
        points: list[Point] = []
        known: dict[str, tuple[FieldSpec | MeshSpec, Box | None]] = {}
        for path, thing, instance in _things(scene):
            if path not in known:
                was = self._known.get(path)
                same = was is not None and was[0] is thing.spec
                known[path] = was if same and was else (thing.spec, _reached(thing.spec))
            box = known[path][1]
            if box is not None:
                points += corners(box, matrix(instance.transform))
        self._known = known
        for _, tree in scene.drawn_trees():
            for instance in tree.instances:
                points += corners(tree.box, matrix(instance.transform))
        return around(points)


def _upwards(path: str) -> Iterator[str]:
    """Yield a path and those of its ancestors, up to "/"."""
    while path not in ("", "/"):
        yield path
        path = path.rpartition("/")[0]
    yield "/"


def _joined(found: list[Corners]) -> Corners:
    """Return the only box, or that around several; () for none."""
    if len(found) == 1:
        return found[0]
    box = around(point for each in found for point in each)
    return corners(box) if box is not None else ()


def _things(scene: RenderScene) -> list[Drawn | DrawnMesh]:
    """Return every drawn instance."""
    return [*scene.drawn(), *scene.drawn_meshes()]


def _reached(spec: FieldSpec | MeshSpec) -> Box | None:
    """Return the box of a field or mesh in its own space."""
    if isinstance(spec, MeshSpec):
        return _span(spec.points, 0.0)
    largest = spec.cloud.scales[np.isfinite(spec.cloud.scales)].max(initial=0.0)
    return _span(spec.cloud.positions, SIGMAS * float(largest))


def _span(points: F32, margin: float) -> Box | None:
    """Return the box of finite points, enlarged by a margin."""
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return None
        low, high = points.min(axis=0), points.max(axis=0)
    return low.astype(np.float64) - margin, high.astype(np.float64) + margin
