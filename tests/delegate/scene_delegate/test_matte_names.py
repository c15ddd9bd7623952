"""Tests of the assets and materials by which Cryptomatte groups prims."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade

from tests.delegate.stages import random_cloud
from tests.delegate.surface_stages import add_material, add_mesh, add_subset, bind, pulled
from usdsplat import schema
from usdsplat.delegate.engine import Engine


def grouped(engine: Engine, layer: str) -> dict[str, str]:
    """The name of the group of each field and mesh that has only one."""
    scene = engine.render_scene
    groups = scene.matte_groups(layer)
    return {
        path: groups.names[groups.of_prims[number]] for number, path in enumerate(scene.prims())
    }


def assets(stage: Usd.Stage) -> dict[str, str]:
    with Engine(stage) as engine:
        return grouped(engine, "cryptoAsset")


def materials(stage: Usd.Stage) -> Mapping[str, object]:
    """Materials of all fields by path, and those of meshes as tuples."""
    with Engine(stage) as engine:
        scene = engine.render_scene
        fields = {instance.path: instance.material for _, _, instance in scene.drawn()}
        meshes = {
            instance.path: tuple(each.path for each in mesh.spec.materials)
            for _, mesh, instance in scene.drawn_meshes()
        }
        return {**fields, **meshes}


def define(stage: Usd.Stage, path: str, *, kind: str = "", name: str = "") -> Usd.Prim:
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    if kind:
        Usd.ModelAPI(prim).SetKind(kind)
    if name:
        Usd.ModelAPI(prim).SetAssetName(name)
    return prim


@pytest.fixture
def stage() -> Usd.Stage:
    """Two fields and a mesh: /World/Set/Chair/Splats, /World/Set/Chair/Seat, /Alone."""
    stage = Usd.Stage.CreateInMemory()
    define(stage, "/World")
    define(stage, "/World/Set")
    define(stage, "/World/Set/Chair")
    schema.author(stage, "/World/Set/Chair/Splats", random_cloud(1))
    add_mesh(stage, "/World/Set/Chair/Seat")
    schema.author(stage, "/Alone", random_cloud(2))
    return stage


# --- assets ------------------------------------------------------------------------------


def test_without_models_the_asset_is_the_root_prim(stage: Usd.Stage) -> None:
    """Oracle: the paths."""
    assert assets(stage) == {
        "/Alone": "/Alone",
        "/World/Set/Chair/Seat": "/World",
        "/World/Set/Chair/Splats": "/World",
    }


@pytest.mark.parametrize("above", ["", "group", "assembly"])
def test_the_nearest_component_is_the_asset(stage: Usd.Stage, above: str) -> None:
    """With and without a whole model hierarchy; subcomponents and names do not count below it.
    Oracle: the rule of the documentation; USD's kinds, of which component is the only leaf."""
    for path in ("/World", "/World/Set"):
        define(stage, path, kind=above)
    define(stage, "/World/Set/Chair", kind="component")
    inner = define(stage, "/World/Set/Chair/Inner", kind="subcomponent", name="Inner")
    schema.author(stage, f"{inner.GetPath()}/More", random_cloud(3))
    found = assets(stage)
    assert {path for path, asset in found.items() if asset == "/World/Set/Chair"} == {
        "/World/Set/Chair/Seat",
        "/World/Set/Chair/Splats",
        "/World/Set/Chair/Inner/More",
    }
    assert found["/Alone"] == "/Alone"


def test_a_field_may_be_its_own_asset(stage: Usd.Stage) -> None:
    """Oracle: the rule: at or above the prim."""
    define(stage, "/World/Set/Chair", kind="component")
    Usd.ModelAPI(stage.GetPrimAtPath("/World/Set/Chair/Splats")).SetKind("component")
    assert assets(stage)["/World/Set/Chair/Splats"] == "/World/Set/Chair/Splats"


@pytest.mark.parametrize("key", ["name", "identifier"])
def test_asset_info_stands_in_for_a_kind(stage: Usd.Stage, key: str) -> None:
    """Oracle: the rule: the nearest prim with it, but a component comes first."""
    value = "Set" if key == "name" else Sdf.AssetPath("set.usd")
    stage.GetPrimAtPath("/World/Set").SetAssetInfoByKey(key, value)
    assert assets(stage)["/World/Set/Chair/Seat"] == "/World/Set"
    define(stage, "/World", kind="component")
    assert assets(stage)["/World/Set/Chair/Seat"] == "/World"


def test_each_native_instance_is_an_asset(stage: Usd.Stage) -> None:
    """Oracle: the paths of the instances, which carry the kind of the referenced prim."""
    source = Sdf.Layer.CreateAnonymous(".usda")
    asset = Usd.Stage.Open(source)
    define(asset, "/Chair", kind="component")
    schema.author(asset, "/Chair/Splats", random_cloud(4))
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Chair"))
    for name in "AB":
        prim = define(stage, f"/World/{name}")
        prim.GetReferences().AddReference(source.identifier)
        prim.SetInstanceable(True)
    found = assets(stage)
    assert found["/World/A/Splats"] == "/World/A"
    assert found["/World/B/Splats"] == "/World/B"


def test_prototypes_of_an_instancer_are_assets(stage: Usd.Stage) -> None:
    """Oracle: the path of the prototype, which all of its point instances share."""
    scatter = UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
    define(stage, "/World/Scatter/Leaf", kind="component")
    schema.author(stage, "/World/Scatter/Leaf/Splats", random_cloud(5))
    scatter.CreatePrototypesRel().SetTargets(["/World/Scatter/Leaf"])
    scatter.CreateProtoIndicesAttr([0, 0, 0])
    scatter.CreatePositionsAttr([(0, 0, 0), (3, 0, 0), (6, 0, 0)])
    assert assets(stage)["/World/Scatter/Leaf/Splats"] == "/World/Scatter/Leaf"


def test_assets_follow_edits(stage: Usd.Stage) -> None:
    """Oracle: an engine made after the edit; the sync after one of assetInfo reads no arrays. USD
    resyncs a prim whose kind changes."""
    with Engine(stage) as engine:
        chair = stage.GetPrimAtPath("/World/Set/Chair")
        for edit, is_resync in (
            (lambda: Usd.ModelAPI(chair).SetAssetName("Chair"), False),
            (lambda: Usd.ModelAPI(chair.GetParent()).SetKind("component"), True),
            (lambda: Usd.ModelAPI(chair.GetParent()).SetKind("group"), True),
            (chair.ClearAssetInfo, False),
        ):
            before = grouped(engine, "cryptoAsset")
            reads = pulled(engine, edit)
            assert grouped(engine, "cryptoAsset") == assets(stage) != before
            assert is_resync or not reads["field"] + reads["mesh"]


# --- materials ---------------------------------------------------------------------------


def test_fields_and_meshes_have_their_bound_materials(stage: Usd.Stage) -> None:
    """Inherited, by face, by collection, and none. Oracle: UsdShade's rules of binding."""
    red, blue, green = (add_material(stage, f"/Looks/{name}") for name in ("red", "blue", "green"))
    bind(stage.GetPrimAtPath("/World/Set"), red)
    seat = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Set/Chair/Seat"))
    bind(add_subset(seat, "left", [0]).GetPrim(), blue)
    found = materials(stage)
    assert found["/World/Set/Chair/Splats"] == "/Looks/red"
    assert set(found["/World/Set/Chair/Seat"]) == {"/Looks/red", "/Looks/blue"}
    assert found["/Alone"] == ""
    alone = stage.GetPrimAtPath("/Alone")
    collection = Usd.CollectionAPI.Apply(alone, "all")
    collection.CreateIncludesRel().SetTargets(["/Alone"])
    UsdShade.MaterialBindingAPI.Apply(alone).Bind(collection, green, "all")
    assert materials(stage)["/Alone"] == "/Looks/green"


def test_a_material_that_cannot_be_drawn_has_a_name_all_the_same(stage: Usd.Stage) -> None:
    """Oracle: the path of a material without any shader."""
    bind(stage.GetPrimAtPath("/World"), UsdShade.Material.Define(stage, "/Looks/empty"))
    found = materials(stage)
    assert found["/World/Set/Chair/Splats"] == "/Looks/empty"
    assert found["/World/Set/Chair/Seat"] == ("/Looks/empty",)


def test_what_is_not_bound_is_in_the_group_default(stage: Usd.Stage) -> None:
    """Oracle: the name of the documentation."""
    with Engine(stage) as engine:
        assert engine.render_scene.matte_groups("cryptoMaterial").names == ("default",)


def test_materials_in_instances_are_named_once(stage: Usd.Stage) -> None:
    """Of a field and of a mesh, in two instances. Oracle: the path in the first instance, so that
    one name selects the material everywhere; a binding from outside wins over it."""
    source = Sdf.Layer.CreateAnonymous(".usda")
    asset = Usd.Stage.Open(source)
    define(asset, "/Chair")
    wood = add_material(asset, "/Chair/Looks/wood")
    bind(schema.author(asset, "/Chair/Splats", random_cloud(4)), wood)
    bind(add_mesh(asset, "/Chair/Mesh"), wood)
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Chair"))
    for name in "CBA":
        prim = define(stage, f"/World/{name}")
        prim.GetReferences().AddReference(source.identifier)
        prim.SetInstanceable(True)
    paint = add_material(stage, "/World/Looks/paint")
    outside = UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World/B"))
    outside.Bind(paint, UsdShade.Tokens.strongerThanDescendants)
    found = materials(stage)
    for name, path in (("A", "A/Looks/wood"), ("B", "Looks/paint"), ("C", "A/Looks/wood")):
        assert found[f"/World/{name}/Splats"] == f"/World/{path}", name
    assert found["/World/A/Mesh"] == ("/World/A/Looks/wood",)
    assert found["/World/B/Mesh"] == ("/World/Looks/paint",)


def test_materials_of_fields_follow_edits_and_read_no_arrays(stage: Usd.Stage) -> None:
    """Oracle: an engine made after the edit; the sync after it reads no splats."""
    red, blue = (add_material(stage, f"/Looks/{name}") for name in ("red", "blue"))
    paths = ("/World", "/World/Set/Chair/Splats")
    world, own = (UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(path)) for path in paths)
    with Engine(stage) as engine:
        for edit in (
            lambda: world.Bind(red),
            lambda: own.Bind(blue),
            lambda: world.Bind(red, UsdShade.Tokens.strongerThanDescendants),
            lambda: stage.RemovePrim("/Looks/red"),
        ):
            reads = pulled(engine, edit)
            seen = {each.path: each.material for _, _, each in engine.render_scene.drawn()}
            assert seen == {path: name for path, name in materials(stage).items() if path in seen}
            assert reads["field"] == 0
