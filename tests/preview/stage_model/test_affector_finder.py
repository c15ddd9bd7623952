"""Tests of the outlines of affectors and targets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.preview.simulating.hosts import shot
from tests.sim.stage.stages import simulation_of
from usdsplat.preview.overlays import edges_between
from usdsplat.preview.stage_model.affector_finder import AffectorFinder
from usdsplat.schema import is_splat_field
from usdsplat.sim.stage.authoring import author

DRAWN = ("default", "render")


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """A simulation with a ball, a guide that moves along x, and an affector that is drawn."""
    stage = shot(tmp_path, {})
    for prim in stage.Traverse():
        if UsdGeom.Gprim(prim) and prim.GetPath() != Sdf.Path("/World/Ball"):
            UsdGeom.Imageable(prim).CreatePurposeAttr("default")
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(2.0)
    ball.CreatePurposeAttr("guide")
    move = ball.AddTranslateOp()
    move.Set((0, 0, 0), 1)
    move.Set((8, 0, 0), 5)
    author(ball.GetPrim(), {"affector:role": "collide"})
    link = simulation_of(stage).CreateRelationship("collection:affectors:includes", custom=False)
    link.AddTarget("/World/Ball")
    return stage


def test_a_guide_that_acts_is_outlined_where_it_is(stage: Usd.Stage) -> None:
    """Oracle: all points are one radius from the centre at the time."""
    finder = AffectorFinder(stage)
    for time, middle in ((1.0, 0.0), (3.0, 4.0)):
        (edges,) = finder.of(time, DRAWN)
        points = edges.segments.reshape(-1, 3) @ edges.to_world[:3, :3].T + edges.to_world[:3, 3]
        np.testing.assert_allclose(points.mean(axis=0), (middle, 0, 0), atol=0.1)
        np.testing.assert_allclose(np.linalg.norm(points - (middle, 0, 0), axis=1), 2.0, rtol=1e-5)


def test_outlines_follow_edits_of_shapes_and_of_what_acts(stage: Usd.Stage) -> None:
    """Oracle: the new radius; a target that was added is outlined, one that was removed is not."""
    finder = AffectorFinder(stage)
    (before,) = finder.of(1.0, DRAWN)
    UsdGeom.Sphere(stage.GetPrimAtPath("/World/Ball")).GetRadiusAttr().Set(3.0)
    (edges,) = finder.of(1.0, DRAWN)
    np.testing.assert_allclose(edges.segments, before.segments * 1.5, rtol=1e-6)
    other = UsdGeom.Sphere.Define(stage, "/World/Other")
    other.CreateRadiusAttr(0.5)
    other.CreatePurposeAttr("guide")
    author(other.GetPrim(), {"affector:role": "collide"})
    assert len(finder.of(1.0, DRAWN)) == 1
    link = simulation_of(stage).GetRelationship("collection:affectors:includes")
    link.AddTarget("/World/Other")
    assert len(finder.of(1.0, DRAWN)) == 2
    link.RemoveTarget("/World/Ball")
    (edges,) = finder.of(1.0, DRAWN)
    np.testing.assert_allclose(np.linalg.norm(edges.segments, axis=2), 0.5, rtol=1e-6)


def test_outlines_are_kept_while_splats_and_places_change(stage: Usd.Stage) -> None:
    """Oracle: the same array."""
    finder = AffectorFinder(stage)
    (before,) = finder.of(1.0, DRAWN)
    field = next(prim for prim in stage.Traverse() if is_splat_field(prim))
    field.GetAttribute("positions").Set(field.GetAttribute("positions").Get(), 2.0)
    stage.GetPrimAtPath("/World/Ball").GetAttribute("xformOp:translate").Set((9, 0, 0), 9)
    (edges,) = finder.of(1.0, DRAWN)
    assert edges.segments is before.segments


def test_what_is_drawn_or_hidden_has_no_outline(stage: Usd.Stage) -> None:
    """Oracle: the purposes that are drawn, and visibility."""
    finder = AffectorFinder(stage)
    assert finder.of(1.0, (*DRAWN, "guide")) == ()
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Ball")).MakeInvisible()
    assert finder.of(1.0, DRAWN) == ()


def test_targets_to_conform_to_are_outlined_by_the_edges_of_their_faces(
    stage: Usd.Stage,
) -> None:
    """Oracle: a square has four edges, its diagonal is none."""
    plate = UsdGeom.Mesh.Define(stage, "/World/Goal/Plate")
    plate.CreatePointsAttr([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
    plate.CreateFaceVertexCountsAttr([4])
    plate.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    plate.CreatePurposeAttr("guide")
    link = simulation_of(stage).CreateRelationship("splatSim:conform:target", custom=False)
    link.SetTargets(["/World/Goal"])
    found = AffectorFinder(stage).of(1.0, DRAWN)
    lengths = [np.linalg.norm(np.diff(each.segments, axis=1), axis=(1, 2)) for each in found]
    assert [2.0] * 4 in [each.tolist() for each in lengths]


def test_a_dense_mesh_is_outlined_by_its_box(stage: Usd.Stage) -> None:
    """Oracle: the twelve edges of a box of the size of the points."""
    side = np.linspace(0.0, 1.0, 30)
    grid = np.stack([*map(np.ravel, np.meshgrid(2 * side, side)), np.tile([0.0, 3.0], 450)], axis=1)
    first = np.arange(899 - 30)
    plate = UsdGeom.Mesh.Define(stage, "/World/Goal")
    plate.CreatePointsAttr(grid.tolist())
    plate.CreateFaceVertexCountsAttr([3] * len(first))
    corners = np.stack([first, first + 1, first + 30], axis=1)
    plate.CreateFaceVertexIndicesAttr(corners.ravel().tolist())
    plate.CreatePurposeAttr("guide")
    link = simulation_of(stage).CreateRelationship("splatSim:conform:target", custom=False)
    link.SetTargets(["/World/Goal"])
    (box,) = [each for each in AffectorFinder(stage).of(1.0, DRAWN) if len(each.segments) == 12]
    lengths = np.linalg.norm(np.diff(box.segments, axis=1), axis=(1, 2))
    np.testing.assert_allclose(np.sort(lengths), [1.0] * 4 + [2.0] * 4 + [3.0] * 4, rtol=1e-6)


def test_each_edge_of_polygons_comes_once() -> None:
    """Oracle: written down by hand: two triangles and a quad that share edges."""
    corners, counts = np.array([0, 1, 2, 2, 1, 3, 0, 2, 4, 5]), np.array([3, 3, 4])
    expected = {(0, 1), (1, 2), (0, 2), (1, 3), (2, 3), (2, 4), (4, 5), (0, 5)}
    assert set(map(tuple, edges_between(corners, counts).tolist())) == expected
