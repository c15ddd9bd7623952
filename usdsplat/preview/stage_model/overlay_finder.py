"""Find what is drawn over the pictures of a stage: boxes, lights, edges, affectors."""

from __future__ import annotations

import math

from pxr import Usd, UsdGeom, UsdLux

from usdsplat.core.errors import StageError
from usdsplat.delegate.engine import Engine
from usdsplat.preview import boxes
from usdsplat.preview.overlays import LightMark, LightShape, Overlays, Wireframe
from usdsplat.preview.stage_model.affector_finder import AffectorFinder
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.preview.values import ViewState
from usdsplat.schema.stage_values import local_to_world, world_bound
from usdsplat.schema.values import value

_SHAPES: tuple[tuple[type, LightShape, tuple[str, ...]], ...] = (
    (UsdLux.SphereLight, "sphere", ("inputs:radius",)),
    (UsdLux.DiskLight, "disk", ("inputs:radius",)),
    (UsdLux.RectLight, "rect", ("inputs:width", "inputs:height")),
    (UsdLux.CylinderLight, "cylinder", ("inputs:radius", "inputs:length")),
    (UsdLux.DistantLight, "distant", ()),
    (UsdLux.DomeLight, "dome", ()),
    (UsdLux.DomeLight_1, "dome", ()),
)


class OverlayFinder:
    """Finder of the overlays of one stage; it needs the stage's lock.

    Args:
        stage: The stage.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._lights: tuple[str, ...] | None = None
        self._wireframe = Wireframe()
        self._affectors = AffectorFinder(stage)
        self._bounds: tuple[int, tuple[boxes.Corners, ...]] = (-1, ())
        """Boxes of all drawn prims, and the version of their scene."""

    def forget(self) -> None:
        """Look for lights and affectors again; the prims of the stage have changed."""
        self._lights = None
        self._affectors.forget()

    def find(self, engine: Engine, state: ViewState) -> Overlays:
        """Return the overlays of a state, whose engine is synced."""
        scene = engine.render_scene
        drawn = boxes.of_each(scene, state.selected)
        found = (drawn[path] or self._extent(engine, path) for path in state.selected)
        if not state.shows_bounds:
            self._bounds = -1, ()
        elif self._bounds[0] != engine.version:
            everything = boxes.of_each(scene, scene.prims()).values()
            self._bounds = engine.version, tuple(filter(None, everything))
        if not state.shows_edges:
            self._wireframe.forget()
        return Overlays(
            boxes=tuple(corners for corners in found if corners),
            bounds=self._bounds[1],
            lights=self.lights(engine.time) if state.shows_lights else (),
            edges=self._wireframe.of(scene, engine.version) if state.shows_edges else (),
            affectors=self._affectors.of(engine.time, state.purposes)
            if state.shows_affectors
            else (),
        )

    def lights(self, time: float | None) -> tuple[LightMark, ...]:
        """Return the visible lights at a time, in the order of the stage."""
        if self._lights is None:
            prims = Usd.PrimRange.Stage(self._stage, Usd.TraverseInstanceProxies())
            self._lights = tuple(str(prim.GetPath()) for prim in prims if _shape(prim))
        code = code_of(time)
        cache = UsdGeom.XformCache(code)
        marks = (self._mark(path, code, cache) for path in self._lights)
        return tuple(mark for mark in marks if mark is not None)

    def outline(self, engine: Engine, path: str) -> boxes.Corners:
        """Return the box of a prim: of its drawn parts, else its extent; () without either."""
        return boxes.drawn(engine.render_scene, path) or self._extent(engine, path)

    # --- private ---------------------------------------------------------------------------

    def _extent(self, engine: Engine, path: str) -> boxes.Corners:
        """Return the box that USD computes of a prim; () without one."""
        prim = self._stage.GetPrimAtPath(path)
        if not prim or not prim.IsA(UsdGeom.Imageable):
            return ()
        tokens = UsdGeom.Imageable.GetOrderedPurposeTokens()
        cache = UsdGeom.BBoxCache(
            code_of(engine.time), tokens, useExtentsHint=True, ignoreVisibility=True
        )
        try:
            bound = world_bound(prim, cache)
        except StageError:
            return ()
        span = bound.GetRange()
        if span.IsEmpty():
            return ()
        points = (bound.GetMatrix().Transform(span.GetCorner(i)) for i in range(8))
        return tuple((point[0], point[1], point[2]) for point in points)

    def _mark(self, path: str, code: Usd.TimeCode, cache: UsdGeom.XformCache) -> LightMark | None:
        """Return the mark of a light; None if it is hidden or its place is invalid."""
        prim = self._stage.GetPrimAtPath(path)
        found = _shape(prim) if prim else None
        if found is None or not prim.IsActive():
            return None
        if UsdGeom.Imageable(prim).ComputeVisibility(code) == UsdGeom.Tokens.invisible:
            return None
        shape, names = found
        try:
            to_world = local_to_world(prim, cache)
        except StageError:
            return None
        numbers = tuple(tuple(row) for row in to_world.GetTranspose())
        sizes = [_number(prim, name, code) for name in names]
        if shape == "sphere" and value(prim.GetAttribute("treatAsPoint"), code):
            sizes = [0.0]
        first, second = (*sizes, 0.0, 0.0)[:2]
        flat = tuple(float(each) for row in numbers for each in row)
        return LightMark(path=path, shape=shape, matrix=flat, size=(first, second))


def _shape(prim: Usd.Prim) -> tuple[LightShape, tuple[str, ...]] | None:
    """Return the shape of a light and the names of its sizes; None for other prims."""
    return next(((shape, names) for kind, shape, names in _SHAPES if prim.IsA(kind)), None)


def _number(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> float:
    """Return a size; 0 for one that is none."""
    found = value(prim.GetAttribute(name), code)
    return float(found) if isinstance(found, float) and math.isfinite(found) else 0.0
