"""Tests of what is drawn over a picture: figures of lights, bounds, and edges of meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, UsdGeom, UsdLux

from tests.preview.documents import STATE, drawn_by
from usdsplat.preview import boxes, overlays
from usdsplat.preview.overlays import LightMark, Overlays, edges_of
from usdsplat.render.specs import MeshSpec


def mark(shape, size=(0.0, 0.0)):
    """A light at (1, 2, 3), turned a quarter about y and twice as large: -z goes to -x."""
    matrix = np.array([[0, 0, 2.0, 1], [0, 2, 0, 2], [-2, 0, 0, 3], [0, 0, 0, 1]])
    return LightMark(path="/L", shape=shape, matrix=tuple(matrix.ravel()), size=size)


def test_figures_of_lights_have_their_place_and_size():
    """Oracle: written down by hand: distances and corners in the world."""
    for line in mark("sphere", (1.5, 0.0)).figure(1.0):
        np.testing.assert_allclose(np.linalg.norm(line - (1, 2, 3), axis=1), 3.0)
    outline, ahead = mark("rect", (2.0, 1.0)).figure(5.0)
    np.testing.assert_allclose(outline[:4, 0], 1.0)
    np.testing.assert_allclose(np.ptp(outline, axis=0), (0.0, 2.0, 4.0))
    np.testing.assert_allclose(ahead, [(1, 2, 3), (-4, 2, 3)])
    (direction,) = mark("distant").figure(2.0)
    np.testing.assert_allclose(direction[1], (-1, 2, 3))
    rings = list(mark("cylinder", (0.5, 4.0)).figure(1.0))[:2]
    np.testing.assert_allclose([ring.mean(axis=0)[2] for ring in rings], (7.0, -1.0), atol=0.05)
    for line in mark("dome").figure(2.0):
        np.testing.assert_allclose(np.linalg.norm(line - (1, 2, 3), axis=1), 2.0)
    assert not list(mark("sphere").figure(1.0))


def test_edges_are_those_between_authored_faces():
    """Oracle: counted by hand: two squares side by side have seven edges; a surface of one face
    has those of its triangles."""
    points = np.array([(x, y, 0) for y in (0, 1) for x in (0, 1, 2)], np.float32)
    triangles = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)], np.int32)
    spec = MeshSpec(points=points, triangles=triangles, faces=np.array([0, 0, 1, 1], np.int32))
    edges = edges_of(spec)
    assert len(edges) == 7
    np.testing.assert_allclose(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1), 1.0)
    assert len(edges_of(replace(spec, faces=np.zeros(4, np.int32)))) == 9


@pytest.fixture
def lit(stage):
    """The stage with a light that moves, one that is hidden, and a plate of two faces."""
    light = UsdLux.SphereLight.Define(stage, "/Lights/Key")
    light.CreateRadiusAttr(0.25)
    move = light.AddTranslateOp()
    for time, x in ((1, 0.0), (5, 8.0)):
        move.Set(Gf.Vec3d(x, 1, 2), time)
    UsdGeom.Imageable(UsdLux.RectLight.Define(stage, "/Lights/Hidden")).MakeInvisible()
    plate = UsdGeom.Mesh.Define(stage, "/World/Plate")
    plate.CreatePointsAttr([(x, y, 0) for y in (0, 1) for x in (0, 1, 2)])
    plate.CreateFaceVertexCountsAttr([4, 4])
    plate.CreateFaceVertexIndicesAttr([0, 1, 4, 3, 1, 2, 5, 4])
    plate.CreateSubdivisionSchemeAttr("none")
    return stage


def test_lights_are_where_they_are_at_the_time(document, events, lit):
    """Oracle: the samples of the stage, halfway; hidden lights and unasked ones have no mark."""
    state = replace(STATE, time=3.0, shows_lights=True)
    drawn_by(document, state)
    (found,) = events.pictures[-1].overlays.lights
    assert (found.path, found.shape, found.size) == ("/Lights/Key", "sphere", (0.25, 0.0))
    np.testing.assert_allclose(found.place, (4, 1, 2))
    drawn_by(document, replace(STATE, time=3.0))
    assert events.pictures[-1].overlays == Overlays()
    UsdLux.DomeLight.Define(lit, "/Lights/Sky")
    drawn_by(document, state)
    shapes = [each.shape for each in events.pictures[-1].overlays.lights]
    assert shapes == ["sphere", "dome"]


def test_bounds_and_edges_are_there_if_they_are_asked_for(document, events, lit):
    """Oracle: the prims of the stage: two fields, and a plate of seven edges."""
    drawn_by(document, STATE)
    assert events.pictures[-1].overlays.edges == events.pictures[-1].overlays.bounds == ()
    state = replace(STATE, shows_bounds=True, shows_edges=True, selected=("/World/A",))
    drawn_by(document, state)
    over = events.pictures[-1].overlays
    assert (len(over.bounds), len(over.boxes)) == (3, 1)
    (edges,) = over.edges
    assert edges.segments.shape == (7, 2, 3) and edges.segments.max() == 2.0
    count = len(events.pictures)
    drawn_by(document, state)
    assert len(events.pictures) == count, "nothing has changed"


def test_bounds_are_those_of_each_prim_and_made_once(document, events, lit, monkeypatch):
    """Oracle: the box of each path by itself, of a field with a mesh below it too; counted: one
    pass for a version of the scene, however many pictures."""
    child = UsdGeom.Mesh.Define(lit, "/World/A/Plate")
    child.CreatePointsAttr([(9, 9, 9), (8, 8, 9), (9, 8, 7)])
    child.CreateFaceVertexCountsAttr([3])
    child.CreateFaceVertexIndicesAttr([0, 1, 2])
    passes, whole = [], boxes.of_each

    def counted(scene, paths):
        passes.append(tuple(paths))
        return whole(scene, paths)

    monkeypatch.setattr(boxes, "of_each", counted)
    for width in (64, 65, 66):
        drawn_by(document, replace(STATE, shows_bounds=True, size=(width, 48)))
    scene = document.engine.render_scene
    alone = tuple(boxes.drawn(scene, path) for path in scene.prims())
    assert len(alone) == 4 and events.pictures[-1].overlays.bounds == alone
    every = scene.prims()
    assert passes.count(every) == 1
    child.GetPointsAttr().Set([(5, 5, 5), (4, 4, 5), (5, 4, 3)])
    drawn_by(document, replace(STATE, shows_bounds=True))
    assert passes.count(every) == 2 and events.pictures[-1].overlays.bounds != alone


def test_edges_are_dropped_when_they_are_off(document, lit, monkeypatch):
    """Oracle: counted: the edges of the plate are found again when they are on again."""
    found = []
    monkeypatch.setattr(overlays, "edges_of", lambda spec: found.append(spec) or edges_of(spec))
    shown = replace(STATE, shows_edges=True)
    for state in (shown, replace(shown, size=(65, 48)), STATE, shown):
        drawn_by(document, state)
    assert len(found) == 2


@pytest.mark.parametrize("is_authored", [True, False])
def test_of_many_faces_some_have_edges(monkeypatch, is_authored):
    """Oracle: counted: a strip of 40 squares; of 80 triangles at most 20 are looked at, of whole
    squares, whose diagonals are left out."""
    points = np.array([(x, y, 0) for x in range(41) for y in (0, 1)], np.float32)
    first = 2 * np.arange(40)[:, None]
    triangles = (first + np.array([0, 2, 3, 0, 3, 1])).reshape(-1, 3).astype(np.int32)
    faces = np.repeat(np.arange(40), 2).astype(np.int32)
    spec = MeshSpec(points=points, triangles=triangles, faces=faces if is_authored else 0 * faces)
    assert len(edges_of(spec)) == (121 if is_authored else 161)
    monkeypatch.setattr(overlays, "MOST_FACES", 20)
    edges = edges_of(spec)
    assert len(edges) == (40 if is_authored else 60)
    lengths = np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1)
    assert (lengths.max() == 1.0) == is_authored
