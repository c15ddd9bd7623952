"""Tests of bound materials and UsdPreviewSurface networks in the renderer's form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from tests.delegate.surface_stages import (
    add_material,
    add_mesh,
    add_subset,
    add_texture,
    bind,
    colors,
    mesh_at,
    surfaces,
    write_picture,
)
from usdsplat.delegate.engine import Engine

UVS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]], np.float32)


@pytest.fixture
def stage() -> Usd.Stage:
    """A quad with texture coordinates, /M, bound to /Looks/Mat."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_mesh(stage, "/M", faces=1)
    add_uvs(mesh, UVS)
    bind(mesh, add_material(stage, "/Looks/Mat"))
    return stage


@pytest.fixture
def picture(tmp_path: Path) -> str:
    pixels = np.random.default_rng(1).uniform(size=(2, 3, 3)).astype(np.float32)
    return write_picture(tmp_path / "picture.exr", pixels)


def add_uvs(mesh: UsdGeom.Mesh, uvs: np.ndarray, name: str = "st") -> None:
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, kind, "vertex")
    primvar.Set(Vt.Vec2fArray.FromNumpy(uvs.astype(np.float32)))


def shader(stage, path) -> UsdShade.Shader:
    return UsdShade.Shader(stage.GetPrimAtPath(path))


def seen(stage, path="/M"):
    with Engine(stage) as engine:
        assert engine.warnings == ()
        return mesh_at(engine, path)


# --- bindings ----------------------------------------------------------------------------------


def test_the_bound_material_counts_and_not_the_display_colour(stage):
    """Oracle: the value authored."""
    UsdGeom.Mesh.Get(stage, "/M").CreateDisplayColorAttr(colors((1, 0, 0)))
    spec = seen(stage)
    (material,) = spec.materials
    assert material.diffuse == (0.5, 0.25, 0.125) and not material.uses_colors
    assert spec.colors is None


@pytest.mark.parametrize(
    ("purposes", "expected"),
    [(("",), "A"), (("", "preview"), "P"), (("full",), "F"), (("full", "preview"), "P")],
)
def test_purposes_of_bindings_preview_then_all_then_full(purposes, expected):
    """Oracle: what each purpose is bound to."""
    stage = Usd.Stage.CreateInMemory()
    mesh = add_mesh(stage, "/World/M")
    tones = {"A": (0.25, 0, 0), "P": (0, 0.25, 0), "F": (0, 0, 0.25)}
    for purpose in purposes:
        name = {"": "A", "preview": "P", "full": "F"}[purpose]
        material = add_material(stage, f"/Looks/{name}", tones[name])
        api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        api.Bind(material, materialPurpose=purpose)
    assert seen(stage, "/World/M").materials[0].diffuse == tones[expected]


def test_bindings_are_inherited_and_may_be_stronger_than_descendants(stage):
    """Oracle: UsdShade's rules."""
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    mesh = add_mesh(stage, "/World/M")
    red, blue = (
        add_material(stage, "/Looks/R", (1, 0, 0)),
        add_material(stage, "/Looks/B", (0, 0, 1)),
    )
    with Engine(stage) as engine:
        bind(world, red)
        assert mesh_at(engine, "/World/M").materials[0].diffuse == (1, 0, 0)
        bind(mesh, blue)
        assert mesh_at(engine, "/World/M").materials[0].diffuse == (0, 0, 1)
        UsdShade.MaterialBindingAPI(world).Bind(red, "strongerThanDescendants")
        assert mesh_at(engine, "/World/M").materials[0].diffuse == (1, 0, 0)


def test_bindings_by_collection_are_noticed(stage):
    """Oracle: UsdShade's rules; a fresh engine."""
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    add_mesh(stage, "/World/M")
    collection = Usd.CollectionAPI.Apply(world, "some")
    red = add_material(stage, "/Looks/R", (1, 0, 0))
    UsdShade.MaterialBindingAPI.Apply(world).Bind(collection, red, "some")
    with Engine(stage) as engine:
        assert mesh_at(engine, "/World/M").materials[0].diffuse == (0.18, 0.18, 0.18)
        collection.CreateIncludesRel().AddTarget("/World/M")
        assert mesh_at(engine, "/World/M").materials[0].diffuse == (1, 0, 0)


def test_a_material_that_comes_later_is_noticed(stage):
    """Oracle: the value authored."""
    stage.RemovePrim("/Looks/Mat")
    with Engine(stage) as engine:
        assert mesh_at(engine, "/M").materials[0].diffuse == (0.18, 0.18, 0.18)
        add_material(stage, "/Looks/Mat", (1, 0, 0))
        assert mesh_at(engine, "/M").materials[0].diffuse == (1, 0, 0)


def test_subsets_have_materials_of_their_own_and_the_rest_the_meshs(stage):
    """Oracle: the faces named, by hand."""
    mesh = add_mesh(stage, "/Strip", faces=3)
    bind(mesh, stage_material(stage, "/Looks/Mat"))
    mesh.CreateDisplayColorAttr(colors((0, 1, 0)))
    one = add_subset(mesh, "One", [1])
    bind(one.GetPrim(), add_material(stage, "/Looks/R", (1, 0, 0)))
    with Engine(stage) as engine:
        spec = mesh_at(engine, "/Strip")
        tones = [spec.materials[number].diffuse for number in spec.material_of]
        grey = (0.5, 0.25, 0.125)
        assert tones == [grey, grey, (1, 0, 0), (1, 0, 0), grey, grey]
        one.GetIndicesAttr().Set([0, 1, 2])
        spec = mesh_at(engine, "/Strip")
        assert spec.material_of is None
        assert [material.diffuse for material in spec.materials] == [(1, 0, 0)]


def stage_material(stage, path) -> UsdShade.Material:
    return UsdShade.Material(stage.GetPrimAtPath(path))


# --- networks ----------------------------------------------------------------------------------


def test_a_texture_is_read_with_the_coordinates_it_names(stage, picture):
    """Oracle: the pixels written, and the primvar at each corner."""
    add_texture(stage, "/Looks/Mat", picture)
    spec = seen(stage)
    (material,) = spec.materials
    assert material.diffuse == (1.0, 1.0, 1.0) and material.texture is not None
    expected = np.random.default_rng(1).uniform(size=(2, 3, 3)).astype(np.float32)
    assert np.array_equal(material.texture.pixels, expected)
    assert material.texture.wrap == ("black", "black")  # what useMetadata falls back to
    assert np.array_equal(spec.uvs, UVS[spec.triangles])


def test_scale_bias_and_wraps_of_a_texture(stage, picture):
    """Oracle: scale · pixel + bias, by hand."""
    texture = add_texture(stage, "/Looks/Mat", picture)
    texture.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("mirror")
    texture.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("clamp")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.5, 2, 1, 1))
    pixels = np.random.default_rng(1).uniform(size=(2, 3, 3)).astype(np.float32)
    (material,) = seen(stage).materials
    assert material.diffuse == (0.5, 2.0, 1.0) and material.texture.wrap == ("mirror", "clamp")
    texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.25, 0, 0, 0))
    (material,) = seen(stage).materials
    found = np.array(material.diffuse) * material.texture.pixels
    assert np.allclose(found, pixels * (0.5, 2, 1) + (0.25, 0, 0), atol=1e-6)


def test_texture_coordinates_are_scaled_turned_and_moved_in_this_order(stage, picture):
    """Oracle: UsdTransform2d's definition, by hand for two of them in a row."""
    texture = add_texture(stage, "/Looks/Mat", picture)
    reader = shader(stage, "/Looks/Mat/Reader")
    first, second = (shader_node(stage, f"/Looks/Mat/T{i}", "UsdTransform2d") for i in (1, 2))
    first.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.GetOutput("result"))
    first.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(2, 3))
    first.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(90.0)
    first.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(1, 0))
    result = first.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    second.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(result)
    second.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(10, 10))
    output = second.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.GetInput("st").ConnectToSource(output)
    spec = seen(stage)
    u, v = np.moveaxis(UVS[spec.triangles], -1, 0)
    assert np.allclose(spec.uvs, np.stack([10 * (1 - 3 * v), 10 * (2 * u)], axis=-1), atol=1e-5)


def shader_node(stage, path, kind) -> UsdShade.Shader:
    node = UsdShade.Shader.Define(stage, path)
    node.CreateIdAttr(kind)
    return node


def test_a_primvar_reader_shows_the_meshs_colours_or_its_fallback(stage):
    """Oracle: the values authored."""
    reader = shader_node(stage, "/Looks/Mat/Color", "UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    reader.CreateInput("fallback", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(0, 0.5, 0))
    output = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    shader(stage, "/Looks/Mat/Surface").GetInput("diffuseColor").ConnectToSource(output)
    with Engine(stage) as engine:
        (material,) = mesh_at(engine, "/M").materials
        assert material.diffuse == (0.0, 0.5, 0.0) and not material.uses_colors
        UsdGeom.Mesh.Get(stage, "/M").CreateDisplayColorAttr(colors((1, 0, 0)))
        (material,) = mesh_at(engine, "/M").materials
        assert material.uses_colors and (mesh_at(engine, "/M").colors == (1, 0, 0)).all()


def test_interfaces_of_materials_and_node_graphs_are_followed_and_noticed(stage, picture):
    """Oracle: the values authored on the material."""
    material = stage_material(stage, "/Looks/Mat")
    tone = material.CreateInput("tone", Sdf.ValueTypeNames.Color3f)
    tone.Set(Gf.Vec3f(0, 1, 0))
    graph = UsdShade.NodeGraph.Define(stage, "/Looks/Mat/Graph")
    inner = graph.CreateInput("tone", Sdf.ValueTypeNames.Color3f)
    inner.ConnectToSource(tone)
    shader(stage, "/Looks/Mat/Surface").GetInput("diffuseColor").ConnectToSource(inner)
    with Engine(stage) as engine:
        assert mesh_at(engine, "/M").materials[0].diffuse == (0, 1, 0)
        tone.Set(Gf.Vec3f(0, 0, 1))
        assert mesh_at(engine, "/M").materials[0].diffuse == (0, 0, 1)


@pytest.mark.parametrize("file", ["missing.png", ""])
def test_a_texture_that_cannot_be_read_is_a_warning_and_its_fallback(stage, file):
    """Oracle: the sentence and the fallback authored; the mesh is drawn."""
    texture = add_texture(stage, "/Looks/Mat", file)
    texture.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.25, 0.5, 1, 1))
    with Engine(stage) as engine:
        (warning,) = engine.warnings
        assert warning.startswith("/Looks/Mat/Texture.inputs:file: found ") and file in warning
        assert mesh_at(engine, "/M").materials[0].diffuse == (0.25, 0.5, 1.0)


def test_a_texture_that_is_missing_and_has_no_fallback_is_grey(stage):
    """Oracle: the grey of what has no material; black would be a claim about the picture."""
    add_texture(stage, "/Looks/Mat", "missing.png")
    with Engine(stage) as engine:
        assert len(engine.warnings) == 1
        assert mesh_at(engine, "/M").materials[0].diffuse == (0.18, 0.18, 0.18)


def test_gloss_of_all_materials_is_one_note(stage):
    """Oracle: three materials with gloss, of which the first one by path is named; fallbacks and
    rougher surfaces have none, and other findings are not merged."""
    inputs = {"roughness": 0.8, "clearcoat": 0.0}
    for name, value in inputs.items():
        shader(stage, "/Looks/Mat/Surface").CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    for letter in "CAB":
        mesh = add_mesh(stage, f"/M{letter}", faces=1)
        bind(mesh, add_material(stage, f"/Looks/{letter}"))
    with Engine(stage) as engine:
        assert engine.findings == ()
        for letter in "CAB":
            surface = shader(stage, f"/Looks/{letter}/Surface")
            surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.25)
            surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(1.0)
        engine.sync()
        codes = [(each.code, each.severity) for each in engine.findings]
        assert codes.count(("unsupported-input", "warning")) == 3
        assert codes.count(("diffuse-surfaces", "note")) == 1 and len(codes) == 4
        (gloss,) = (each for each in engine.findings if each.code == "diffuse-surfaces")
        assert (gloss.path, gloss.attribute) == ("/Looks/A/Surface", "inputs:roughness")
        assert "found 0.25, expected 0.5" in gloss.message and "all surfaces" in gloss.message


@pytest.mark.parametrize("is_connected", [False, True])
@pytest.mark.parametrize("name", ["roughness", "clearcoat", "metallic"])
@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        ("Color3f", Gf.Vec3f(0.5), "(0.5, 0.5, 0.5)"),
        ("Token", "matt", "matt"),
        ("String", "1", "1"),
        ("Asset", Sdf.AssetPath("a.png"), "a.png"),
        ("FloatArray", [0.5] * 1000, "(0.5, 0.5, 0.5, 0.5, …)"),
        ("String", "a" * 1000, "aaa"),
        ("StringArray", ["a"] * 1000, "a"),
        ("Color3fArray", [Gf.Vec3f(0.5)] * 1000, "0.5"),
        ("Matrix4d", Gf.Matrix4d(1), "1"),
    ],
)
def test_an_input_of_another_type_is_a_finding(stage, name, kind, value, said, is_connected):
    """Oracle: UsdPreviewSurface, in which these inputs are numbers; the value authored is in the
    sentence, also where the material's interface has it, and the mesh is drawn."""
    kind = getattr(Sdf.ValueTypeNames, kind)
    own = shader(stage, "/Looks/Mat/Surface").CreateInput(name, kind)
    holder = stage_material(stage, "/Looks/Mat").CreateInput("of", kind) if is_connected else own
    holder.Set(value)
    if is_connected:
        own.ConnectToSource(holder)
    with Engine(stage) as engine:
        (found,) = engine.findings
        assert (found.code, found.attribute) == ("unsupported-input", f"inputs:{name}")
        assert said in found.found and len(found.found) < 100 and found.expected == "a number"
        assert mesh_at(engine, "/M").materials


def test_a_texture_is_read_once_for_all_that_show_it(stage, picture):
    """Oracle: the identity of the pixels; another path brings others."""
    texture = add_texture(stage, "/Looks/Mat", picture)
    bind(add_mesh(stage, "/N"), stage_material(stage, "/Looks/Mat"))
    with Engine(stage) as engine:
        one, two = (mesh_at(engine, path).materials[0].texture for path in ("/M", "/N"))
        assert one.pixels is two.pixels
        other = write_picture(Path(picture).with_name("b.exr"), np.ones((1, 1, 3), np.float32))
        texture.GetInput("file").Set(Sdf.AssetPath(other))
        assert mesh_at(engine, "/M").materials[0].texture.pixels.shape == (1, 1, 3)
        with Engine(stage) as fresh:
            assert surfaces(engine) == surfaces(fresh)


def test_a_texture_inside_a_package_is_read_from_there(stage, picture, tmp_path):
    """Oracle: the same stage read from its own files."""
    add_texture(stage, "/Looks/Mat", picture)
    stage.GetRootLayer().Export(str(tmp_path / "shot.usda"))
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "shot.usda"), str(tmp_path / "shot.usdz"))
    packed = Usd.Stage.Open(str(tmp_path / "shot.usdz"))
    with Engine(stage) as engine, Engine(packed) as other:
        assert surfaces(engine) == surfaces(other) and other.warnings == ()


def test_networks_that_run_in_circles_end(stage):
    """Oracle: it ends, with the value at hand."""
    one, two = (shader(stage, "/Looks/Mat/Surface"), UsdShade.NodeGraph.Define(stage, "/Looks/G"))
    a = two.CreateInput("a", Sdf.ValueTypeNames.Color3f)
    b = two.CreateInput("b", Sdf.ValueTypeNames.Color3f)
    a.ConnectToSource(b)
    b.ConnectToSource(a)
    one.GetInput("diffuseColor").ConnectToSource(a)
    assert seen(stage).materials[0].diffuse == (0.18, 0.18, 0.18)
