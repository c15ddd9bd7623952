"""Tests of affectors as solid bodies."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Ts, Usd, UsdGeom

from tests.sim.stage.stages import field_of, make_stage, moved, place, rigid, world
from usdsplat.core.errors import StageError
from usdsplat.sim.specs import Solid
from usdsplat.sim.stage.affectors import AffectorReader
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space

ONE = Usd.TimeCode(1)


def reader(stage: Usd.Stage, prim: Usd.Prim, kind: str = "local") -> AffectorReader:
    """An affector of the stage's field."""
    return AffectorReader(prim, Space(field_of(stage), kind, ONE), Rigs())


def define(stage: Usd.Stage, kind: str, **values: object) -> Usd.Prim:
    """An affector with these attributes."""
    prim = stage.DefinePrim("/World/Body", kind)
    prim.ApplyAPI("SplatAffectorAPI")
    for name, value in values.items():
        prim.GetAttribute(name.replace("__", ":")).Set(value)
    return prim


def inside(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Whether points of the simulation's space are in a solid, by its definition."""
    p = moved(np.linalg.inv(solid.matrix), points)
    if solid.kind == "sphere":
        return np.linalg.norm(p, axis=1) < solid.size[0]
    if solid.kind == "box":
        return (np.abs(p) < solid.size).all(axis=1)
    if solid.kind == "plane":
        return p[:, 2] < 0
    low, high, half = solid.size
    assert low == high  # a capsule proper
    t = np.clip(p[:, 2], -half, half)
    return np.linalg.norm(p - t[:, None] * [0, 0, 1], axis=1) < low


def meant(kind: str, p: np.ndarray, axis: int) -> np.ndarray:
    """Whether points of a prim's own space are in it, by UsdGeom's words: radius 0.7, height 1.2,
    size 1.3."""
    if kind == "Sphere":
        return np.linalg.norm(p, axis=1) < 0.7
    if kind == "Cube":
        return (np.abs(p) < 0.65).all(axis=1)
    if kind == "Plane":
        return p[:, axis] < 0
    off = p.copy()
    off[:, axis] -= np.clip(p[:, axis], -0.6, 0.6)
    return np.linalg.norm(off, axis=1) < 0.7


SIZES = {
    "Sphere": {"radius": 0.7},
    "Cube": {"size": 1.3},
    "Capsule": {"radius": 0.7, "height": 1.2},
    "Plane": {},
}


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("axis", "XYZ")
@pytest.mark.parametrize("kind", SIZES)
def test_shapes_hold_what_usdgeom_says_they_hold(kind: str, axis: str, mirrored: bool) -> None:
    """Oracle: UsdGeom's definitions in the prim's own space, and USD's transforms; the field is
    placed and scaled itself."""
    stage = make_stage()
    place(field_of(stage), rigid(1, 0.4))
    prim = define(stage, kind, **SIZES[kind])
    if kind in ("Capsule", "Plane"):
        prim.GetAttribute("axis").Set(axis)
    place(prim, rigid(2, 1.7, mirrored))
    found = reader(stage, prim).at(ONE)
    (solid,) = found.solids
    assert solid.kind == {"Cube": "box"}.get(kind, kind.lower())
    assert np.linalg.det(solid.matrix[:3, :3]) == pytest.approx(1, abs=1e-9)
    own = np.random.default_rng(0).uniform(-1.5, 1.5, (4000, 3))
    to_field = np.linalg.inv(world(field_of(stage))) @ world(prim)
    expected = meant(kind, own, "XYZ".index(axis))
    assert 0.02 < expected.mean() < 0.98
    assert (inside(solid, moved(to_field, own)) == expected).all()


@pytest.mark.parametrize("axis", "XYZ")
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_capsule_of_two_radii_keeps_its_ends(mirrored: bool, axis: str) -> None:
    """Oracle: where UsdGeom puts the two centres."""
    stage = make_stage()
    prim = define(stage, "Capsule_1", radiusBottom=0.2, radiusTop=0.5, height=3.0, axis=axis)
    place(prim, rigid(5, 2.0, mirrored))
    (solid,) = reader(stage, prim).at(ONE).solids
    assert solid.size == pytest.approx((0.4, 1.0, 3.0))
    ends = moved(solid.matrix, np.array([[0, 0, -3.0], [0, 0, 3.0]]))
    along = np.eye(3)["XYZ".index(axis)] * 1.5
    assert np.allclose(ends, moved(world(prim), [-along, along]), atol=1e-9)


@pytest.mark.parametrize("kind", ["Sphere", "Capsule", "Cube"])
def test_a_shape_that_is_scaled_unevenly_is_its_triangles(kind: str) -> None:
    """Oracle: its points, taken back to the prim's space, lie on UsdGeom's surface; triangles face
    outwards; the body is rigid and turns by its matrix."""
    stage = make_stage()
    prim = define(stage, kind, **SIZES[kind])
    for time in (1, 5):
        place(prim, rigid(time) @ np.diag([1.0, 2.0, -0.5, 1.0]), time)
    affector = reader(stage, prim)
    surfaces = []
    for time in (1, 5):
        (solid,) = affector.at(Usd.TimeCode(time)).solids
        assert solid.kind == "mesh" and solid.is_rigid and solid.surface is not None
        surfaces.append(solid.surface)
        points = moved(solid.matrix, solid.surface.points)
        own = moved(np.linalg.inv(world(prim, time)), points)
        shrunk, grown = own * 0.995, own * 1.005
        assert meant(kind, shrunk, 2).all() and not meant(kind, grown, 2).any()
        a, b, c = (points[solid.surface.triangles[:, i]] for i in range(3))
        volume = np.einsum("ti,ti->", a - points.mean(axis=0), np.cross(b - a, c - a)) / 6
        assert volume > 0
    assert surfaces[0] is surfaces[1]


def test_radius_scale_makes_shapes_larger_about_themselves() -> None:
    """Oracle: by hand."""
    stage = make_stage()
    prim = define(stage, "Sphere", radius=2.0, splatSim__affector__radiusScale=1.5)
    assert reader(stage, prim).at(ONE).solids[0].size[0] == pytest.approx(3)
    mesh = mesh_body(stage)
    mesh.CreateAttribute("splatSim:affector:radiusScale", Sdf.ValueTypeNames.Float).Set(2.0)
    (solid,) = reader(stage, mesh).at(ONE).solids
    assert solid.surface is not None
    assert np.allclose(solid.surface.points[2], [2, 2, 0])


def mesh_body(stage: Usd.Stage) -> Usd.Prim:
    """A unit square."""
    mesh = UsdGeom.Mesh.Define(stage, "/World/Square")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    return mesh.GetPrim()


def test_a_mesh_that_is_moved_is_rigid_and_one_whose_points_move_is_not() -> None:
    """Oracle: USD's transforms and samples; a deformed one is in the simulation's space."""
    stage = make_stage()
    place(field_of(stage), rigid(7, 2.0))
    mesh = mesh_body(stage)
    for time in (1, 9):
        place(mesh, rigid(time, 3.0), time)
    points = np.array(mesh.GetAttribute("points").Get())
    affector = reader(stage, mesh)
    to_field = np.linalg.inv(world(field_of(stage)))
    for time in (1, 9):
        (solid,) = affector.at(Usd.TimeCode(time)).solids
        assert solid.is_rigid and solid.surface is not None
        expected = moved(to_field @ world(mesh, time), points)
        assert np.allclose(moved(solid.matrix, solid.surface.points), expected, atol=1e-6)
    mesh.GetAttribute("points").Set([Gf.Vec3f(*p) for p in (points * 2).tolist()], 1)
    mesh.GetAttribute("points").Set([Gf.Vec3f(*p) for p in (points * 4).tolist()], 3)
    (solid,) = reader(stage, mesh).at(Usd.TimeCode(2)).solids
    assert not solid.is_rigid and (solid.matrix == np.eye(4)).all() and solid.surface is not None
    expected = moved(to_field @ world(mesh, 2), points * 3)
    assert np.allclose(solid.surface.points, expected, atol=1e-5)


def test_a_plane_that_is_sheared_is_a_plane() -> None:
    """Oracle: points either side of it in its own space."""
    stage = make_stage()
    prim = define(stage, "Plane", axis="X")
    matrix = np.eye(4)
    matrix[:3, :3] = np.random.default_rng(2).normal(size=(3, 3))
    matrix[:3, 3] = 1, 2, 3
    place(prim, matrix)
    (solid,) = reader(stage, prim).at(ONE).solids
    own = np.random.default_rng(3).normal(size=(1000, 3))
    assert (inside(solid, moved(matrix, own)) == (own[:, 0] < 0)).all()


def test_in_the_stages_space_the_fields_way_does_not_count() -> None:
    """Oracle: the field's place at the start; local is where it is now."""
    stage = make_stage()
    for time in (1, 9):
        place(field_of(stage), rigid(time, 2.0), time)
    prim = define(stage, "Sphere")
    place(prim, rigid(30))
    for kind, when in (("world", 1), ("local", 9)):
        (solid,) = reader(stage, prim, kind).at(Usd.TimeCode(9)).solids
        expected = moved(
            np.linalg.inv(world(field_of(stage), when)) @ world(prim), np.zeros((1, 3))
        )
        assert np.allclose(solid.matrix[:3, 3], expected[0], atol=1e-9)


def test_what_cannot_be_an_affector_is_one_sentence() -> None:
    """Oracle: the sentences."""
    stage = make_stage()
    with pytest.raises(StageError, match="/World/Cone: found an affector of type Cone, expected "):
        reader(stage, UsdGeom.Cone.Define(stage, "/World/Cone").GetPrim())
    prim = define(stage, "Sphere", radius=-1.0)
    with pytest.raises(StageError, match=r"/World/Body.radius: found -1.0, expected 0 or more"):
        reader(stage, prim).at(ONE)
    place(field_of(stage), np.diag([1.0, 0.0, 1.0, 1.0]))
    with pytest.raises(StageError, match="/World/Field at 1: found a singular transform"):
        reader(stage, prim)


def test_a_scale_that_a_spline_makes_uneven_is_noticed() -> None:
    """Oracle: by hand: an even scale at the start, an uneven one at the second knot."""
    stage = make_stage()
    prim = define(stage, "Sphere")
    attribute = UsdGeom.Xformable(prim).AddScaleXOp(UsdGeom.XformOp.PrecisionDouble).GetAttr()
    spline = Ts.Spline("double")
    for time, value in ((1.0, 1.0), (9.0, 2.0)):
        spline.SetKnot(Ts.Knot(typeName="double", time=time, value=value))
    attribute.SetSpline(spline)
    (solid,) = reader(stage, prim).at(Usd.TimeCode(9)).solids
    assert solid.kind == "mesh" and solid.surface is not None and not solid.is_rigid
    assert np.ptp(solid.surface.points, axis=0) == pytest.approx([4, 2, 2], abs=1e-5)


def test_a_field_that_becomes_uneven_makes_shapes_uneven_in_its_own_space() -> None:
    """Oracle: by hand; in the stage's space, which stays as it was at the start, they are not."""
    stage = make_stage()
    prim = define(stage, "Sphere")
    place(field_of(stage), np.eye(4), 1)
    place(field_of(stage), np.diag([1.0, 2.0, 1.0, 1.0]), 9)
    (solid,) = reader(stage, prim, "local").at(Usd.TimeCode(9)).solids
    assert solid.kind == "mesh" and solid.surface is not None
    assert np.ptp(solid.surface.points, axis=0) == pytest.approx([2, 1, 2], abs=1e-5)
    assert reader(stage, prim, "world").at(Usd.TimeCode(9)).solids[0].kind == "sphere"
