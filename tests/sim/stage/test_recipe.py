"""Tests of reading simulations from a stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.schema.clouds import cloud
from tests.sim.stage.stages import (
    FIELD,
    add_rig,
    field_of,
    make_stage,
    moved,
    place,
    rigid,
    simulation_of,
    world,
)
from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.sim.specs import Recipe
from usdsplat.sim.stage.recipe import StageRecipe, find_simulations, recipes


def only(stage: Usd.Stage, start: float | None = None) -> StageRecipe:
    """The recipe of a stage with one field."""
    (found,) = recipes(stage, find_simulations(stage)[0], start=start)
    return found


def test_a_stage_that_says_nothing_is_its_captures_at_rest() -> None:
    """Oracle: the cloud that was written, and USD's transforms; a moment has nothing else."""
    stage = make_stage()
    place(field_of(stage), rigid(1, 2.0))
    recipe: Recipe = only(stage)
    assert recipe.path == FIELD and recipe.codes_per_second == 24
    for name in ("positions", "scales", "rotations", "opacities", "sh"):
        assert np.array_equal(getattr(recipe.rest, name), getattr(cloud(n=50), name))
    moment = recipe.at(3.5)
    assert np.allclose(moment.to_world, world(field_of(stage)))
    assert recipe.selection is None and recipe.binding is None and moment.skin is None
    assert moment.affectors == moment.deformers == moment.drivers == ()
    assert moment.target is None and moment.relax_surface is None


def test_every_field_has_its_own() -> None:
    """Oracle: two fields."""
    stage = make_stage()
    schema.author(stage, "/World/Another", cloud(1, n=7))
    found = recipes(stage, simulation_of(stage))
    assert [(each.path, len(each.rest)) for each in found] == [("/World/Another", 7), (FIELD, 50)]


def test_local_and_world_space_see_the_field_now_and_at_the_start() -> None:
    """Oracle: USD's transforms at both times; the start is the simulation's, the asked-for one, or
    the stage's."""
    stage = make_stage()
    for time in (1, 5, 9):
        place(field_of(stage), rigid(time), time)
    sim = simulation_of(stage)
    field = field_of(stage)
    assert np.allclose(only(stage).at(5).to_world, world(field, 5))
    sim.GetAttribute("splatSim:sim:space").Set("world")
    assert np.allclose(only(stage).at(5).to_world, world(field, 1))
    recipe = only(stage, start=9)
    assert np.allclose(recipe.at(5).to_world, world(field, 9))
    assert np.allclose(
        recipe.field_to_simulation(5), np.linalg.inv(world(field, 9)) @ world(field, 5)
    )
    sim.GetAttribute("splatSim:sim:startTime").Set(Sdf.TimeCode(5))
    assert only(stage, start=9).start == 5
    assert np.allclose(only(stage, start=9).at(1).to_world, world(field, 5))


def test_a_captures_samples_count_at_the_start() -> None:
    """Oracle: the cloud of that time."""
    stage = make_stage()
    for time in (1, 4):
        schema.author(stage, FIELD, cloud(time, n=6), time=time)
    assert np.array_equal(only(stage, start=4).rest.positions, cloud(4, n=6).positions)


def test_ids_that_do_not_ascend_are_dropped_and_splats_that_are_nowhere_refused() -> None:
    """Oracle: the cloud's ids; the sentences."""
    stage = make_stage()
    given = cloud(3, n=6, moving=True)
    schema.author(stage, FIELD, replace(given, ids=np.array([2, 3, 5, 8, 13, 21])))
    recipe = only(stage)
    assert recipe.rest.ids.tolist() == [2, 3, 5, 8, 13, 21] and recipe.findings == ()
    schema.author(stage, FIELD, given)
    recipe = only(stage)
    assert recipe.rest.ids is None
    assert recipe.findings[0].message.startswith("/World/Field.ids: found ids that do not ascend")
    positions = given.positions.copy()
    positions[2:4, 1] = np.nan
    schema.author(stage, FIELD, replace(given, positions=positions))
    with pytest.raises(StageError, match="/World/Field: found 2 splats with numbers that are not"):
        only(stage)


def test_the_selection_is_the_primvar() -> None:
    """Oracle: the numbers; one stands for all, indices count, others are one sentence."""
    stage = make_stage(4)
    primvar = UsdGeom.PrimvarsAPI(field_of(stage)).CreatePrimvar(
        "splatSim:weight", Sdf.ValueTypeNames.FloatArray, "vertex"
    )
    primvar.Set(Vt.FloatArray([0, 0.25, 0.5, 1]))
    assert only(stage).selection.tolist() == [0, 0.25, 0.5, 1]
    primvar.SetIndices(Vt.IntArray([3, 3, 1, 0]))
    assert only(stage).selection.tolist() == [1, 1, 0.25, 0]
    primvar.BlockIndices()
    primvar.Set(Vt.FloatArray([0.5]))
    assert only(stage).selection.tolist() == [0.5] * 4
    primvar.Set(Vt.FloatArray([0.5] * 3))
    with pytest.raises(StageError, match="splatSim:weight: found 3 numbers, expected 4, one for"):
        only(stage)
    primvar.Set(Vt.FloatArray([0, 0, 0, 1.5]))
    with pytest.raises(StageError, match=r"splatSim:weight: found 1.5, expected 0 to 1"):
        only(stage)


def test_deformers_are_in_the_order_of_the_stack() -> None:
    """Oracle: by hand: order, then name; frames are USD's transforms, and masks the primvar."""
    stage = make_stage(3)
    place(field_of(stage), rigid(2, 0.5))
    sim = simulation_of(stage)
    for name, order in (("b", 0), ("a", 0), ("first", -1)):
        sim.ApplyAPI("SplatDeformerAPI", name)
        sim.GetAttribute(f"splatSim:deform:{name}:order").Set(order)
    frame = UsdGeom.Xform.Define(stage, "/World/Frame").GetPrim()
    for time in (1, 9):
        place(frame, rigid(time), time)
    sim.GetRelationship("splatSim:deform:a:frame").SetTargets(["/World/Frame"])
    sim.GetAttribute("splatSim:deform:a:mask").Set("arm")
    sim.GetAttribute("splatSim:deform:a:angle").Set(10.0, 1)
    sim.GetAttribute("splatSim:deform:a:angle").Set(30.0, 9)
    primvar = UsdGeom.PrimvarsAPI(field_of(stage)).CreatePrimvar(
        "arm", Sdf.ValueTypeNames.FloatArray, "vertex"
    )
    primvar.Set(Vt.FloatArray([0, 2, 1]))
    moment = only(stage).at(5)
    first, second, third = moment.deformers
    assert [first.name, second.name, third.name] == ["first", "a", "b"]
    (name,) = moment.masked["deform:a:weight"]
    assert list(moment.masked) == ["deform:a:weight"]
    assert moment.masks[name].primvar.tolist() == [0, 2, 1]
    assert second.parameters.angle == 20
    expected = np.linalg.inv(world(field_of(stage))) @ world(frame, 5)
    assert np.allclose(second.frame, expected) and (first.frame == np.eye(4)).all()
    sim.GetAttribute("splatSim:deform:a:mask").Set("leg")
    with pytest.raises(StageError, match="deform:a:mask: found 'leg', which does not exist, expec"):
        only(stage).at(5)


def test_drivers_are_ordered_by_name() -> None:
    """Oracle: by hand."""
    stage = make_stage(3)
    sim = simulation_of(stage)
    for name in ("z", "color"):
        sim.ApplyAPI("SplatDriverAPI", name)
    sim.GetAttribute("splatSim:driver:color:color").Set(Gf.Vec3f(1, 0.5, 0.1))
    first, second = only(stage).at(1).drivers
    assert (first.name, second.name) == ("color", "z")
    assert first.parameters.color == (1, 0.5, 0.1)


def test_affectors_are_the_same_ones_at_every_time() -> None:
    """Oracle: USD's transforms; ordered by path, those that are not visible too."""
    stage = make_stage(3)
    for name in ("b", "a"):
        ball = UsdGeom.Sphere.Define(stage, f"/World/{name}")
        ball.GetPrim().ApplyAPI("SplatAffectorAPI")
        ball.MakeInvisible()
        for time in (1, 9):
            place(ball.GetPrim(), rigid(time), time)
    recipe = only(stage)
    for time in (1, 9):
        found = recipe.at(time).affectors
        assert [each.path for each in found] == ["/World/a", "/World/b"]
        at = found[0].solids[0].matrix[:3, 3]
        expected = world(stage.GetPrimAtPath("/World/a"), time)[:3, 3]
        assert np.allclose(at, moved(np.linalg.inv(world(field_of(stage))), expected[None])[0])


def test_targets_are_meshes_where_they_are_now() -> None:
    """Oracle: USD's transforms; what stands still is one and the same surface; a mirrored mesh
    faces outwards still."""
    stage = make_stage(3)
    place(field_of(stage), rigid(8, 2.0))
    mesh = UsdGeom.Mesh.Define(stage, "/World/Target")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    mesh.CreateFaceVertexCountsAttr([3] * 4)
    mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    sim = simulation_of(stage)
    sim.ApplyAPI("SplatSimConformAPI")
    sim.ApplyAPI("SplatSimGrowthAPI")
    sim.GetRelationship("splatSim:conform:target").SetTargets(["/World/Target"])
    sim.GetRelationship("splatSim:relax:surface").SetTargets(["/World/Ball"])
    recipe = only(stage)
    assert recipe.at(1).target is recipe.at(2).target
    for time in (1, 9):
        place(mesh.GetPrim(), rigid(time, 1.0, mirrored=True), time)
    recipe = only(stage)
    points = np.array(mesh.GetPointsAttr().Get())
    to_field = np.linalg.inv(world(field_of(stage)))
    for time in (1, 4, 9):
        moment = recipe.at(time)
        assert moment.target is not None and moment.relax_surface is not None
        expected = moved(to_field @ world(mesh.GetPrim(), time), points)
        assert np.allclose(moment.target.points, expected, atol=1e-6)
        if time != 4:  # a matrix half-way between two mirrorings may be none
            a, b, c = (moment.target.points[moment.target.triangles[:, i]] for i in range(3))
            middle = moment.target.points.mean(axis=0)
            assert (np.einsum("ti,ti->t", a - middle, np.cross(b - a, c - a)) > 0).all()
    own = moved(world(field_of(stage)), moment.relax_surface.points)
    assert np.allclose(np.linalg.norm(own, axis=1), 1, atol=1e-5)
    assert ball


def test_a_target_that_a_skeleton_moves_moves() -> None:
    """Oracle: a quarter turn of the second joint, by hand."""
    stage = make_stage(3)
    mesh = add_rig(stage)
    sim = simulation_of(stage)
    sim.ApplyAPI("SplatSimConformAPI")
    sim.GetRelationship("splatSim:conform:target").SetTargets([mesh.GetPath()])
    where = world(stage.GetPrimAtPath("/World/Rig"))
    own = np.array(mesh.GetPointsAttr().Get())
    turned = own @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [2, -2, 0]
    share = np.where(np.arange(16) < 8, 0.25, 0.75)[:, None]
    expected = moved(where, own * (1 - share) + turned * share)
    target = only(stage).at(25).target
    assert target is not None and np.allclose(target.points, expected, atol=1e-5)


def test_relationships_that_lead_nowhere_are_one_sentence() -> None:
    """Oracle: the sentences."""
    stage = make_stage(3)
    sim = simulation_of(stage)
    target = sim.CreateRelationship("splatSim:conform:target")
    target.SetTargets(["/World/Gone"])
    with pytest.raises(
        StageError, match="conform:target: found the target /World/Gone, which does"
    ):
        only(stage)
    target.SetTargets(["/World", FIELD])
    with pytest.raises(StageError, match="conform:target: found 2 targets, expected one"):
        only(stage)
    target.SetTargets(["/World"])
    with pytest.raises(StageError, match="/World: found a prim of type Xform, expected a Mesh"):
        only(stage)


def test_findings_are_of_the_simulation_and_of_its_affectors() -> None:
    """Oracle: two misspelt names."""
    stage = make_stage(3)
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball").GetPrim()
    for prim, name in ((ball, "splatSim:affector:fricton"), (simulation_of(stage), "splatSim:x")):
        prim.CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(0.5)
    first, second = (found.message for found in only(stage).findings)
    assert first.startswith("/World/Sim.splatSim:x: found an unknown property, expected")
    assert second.endswith("expected such as splatSim:affector:friction")


def test_a_session_layer_has_its_say() -> None:
    """Oracle: the stronger opinion."""
    stage = make_stage(3)
    name = "splatSim:settle:omega"
    simulation_of(stage).CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(2.0)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        simulation_of(stage).GetAttribute(name).Set(3.0)
    assert only(stage).at(1).parameters.settle.omega == 3
