"""What is drawn over a picture: boxes, edges of meshes, and figures of lights, as world lines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.preview.boxes import Corners
from usdsplat.render.scene import RenderScene, matrix
from usdsplat.render.specs import Matrix, MeshSpec

LightShape = Literal["sphere", "disk", "rect", "cylinder", "distant", "dome"]
MOST_EDGES = 20_000
"""Number of edges that are drawn of all meshes together; of more, a part of each mesh."""
MOST_FACES = 100_000
"""Number of triangles whose edges are looked for in one mesh; of more, some authored faces."""
ROUND = 32
"""Sides of the polygon that stands for a circle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightMark:
    """The place and shape of a light on the stage."""

    path: str
    shape: LightShape
    matrix: Matrix
    """Local to world [scene unit]."""
    size: tuple[float, float] = (0.0, 0.0)
    """Radius, width and height, or radius and length [local unit]; zeros for a point and for lights
    without an extent."""

    @property
    def place(self) -> F64:
        """Origin of the light in the world, shape (3,)."""
        return np.reshape(self.matrix, (4, 4))[:3, 3]

    @property
    def has_place(self) -> bool:
        """Whether it is anywhere: a dome and a distant light at the origin were never moved."""
        return self.shape not in ("dome", "distant") or bool(self.place.any())

    def figure(self, length: float) -> Iterator[F64]:
        """Yield lines in world space that show the light's shape, each as points, shape (n, 3).

        Args:
            length: Length of what has none of its own, such as a direction [scene unit].
        """
        to_world = np.reshape(self.matrix, (4, 4))
        turn = to_world[:3, :3] / np.maximum(np.linalg.norm(to_world[:3, :3], axis=0), 1e-300)
        ahead = self.place + np.array(((0, 0, 0), (0, 0, -length))) @ turn.T
        one, other = self.size
        lines: list[F64] = []
        if self.shape == "sphere":
            lines = [one * circle(axis) for axis in range(3)] if one > 0 else []
        elif self.shape == "disk":
            lines = [one * circle(2)]
        elif self.shape == "rect":
            corners = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
            lines = [np.array([(x * one / 2, y * other / 2, 0.0) for x, y in corners])]
        elif self.shape == "cylinder":
            ends = [np.array((x * other / 2, 0.0, 0.0)) for x in (-1, 1)]
            lines = [one * circle(0) + end for end in ends]
            sides = [one * circle(0)[number] for number in range(0, ROUND, ROUND // 4)]
            lines += [np.array([end + side for end in ends]) for side in sides]
        elif self.shape == "dome":
            up = np.linspace(0.0, math.pi, ROUND // 2)
            arc = np.stack([np.cos(up), np.sin(up), 0 * up], axis=1)
            for line in (circle(1), arc, arc[:, [2, 1, 0]]):
                yield self.place + length * line @ turn.T
            return
        for line in lines:
            yield line @ to_world[:3, :3].T + self.place
        if self.shape in ("disk", "rect", "distant"):
            yield ahead


@dataclass(frozen=True, slots=True, eq=False)
class MeshEdges:
    """The edges of the faces of one appearance of a mesh."""

    segments: F32
    """Ends in local space [scene unit], shape (n, 2, 3)."""
    to_world: F64
    """Shape (4, 4)."""
    path: str = ""
    """Path of the prim that a click on them selects; "" for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlays:
    """Everything that is drawn over a picture."""

    boxes: tuple[Corners, ...] = ()
    """Of the selected prims that have one, in the order of the selection."""
    bounds: tuple[Corners, ...] = ()
    """Of all drawn prims; empty if they are not asked for."""
    lights: tuple[LightMark, ...] = ()
    edges: tuple[MeshEdges, ...] = ()
    """Of all meshes; empty if they are not asked for."""
    affectors: tuple[MeshEdges, ...] = ()
    """Of what acts on simulations and is not drawn; empty if they are not asked for."""


class Wireframe:
    """The edges of the meshes of a scene; those of unchanged meshes are kept while shown."""

    def __init__(self) -> None:
        self._segments: dict[int, tuple[MeshSpec, F32]] = {}
        self._last: tuple[int, tuple[MeshEdges, ...]] = (-1, ())

    def forget(self) -> None:
        """Drop all edges; they are not shown."""
        self._segments, self._last = {}, (-1, ())

    def of(self, scene: RenderScene, version: int) -> tuple[MeshEdges, ...]:
        """Return the edges; the same objects while the version of the scene is the same."""
        if self._last[0] != version:
            drawn = scene.drawn_meshes()
            known = {id(mesh.spec): mesh.spec for _, mesh, _ in drawn}
            self._segments = {
                key: self._segments.get(key) or (spec, edges_of(spec))
                for key, spec in known.items()
            }
            total = sum(len(self._segments[id(mesh.spec)][1]) for _, mesh, _ in drawn)
            step = max(1, -(-total // MOST_EDGES))
            found = tuple(
                MeshEdges(self._segments[id(mesh.spec)][1][::step], matrix(instance.transform))
                for _, mesh, instance in drawn
            )
            self._last = version, found
        return self._last[1]


def edges_of(spec: MeshSpec) -> F32:
    """Return the edges of a mesh's authored faces: two ends in its local space, shape (n, 2, 3).

    The edges inside a face, which its triangulation made, are left out. A surface without authored
    faces, such as a sphere, counts as one face, and has those of all triangles. Of more than
    `MOST_FACES` triangles, those of every so many faces are taken.
    """
    triangles, faces = spec.triangles, spec.faces
    has_faces = len(faces) > 0 and faces.min() < faces.max()
    step = -(-len(triangles) // MOST_FACES)
    if step > 1:
        kept = (faces if has_faces else np.arange(len(triangles))) % step == 0
        triangles, faces = triangles[kept], faces[kept] if has_faces else faces
    pairs = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    keys = pairs.min(axis=1) * len(spec.points) + pairs.max(axis=1)
    if has_faces:
        owners = np.repeat(faces, 3)
        order = np.lexsort((owners, keys))
        keys, owners = keys[order], owners[order]
        is_same = (keys[1:] == keys[:-1]) & (owners[1:] == owners[:-1])
        is_inner = np.concatenate([[False], is_same]) | np.concatenate([is_same, [False]])
        keys = keys[~is_inner]
    drawn = np.stack(np.divmod(np.unique(keys), max(len(spec.points), 1)), axis=1)
    return np.asarray(spec.points[drawn], np.float32)


def edges_between(corners: npt.NDArray[np.int64], counts: npt.NDArray[np.int64]) -> I32:
    """Return the edges of polygons, each once, as pairs of points, shape (n, 2).

    Args:
        corners: Points of all polygons, one after the other.
        counts: Number of corners of each polygon, 1 or more.
    """
    ends = np.cumsum(counts)
    after = np.arange(1, len(corners) + 1)
    after[ends - 1] = ends - counts
    pairs = np.sort(np.stack([corners, corners[after]], axis=1), axis=1)
    return np.unique(pairs, axis=0).astype(np.int32)


def circle(axis: int) -> F64:
    """Return a circle of radius 1 around an axis, closed, shape (n, 3)."""
    angle = np.linspace(0.0, 2.0 * math.pi, ROUND + 1)
    points = np.zeros((ROUND + 1, 3))
    points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = np.cos(angle), np.sin(angle)
    return points
