"""Tests that the schemas of simulations declare their parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd

from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED

CLASSES = {
    "SplatSim": ("sim", "neighbors", "carriers"),
    "SplatSimGrowthAPI": ("rd", "relax", "growth", "accretion"),
    "SplatSimRefineAPI": ("refine",),
    "SplatSimMatterAPI": ("matter",),
    "SplatSimSettleAPI": ("settle",),
    "SplatSimConformAPI": ("conform",),
    "SplatSimDeformAPI": ("skin",),
    "SplatSimParticlesAPI": ("particles", "dissolve"),
    "SplatSimAppearanceAPI": ("appearance",),
    "SplatSimBakeAPI": ("bake",),
    "SplatAffectorAPI": ("affector",),
    "SplatDeformerAPI": ("deform",),
    "SplatDriverAPI": ("driver",),
    "SplatSimMaskAPI": ("mask",),
}
SINGLE = [name for name in CLASSES if name.startswith("SplatSim") and name.endswith("API")]
SINGLE.remove("SplatSimMaskAPI")  # one for each mask
RELATIONSHIPS = {
    "SplatSimGrowthAPI": {"splatSim:relax:surface"},
    "SplatSimConformAPI": {"splatSim:conform:target"},
    "SplatSimDeformAPI": {"splatSim:skin:skeleton", "splatSim:skin:mesh"},
    "SplatDeformerAPI": {"splatSim:deform:__INSTANCE_NAME__:frame"},
    "SplatSimMaskAPI": {f"splatSim:mask:__INSTANCE_NAME__:{name}" for name in ("region", "frame")},
}
ARRAYS = {"token[]", "point3f[]", "color3f[]"}
EVERY = [
    (schema, group, item)
    for schema, groups in CLASSES.items()
    for group in groups
    for item in knobs({**GROUPS, **INSTANCED}[group])
]


def declared(schema: str) -> Any:
    """USD's definition of a class."""
    registry = Usd.SchemaRegistry()
    find = registry.FindAppliedAPIPrimDefinition
    return registry.FindConcretePrimDefinition(schema) if schema == "SplatSim" else find(schema)


def usd_name(group: str, item: Knob) -> str:
    """`max_count` of `sim` as `splatSim:sim:maxCount`."""
    first, *rest = item.name.split("_")
    name = first + "".join(word.title() for word in rest)
    instance = "__INSTANCE_NAME__:" if group in ("deform", "driver", "mask") else ""
    return f"splatSim:{group}:{instance}{name}"


@pytest.mark.parametrize("schema", CLASSES)
def test_every_knob_is_a_property_and_every_property_a_knob(schema: str) -> None:
    """Oracle: the knobs of the groups, their masks, and the relationships of the specification."""
    names = {name for name in declared(schema).GetPropertyNames() if "splatSim:" in name}
    knobs = [(group, item) for of, group, item in EVERY if of == schema]
    own = {usd_name(group, item) for group, item in knobs}
    own |= {f"{usd_name(group, item)}:mask" for group, item in knobs if item.takes_mask}
    assert names == own | RELATIONSHIPS.get(schema, set())


def test_every_group_is_in_one_class() -> None:
    """Oracle: the groups."""
    held = [group for groups in CLASSES.values() for group in groups]
    assert sorted(held) == sorted([*GROUPS, *INSTANCED])


@pytest.mark.parametrize(
    ("schema", "group", "item"), EVERY, ids=[f"{group}:{item.name}" for _, group, item in EVERY]
)
def test_type_default_choices_and_variability_agree(schema: str, group: str, item: Knob) -> None:
    """Oracle: the knob; single precision is as near as its real numbers come."""
    attribute = declared(schema).GetSchemaAttributeSpec(usd_name(group, item))
    kinds = {bool: "bool", int: "int", float: "float", str: "string"}
    expected = item.usd_type or ("token" if item.choices else kinds[item.type])
    assert attribute.typeName == Sdf.ValueTypeNames.Find(expected)
    assert list(attribute.allowedTokens or ()) == list(item.choices or ())
    assert (attribute.variability == Sdf.VariabilityUniform) == item.uniform
    default = attribute.default
    if expected in ARRAYS:
        assert np.allclose(np.array(default).reshape(-1), np.ravel(item.default))
    elif isinstance(item.default, tuple):
        assert tuple(default) == tuple(np.float32(item.default).tolist())
    elif isinstance(item.default, float):
        assert np.float32(default.GetValue() if expected == "timecode" else default) == np.float32(
            item.default
        )
    else:
        assert default == item.default
    assert declared(schema).GetPropertyDocumentation(usd_name(group, item)).endswith(".")


@pytest.mark.parametrize("kind", ["SplatSim", "Mesh"])
@pytest.mark.parametrize("schema", SINGLE)
def test_what_is_simulated_applies_to_simulations(stage: Usd.Stage, schema: str, kind: str) -> None:
    """Oracle: USD's CanApplyAPI."""
    assert bool(stage.DefinePrim("/Prim", kind).CanApplyAPI(schema)) == (kind == "SplatSim")


@pytest.mark.parametrize(
    ("kind", "allowed"),
    [(name, True) for name in ("Sphere", "Capsule", "Capsule_1", "Cube", "Plane", "Mesh")]
    + [("Skeleton", True), ("SplatSim", False), ("Xform", False), ("Cone", False)],
)
def test_affectors_are_shapes_and_skeletons(stage: Usd.Stage, kind: str, allowed: bool) -> None:
    """Oracle: USD's CanApplyAPI."""
    assert bool(stage.DefinePrim("/Prim", kind).CanApplyAPI("SplatAffectorAPI")) == allowed


def test_instances_have_properties_of_their_own(stage: Usd.Stage) -> None:
    """Oracle: two instances by hand; a simulation has its two collections built in."""
    prim = stage.DefinePrim("/Sim", "SplatSim")
    instances = ("SplatDeformerAPI", "bend"), ("SplatDriverAPI", "glow"), ("SplatSimMaskAPI", "top")
    for schema, name in instances:
        assert prim.CanApplyAPI(schema, name) and prim.ApplyAPI(schema, name)
    assert prim.GetAttribute("splatSim:deform:bend:axis").Get() == "Y"
    assert prim.GetAttribute("splatSim:driver:glow:source").Get() == "v"
    assert prim.GetAttribute("splatSim:mask:top:source").Get() == "primvar"
    assert prim.GetRelationship("splatSim:deform:bend:frame")
    assert all(prim.HasAPI("CollectionAPI", name) for name in ("splats", "affectors"))
