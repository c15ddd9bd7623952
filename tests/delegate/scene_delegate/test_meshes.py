"""Tests of UsdGeom meshes and shapes in the renderer's form, and of edits of them."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import random_cloud
from tests.delegate.surface_stages import (
    add_material,
    add_mesh,
    bind,
    colors,
    mesh_at,
    pulled,
    surfaces,
    world_points,
)
from usdsplat import schema
from usdsplat.core.errors import UsageError
from usdsplat.core.surface import gprims
from usdsplat.delegate.engine import Engine


@pytest.fixture
def stage() -> Usd.Stage:
    return Usd.Stage.CreateInMemory()


# --- what is read ------------------------------------------------------------------------------


def test_polygons_become_triangles_of_the_authored_faces(stage):
    """Oracle: by hand."""
    add_mesh(stage, "/M", faces=2)
    with Engine(stage) as engine:
        spec = mesh_at(engine, "/M")
        assert len(spec.points) == 6 and spec.faces.tolist() == [0, 0, 1, 1]
        a, b, c = (spec.points[spec.triangles[:, i]] for i in range(3))
        assert np.allclose(np.cross(b - a, c - a), (0, 0, 1))
        assert spec.normals is None and spec.colors is None and spec.uvs is None
        assert engine.warnings == ()
        assert [material.diffuse for material in spec.materials] == [(0.18, 0.18, 0.18)]


@pytest.mark.parametrize(("authored", "both"), [(None, True), (False, False), (True, True)])
def test_only_what_says_so_is_single_sided(
    stage: Usd.Stage, authored: bool | None, both: bool
) -> None:
    """A mesh without an opinion shows both of its sides. Oracle: what usdview does."""
    mesh = add_mesh(stage, "/M", faces=2)
    if authored is not None:
        UsdGeom.Gprim(mesh).CreateDoubleSidedAttr(authored)
    with Engine(stage) as engine:
        assert mesh_at(engine, "/M").double_sided == both


def test_a_left_handed_mesh_faces_the_other_way_and_double_sides_are_told(stage):
    """Oracle: by hand."""
    mesh = add_mesh(stage, "/M", faces=1)
    mesh.CreateOrientationAttr("leftHanded")
    mesh.CreateDoubleSidedAttr(True)
    with Engine(stage) as engine:
        spec = mesh_at(engine, "/M")
        a, b, c = (spec.points[spec.triangles[:, i]] for i in range(3))
        assert np.allclose(np.cross(b - a, c - a), (0, 0, -1)) and spec.double_sided


@pytest.mark.parametrize("levels", [0, 1, 3])
def test_a_subdivision_surface_is_refined_as_often_as_the_engine_says(stage, levels):
    """Oracle: each level makes four quads of one; shapes and polygons stay as they are."""
    add_mesh(stage, "/Smooth", scheme="catmullClark")
    add_mesh(stage, "/Plain")
    with Engine(stage, refinement=2) as engine:
        assert len(mesh_at(engine, "/Smooth").triangles) == 2 * 2 * 16
        change = pulled(engine, lambda: engine.set_refinement(levels))
        assert change["points"] == (2 if levels != 2 else 0) and not change["topology"]
        assert len(mesh_at(engine, "/Smooth").triangles) == 2 * 2 * 4**levels
        assert len(mesh_at(engine, "/Plain").triangles) == 4
        with Engine(stage, refinement=levels) as fresh:
            assert surfaces(engine) == surfaces(fresh)


@pytest.mark.parametrize("levels", [-1, 6])
def test_a_refinement_out_of_range_is_one_sentence(stage, levels):
    """Oracle: the error."""
    with pytest.raises(UsageError, match="refinement: found"):
        Engine(stage, refinement=levels)
    with Engine(stage) as engine, pytest.raises(UsageError, match="refinement: found"):
        engine.set_refinement(levels)


SHAPES = {
    "Sphere": ({"radius": 2.0}, lambda: gprims.sphere(radius=2.0)),
    "Cube": ({"size": 3.0}, lambda: gprims.cube(size=3.0)),
    "Cone": (
        {"radius": 2.0, "height": 3.0, "axis": "X"},
        lambda: gprims.cone(radius=2.0, height=3.0, axis="X"),
    ),
    "Cylinder": (
        {"radius": 2.0, "height": 3.0, "axis": "Y"},
        lambda: gprims.cylinder(radius=2.0, height=3.0, axis="Y"),
    ),
    "Capsule": (
        {"radius": 2.0, "height": 3.0, "axis": "Z"},
        lambda: gprims.capsule(radius=2.0, height=3.0, axis="Z"),
    ),
    "Plane": (
        {"width": 2.0, "length": 3.0, "axis": "Y"},
        lambda: gprims.plane(width=2.0, length=3.0, axis="Y"),
    ),
    "Cylinder_1": (
        {"radiusBottom": 2.0, "radiusTop": 1.0, "height": 3.0, "axis": "Y"},
        lambda: gprims.cylinder(radius=2.0, top=1.0, height=3.0, axis="Y"),
    ),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_are_of_the_sizes_authored(stage, kind):
    """Oracle: `core.surface.gprims`, called with the same numbers."""
    values, make = SHAPES[kind]
    prim = stage.DefinePrim("/S", kind)
    for name, number in values.items():
        prim.GetAttribute(name).Set(number)
    with Engine(stage) as engine:
        spec, shape = mesh_at(engine, "/S"), make()
        assert np.array_equal(spec.points, shape.points)
        assert np.array_equal(spec.triangles, shape.triangles)
        assert np.array_equal(spec.normals, shape.normals)


@pytest.mark.parametrize("indexed", [False, True])
@pytest.mark.parametrize(
    ("interpolation", "count"),
    [("constant", 1), ("uniform", 2), ("vertex", 6), ("varying", 6), ("faceVarying", 8)],
)
def test_display_colours_reach_the_corners_of_triangles(stage, interpolation, count, indexed):
    """Oracle: the colour of each corner looked up by hand in the authored numbers."""
    mesh = add_mesh(stage, "/M", faces=2)
    values = np.random.default_rng(1).uniform(size=(count, 3)).astype(np.float32)
    primvar = mesh.CreateDisplayColorPrimvar(interpolation)
    order = np.arange(count)[::-1] if indexed else np.arange(count)
    primvar.Set(Vt.Vec3fArray.FromNumpy(values[order]))
    if indexed:
        primvar.SetIndices(Vt.IntArray.FromNumpy(order.astype(np.int32)))
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(2, 4)
    with Engine(stage) as engine:
        spec = mesh_at(engine, "/M")
        for triangle, face, found in zip(spec.triangles, spec.faces, spec.colors, strict=True):
            for point, color in zip(triangle, found, strict=True):
                corner = 4 * face + indices[face].tolist().index(point)
                row = {"constant": 0, "uniform": face, "faceVarying": corner}
                assert np.array_equal(color, values[row.get(interpolation, point)])
        (material,) = spec.materials
        assert material.uses_colors and material.diffuse == (1.0, 1.0, 1.0)


def test_constant_colours_are_inherited_and_shapes_have_one(stage):
    """Oracle: USD's rule that constant primvars are inherited."""
    world = UsdGeom.Xform.Define(stage, "/World")
    add_mesh(stage, "/World/M")
    ball = UsdGeom.Sphere.Define(stage, "/World/S")
    kind = Sdf.ValueTypeNames.Color3fArray
    UsdGeom.PrimvarsAPI(world).CreatePrimvar("displayColor", kind, "constant").Set(
        colors((1, 0.5, 0))
    )
    with Engine(stage) as engine:
        assert (mesh_at(engine, "/World/M").colors == (1, 0.5, 0)).all()
        assert (mesh_at(engine, "/World/S").colors == (1, 0.5, 0)).all()
        ball.CreateDisplayColorAttr(colors((0, 0, 1)))
        assert (mesh_at(engine, "/World/S").colors == (0, 0, 1)).all()


def test_authored_normals_count_for_polygons_only_and_are_made_unit(stage):
    """Oracle: UsdGeomMesh: normals are of polygonal meshes; the primvar counts before them."""
    for path, scheme in (("/P", "none"), ("/S", "catmullClark")):
        mesh = add_mesh(stage, path, scheme=scheme, faces=1)
        mesh.CreateNormalsAttr([Gf.Vec3f(0, 3, 0)] * 4)
        mesh.SetNormalsInterpolation("vertex")
    with Engine(stage) as engine:
        assert (mesh_at(engine, "/P").normals == (0, 1, 0)).all()
        assert np.allclose(mesh_at(engine, "/S").normals, (0, 0, 1))
        api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/P"))
        primvar = api.CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "uniform")
        primvar.Set([Gf.Vec3f(0, 0, -2)])
        assert (mesh_at(engine, "/P").normals == (0, 0, -1)).all()
        primvar.Set([Gf.Vec3f(0, 0, 0)])  # without a direction: the triangle's own
        assert np.allclose(mesh_at(engine, "/P").normals, (0, 0, 1))


def test_points_between_samples_are_interpolated_or_moved_by_velocities(stage):
    """Oracle: the samples; with velocities, points = p + v (t - t0) / timeCodesPerSecond."""
    mesh = add_mesh(stage, "/M", faces=1)
    stage.SetTimeCodesPerSecond(10)
    start = np.array(mesh.GetPointsAttr().Get())
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(start), 0)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(start + np.float32(2)), 10)
    with Engine(stage, time=5) as engine:
        assert np.allclose(mesh_at(engine, "/M").points, start + 1)
        mesh.CreateVelocitiesAttr().Set([Gf.Vec3f(0, 0, 4)] * 4, 0)
        mesh.GetVelocitiesAttr().Set([Gf.Vec3f(0, 0, 4)] * 4, 10)
        assert np.allclose(mesh_at(engine, "/M").points, start + np.array((0, 0, 2)))
        engine.set_time(2.5)
        assert np.allclose(mesh_at(engine, "/M").points, start + np.array((0, 0, 1)))


def test_with_no_time_a_mesh_that_has_samples_only_shows_its_first(stage):
    """Oracle: the samples; splats do the same."""
    mesh = add_mesh(stage, "/M", faces=1)
    points = np.array(mesh.GetPointsAttr().Get())
    mesh.GetPointsAttr().Clear()
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 7)
    with Engine(stage) as engine:
        assert np.array_equal(mesh_at(engine, "/M").points, points)


# --- where they are seen -----------------------------------------------------------------------


def test_meshes_are_scattered_and_hidden_like_fields(stage):
    """Oracle: positions and purposes, by hand."""
    scatter = UsdGeom.PointInstancer.Define(stage, "/Scatter")
    add_mesh(stage, "/Scatter/Leaf", faces=1)
    scatter.CreatePrototypesRel().SetTargets(["/Scatter/Leaf"])
    scatter.CreateProtoIndicesAttr([0, 0])
    scatter.CreatePositionsAttr([Gf.Vec3f(0), Gf.Vec3f(5, 0, 0)])
    add_mesh(stage, "/Guide").CreatePurposeAttr("guide")
    with Engine(stage) as engine:
        drawn = engine.render_scene.drawn_meshes()
        assert [(i.path, i.index, i.transform[3]) for _, _, i in drawn] == [
            ("/Scatter/Leaf", 0, 0.0),
            ("/Scatter/Leaf", 1, 5.0),
        ]
        assert engine.pulls["points"] == 1
        assert engine.meshes() == ["/Guide", "/Scatter/Leaf"]
        engine.set_purposes(("guide",))
        assert [i.path for _, _, i in engine.render_scene.drawn_meshes()] == ["/Guide"]


def instanced(stage):
    """Two native instances of a mesh."""
    add_mesh(stage, "/Asset/M", faces=1)
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    for name in ("One", "Two"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    return stage.GetPrimAtPath("/World/One"), stage.GetPrimAtPath("/World/Two")


def test_instances_share_a_mesh_unless_they_inherit_something_of_their_own(stage):
    """Oracle: one reading for both; two once their looks differ; a fresh engine."""
    one, two = instanced(stage)
    with Engine(stage) as engine:
        assert len(surfaces(engine)) == 2 and engine.pulls["points"] == 1
        bind(one, add_material(stage, "/Looks/Red", (1, 0, 0)))
        assert mesh_at(engine, "/World/One/M").materials[0].diffuse == (1, 0, 0)
        assert mesh_at(engine, "/World/Two/M").materials[0].diffuse == (0.18, 0.18, 0.18)
        kind = Sdf.ValueTypeNames.Color3fArray
        primvar = UsdGeom.PrimvarsAPI(two).CreatePrimvar("displayColor", kind, "constant")
        primvar.Set(colors((0, 1, 0)))
        assert (mesh_at(engine, "/World/Two/M").colors == (0, 1, 0)).all()
        with Engine(stage) as fresh:
            assert surfaces(engine) == surfaces(fresh)
        bind(stage.GetPrimAtPath("/World"), add_material(stage, "/Looks/Blue", (0, 0, 1)))
        two.RemoveProperty("primvars:displayColor")
        assert mesh_at(engine, "/World/One/M").materials[0].diffuse == (1, 0, 0)
        assert mesh_at(engine, "/World/Two/M").materials[0].diffuse == (0, 0, 1)


# --- what cannot be drawn ----------------------------------------------------------------------


def test_a_mesh_without_points_or_faces_is_no_mistake(stage):
    """Oracle: nothing is drawn and nothing said."""
    UsdGeom.Mesh.Define(stage, "/None")
    add_mesh(stage, "/NoFaces", faces=0)
    add_mesh(stage, "/NoPoints").GetPointsAttr().Set(Vt.Vec3fArray())
    with Engine(stage) as engine:
        assert surfaces(engine) == [] and engine.warnings == ()


def set_(path, value):
    return lambda stage: stage.GetAttributeAtPath(path).Set(value)


BROKEN = {
    "an index out of range": (set_("/M.faceVertexIndices", [0, 1, 9, 2, 2, 3, 4, 5]), True),
    "counts that do not add": (set_("/M.faceVertexCounts", [4, 3]), True),
    "points that are not finite": (
        set_("/M.points", [Gf.Vec3f(float("nan"))] + [Gf.Vec3f(0)] * 5),
        True,
    ),
    "an unknown scheme": (set_("/M.subdivisionScheme", "bezier"), True),
    "colours that do not fit": (
        lambda stage: (
            UsdGeom.Mesh.Get(stage, "/M").CreateDisplayColorPrimvar("vertex").Set(colors((1, 1, 1)))
        ),
        False,
    ),
    "normals that do not fit": (set_("/M.normals", [Gf.Vec3f(1)]), False),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_left_out_with_one_sentence_and_comes_back(stage, name):
    """Oracle: the sentence, the other mesh, and the scene before."""
    add_mesh(stage, "/M")
    add_mesh(stage, "/Other")
    breaks, whole = BROKEN[name]
    with Engine(stage) as engine:
        before = surfaces(engine)
        stage.SetEditTarget(stage.GetSessionLayer())
        breaks(stage)
        (warning,) = engine.warnings
        assert warning.startswith("/M") and ": found " in warning
        assert warning.endswith("; it is not drawn" if whole else "; it is left out")
        assert len(surfaces(engine)) == (1 if whole else 2)
        stage.GetSessionLayer().Clear()
        assert engine.warnings == () and surfaces(engine) == before


@pytest.mark.parametrize("kind", ["StringArray", "Float2Array", "Token", "Matrix4d"])
@pytest.mark.parametrize("name", ["points", "faceVertexCounts", "primvars:displayColor", "normals"])
def test_attributes_of_other_types_spoil_only_their_own_prim(stage, name, kind):
    """Oracle: the other mesh is still drawn, and nothing is said about it."""
    mesh = add_mesh(stage, "/M")
    add_mesh(stage, "/Other")
    spec = stage.GetRootLayer().GetPrimAtPath("/M")
    if name in spec.properties:
        del spec.properties[name]
    values = {"StringArray": ["a"] * 40, "Float2Array": [(1, 2)] * 40, "Token": "a"}
    wrong = Sdf.AttributeSpec(spec, name, getattr(Sdf.ValueTypeNames, kind))
    wrong.default = values.get(kind, Gf.Matrix4d(1))
    with Engine(stage) as engine:
        assert world_points(engine, "/Other").shape == (6, 3)
        assert mesh and all(warning.startswith("/M") for warning in engine.warnings)


def test_a_shape_that_splats_are_cropped_by_is_no_surface(stage):
    """Oracle: which shapes are drawn; both come and go with the collection."""
    schema.author(stage, "/Field", random_cloud())
    UsdGeom.Sphere.Define(stage, "/Matte")
    with Engine(stage) as engine:
        assert engine.meshes() == ["/Matte"]
        collection = Usd.CollectionAPI.Apply(stage.GetPrimAtPath("/Field"), "cropInclude")
        collection.CreateIncludesRel().SetTargets(["/Matte"])
        assert engine.meshes() == [] and surfaces(engine) == []
        collection.GetIncludesRel().ClearTargets(True)
        assert engine.meshes() == ["/Matte"]
