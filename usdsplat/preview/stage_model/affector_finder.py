"""Find the outlines of what acts on simulations, which pictures do not show: guides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError
from usdsplat.preview.overlays import MeshEdges, circle, edges_between
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.schema import is_splat_field
from usdsplat.schema.stage_values import local_to_world
from usdsplat.schema.values import value
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.collections import affectors, find_simulations
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.targets import SHAPES, Triangles

MOST_EDGES = 600
"""Maximum number of edges drawn for one affector. More would hide the splats, so its box is drawn
instead."""
_BOX = np.array([(i, i | 1 << axis) for i in range(8) for axis in range(3) if not i & 1 << axis])
"""Edges of a box, as pairs of corners; bit i of a corner is its side along axis i."""
_TARGET = f"{NAMESPACE}:conform:target"


class AffectorFinder:
    """Finder of the outlines of one stage; it needs the stage's lock."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._paths: tuple[str, ...] | None = None
        self._still: dict[str, F32] = {}
        """Edges of those that keep their shape."""
        self._notice = Tf.Notice.Register(Usd.Notice.ObjectsChanged, self._note_change, stage)

    def forget(self) -> None:
        """Look for affectors again; the prims of the stage have changed."""
        self._paths = None
        self._still.clear()

    def of(self, time: float | None, purposes: Sequence[str]) -> tuple[MeshEdges, ...]:
        """Return the outlines of visible affectors and of targets to conform to, at a time.

        Args:
            time: Time code; None is USD's default time.
            purposes: Those that are drawn: what has one of them has no outline.
        """
        if self._paths is None:
            self._paths = tuple(dict.fromkeys(_acting(self._stage)))
        code = code_of(time)
        cache = UsdGeom.XformCache(code)
        return tuple(
            edges
            for path in self._paths
            for edges in self._edges(self._stage.GetPrimAtPath(path), code, cache, purposes)
        )

    def _note_change(self, notice: Usd.Notice.ObjectsChanged, stage: Usd.Stage) -> None:
        changed = (*notice.GetResyncedPaths(), *notice.GetChangedInfoOnlyPaths())
        if any(_shapes(stage, path) for path in changed):
            self.forget()

    def _edges(
        self, prim: Usd.Prim, code: Usd.TimeCode, cache: UsdGeom.XformCache, purposes: Sequence[str]
    ) -> Iterator[MeshEdges]:
        if not prim or not prim.IsActive():
            return
        imageable = UsdGeom.Imageable(prim)
        is_hidden = imageable.ComputeVisibility(code) == UsdGeom.Tokens.invisible
        if is_hidden or imageable.ComputePurpose() in purposes:
            return
        try:
            part = Triangles(prim, Rigs())
            segments = self._still.get(str(prim.GetPath()))
            if segments is None:
                segments = _segments(part, code)
                if not part.varies:
                    self._still[str(prim.GetPath())] = segments
            to_world: F64 = np.array(local_to_world(part.placer, cache), np.float64).T
        except StageError:  # told where it is simulated
            return
        yield MeshEdges(segments, to_world, path=str(prim.GetPath()))


def _shapes(stage: Usd.Stage, path: Sdf.Path) -> bool:
    """Return whether a change at a path may change which affectors there are, or their shapes:
    places and visibility are read anew, and a simulation writes to its fields all the time."""
    if not path.IsPropertyPath():
        return True
    if path.name == UsdGeom.Tokens.visibility or path.name.startswith("xformOp"):
        return False
    return not is_splat_field(stage.GetPrimAtPath(path.GetPrimPath()))


def _acting(stage: Usd.Stage) -> Iterator[str]:
    """Yield the paths of all meshes and shapes that act on a simulation."""
    for simulation in find_simulations(stage):
        found = affectors(stage, simulation)
        link = simulation.GetRelationship(_TARGET)
        targets = link.GetForwardedTargets() if link else []
        found += [prim for each in targets if (prim := stage.GetPrimAtPath(each.GetPrimPath()))]
        for above in found:
            for prim in Usd.PrimRange(above, Usd.TraverseInstanceProxies()):
                if prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in SHAPES:
                    yield str(prim.GetPath())


def _segments(part: Triangles, code: Usd.TimeCode) -> F32:
    """Return edges of a mesh or shape, shape (n, 2, 3): three circles of a sphere, the box of what
    has very many."""
    points, triangles = part.at(code)
    if part.prim.GetTypeName() == "Sphere":
        radius = float(value(part.prim.GetAttribute("radius"), code) or 0.0)
        rings = [radius * circle(axis) for axis in range(3)]
        pairs = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
        return np.concatenate(pairs).astype(np.float32)
    counts = value(part.prim.GetAttribute("faceVertexCounts"), code)
    if counts is None:
        drawn = edges_between(triangles.astype(np.int64).ravel(), np.full(len(triangles), 3))
    else:
        corners = value(part.prim.GetAttribute("faceVertexIndices"), code)
        drawn = edges_between(np.array(corners, np.int64), np.array(counts, np.int64))
    if len(drawn) <= MOST_EDGES:
        return np.asarray(points[drawn], np.float32)
    ends = points.min(axis=0), points.max(axis=0)
    corners = np.array([[ends[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    return np.asarray(corners[_BOX], np.float32)
