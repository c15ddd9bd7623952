"""Tests of the members of a simulation."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.sim.stage.stages import make_stage, simulation_of
from usdsplat import schema
from usdsplat.sim.stage import collections


def paths(prims) -> list[str]:
    """Of prims."""
    return [str(prim.GetPath()) for prim in prims]


def add_affectors(stage: Usd.Stage) -> None:
    """Three spheres: one by its schema, hidden; one by an attribute; one of neither."""
    for name in "zab":
        UsdGeom.Sphere.Define(stage, f"/World/{name}")
    stage.GetPrimAtPath("/World/z").ApplyAPI("SplatAffectorAPI")
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/z")).MakeInvisible()
    stage.GetPrimAtPath("/World/a").CreateAttribute(
        "splatSim:affector:friction", Sdf.ValueTypeNames.Float
    ).Set(0.5)


def test_without_a_word_everybody_takes_part():
    """Oracle: by hand; ordered by path, hidden ones too."""
    stage = make_stage()
    add_affectors(stage)
    schema.author(stage, "/World/Afield", cloud(n=3))
    sim = simulation_of(stage)
    assert paths(collections.find_simulations(stage)) == ["/World/Sim"]
    assert paths(collections.splats(stage, sim)[0]) == ["/World/Afield", "/World/Field"]
    assert paths(collections.affectors(stage, sim)) == ["/World/a", "/World/z"]


def test_a_collection_says_who_takes_part():
    """Oracle: USD's rules of collections: what is beneath an included prim is included."""
    stage = make_stage()
    add_affectors(stage)
    schema.author(stage, "/Other/Field", cloud(n=3))
    sim = simulation_of(stage)
    Usd.CollectionAPI(sim, "splats").GetIncludesRel().AddTarget("/Other")
    Usd.CollectionAPI(sim, "affectors").GetIncludesRel().AddTarget("/World")
    Usd.CollectionAPI(sim, "affectors").GetExcludesRel().AddTarget("/World/a")
    assert paths(collections.splats(stage, sim)[0]) == ["/Other/Field"]
    assert paths(collections.affectors(stage, sim)) == ["/World/z"]


def test_expressions_and_collections_of_unknown_types_count():
    """Oracle: by hand; the relationship is read where nobody applied the schema."""
    stage = make_stage()
    add_affectors(stage)
    plain = stage.DefinePrim("/World/Plain", "SomethingElse")
    plain.CreateRelationship("collection:affectors:includes").AddTarget("/World/a")
    assert paths(collections.affectors(stage, plain)) == ["/World/a"]
    sim = simulation_of(stage)
    expression = sim.GetAttribute("collection:affectors:membershipExpression")
    expression.Set(Sdf.PathExpression("/World/z*"))
    assert paths(collections.affectors(stage, sim)) == ["/World/z"]


def test_a_field_in_an_instance_is_left_out_and_said():
    """Oracle: the sentence; an affector in an instance acts."""
    stage = make_stage()
    schema.author(stage, "/Asset/Field", cloud(n=3))
    UsdGeom.Sphere.Define(stage, "/Asset/Ball").GetPrim().ApplyAPI("SplatAffectorAPI")
    stage.GetPrimAtPath("/Asset").SetSpecifier(Sdf.SpecifierClass)
    prim = stage.DefinePrim("/World/Copy", "Xform")
    prim.GetReferences().AddInternalReference("/Asset")
    prim.SetInstanceable(True)
    found, said = collections.splats(stage, simulation_of(stage))
    assert paths(found) == ["/World/Field"]
    assert [found.message for found in said] == [
        "/World/Copy/Field: found a field in an instance, expected one that can be edited"
    ]
    assert paths(collections.affectors(stage, simulation_of(stage))) == ["/World/Copy/Ball"]
