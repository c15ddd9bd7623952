"""Tests of binding a field to a skeleton."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel

from tests.sim.stage.stages import (
    add_rig,
    field_of,
    make_stage,
    moved,
    place,
    rigid,
    simulation_of,
    world,
)
from usdsplat.core.errors import StageError
from usdsplat.sim.specs import SkinBinding, SkinPose
from usdsplat.sim.stage.recipe import StageRecipe, recipes

COUNT = 50


def bound(stage: Usd.Stage, mesh: str = "") -> StageRecipe:
    """The recipe of the field, bound to the rig."""
    sim = simulation_of(stage)
    sim.ApplyAPI("SplatSimDeformAPI")
    sim.GetRelationship("splatSim:skin:skeleton").SetTargets(["/World/Rig/Skeleton"])
    if mesh:
        sim.GetRelationship("splatSim:skin:mesh").SetTargets([mesh])
    (recipe,) = recipes(stage, sim, start=1)
    return recipe


def skinned(
    binding: SkinBinding, pose: SkinPose, points: np.ndarray, indices=None, weights=None
) -> np.ndarray:
    """Linear blend skinning in the words of `SkinBinding`."""
    indices = binding.indices if indices is None else indices
    weights = binding.weights if weights is None else weights
    start = moved(binding.bind, points)
    each = np.einsum("nkij,nj->nki", pose.joints[indices][..., :3, :3], start)
    each += pose.joints[indices][..., :3, 3]
    return np.einsum("nk,nki->ni", weights, each)


def give_weights(prim: Usd.Prim, seed: int = 0, rigid_one: bool = False) -> None:
    """Joint weights for the field, in an order of joints of its own."""
    rng = np.random.default_rng(seed)
    api = UsdSkel.BindingAPI.Apply(prim)
    api.CreateJointsAttr(["a/b/c", "a", "a/b"])
    rows = 1 if rigid_one else COUNT
    indices = rng.integers(0, 3, (rows, 2))
    weights = rng.random((rows, 2)) + 0.1
    weights /= weights.sum(axis=1, keepdims=True)
    api.CreateJointIndicesPrimvar(rigid_one, 2).Set(indices.ravel().tolist())
    api.CreateJointWeightsPrimvar(rigid_one, 2).Set(weights.ravel().tolist())
    geom = Gf.Matrix4d(*rigid(9, 0.8).T.ravel().tolist())
    api.CreateGeomBindTransformAttr(geom)


@pytest.mark.parametrize("rigid_one", [False, True])
def test_splats_with_weights_of_their_own_go_where_usdskel_puts_points(rigid_one: bool) -> None:
    """Oracle: UsdSkel, which skins a mesh with the same points and bindings; the skeleton stands
    elsewhere than the field, joints have an order of their own, and weights are for each point or
    for all."""
    stage = make_stage(COUNT)
    add_rig(stage)
    place(field_of(stage), rigid(6, 0.7))
    give_weights(field_of(stage), rigid_one=rigid_one)
    recipe = bound(stage)
    points = recipe.rest.positions
    copy = UsdGeom.Mesh.Define(stage, "/World/Rig/Copy")
    copy.CreatePointsAttr(points.tolist())
    give_weights(copy.GetPrim(), rigid_one=rigid_one)
    UsdSkel.BindingAPI(copy).CreateSkeletonRel().SetTargets(["/World/Rig/Skeleton"])
    root = UsdSkel.Root.Get(stage, "/World/Rig")
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/World/Rig/Skeleton"))
    query = cache.GetSkinningQuery(copy.GetPrim())
    for time in (1, 13, 25):
        code = Usd.TimeCode(time)
        expected = copy.GetPointsAttr().Get()
        if rigid_one:
            matrix = query.ComputeSkinnedTransform(skeleton.ComputeSkinningTransforms(code), code)
            expected = moved(np.array(matrix).T, np.array(expected))
        else:
            query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), expected, code)
        expected = moved(world(stage.GetPrimAtPath("/World/Rig/Skeleton"), time), expected)
        moment = recipe.at(time)
        assert recipe.binding is not None and moment.skin is not None
        found = moved(moment.to_world, skinned(recipe.binding, moment.skin, points))
        assert np.abs(found - expected).max() <= 1e-5


def test_a_mesh_hands_over_its_joints_as_it_was_bound() -> None:
    """Oracle: UsdSkel's skinned mesh: what its points' weights do to its bound points is where it
    is now; splats were bound where they stand."""
    stage = make_stage(COUNT)
    mesh = add_rig(stage)
    place(field_of(stage), rigid(6, 0.7))
    simulation_of(stage).ApplyAPI("SplatSimDeformAPI")
    simulation_of(stage).GetAttribute("splatSim:skin:binding").Set("triangles")
    recipe = bound(stage, "/World/Rig/Mesh")
    binding = recipe.binding
    assert binding is not None and binding.surface is not None
    assert binding.indices is None and (binding.bind == np.eye(4)).all()
    assert binding.surface.triangles.shape == (24, 3)
    where = world(stage.GetPrimAtPath("/World/Rig/Skeleton"))
    to_field = np.linalg.inv(world(field_of(stage))) @ where
    own = np.array(mesh.GetPointsAttr().Get())
    assert np.allclose(binding.surface.points, moved(to_field, own), atol=1e-5)
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/World/Rig"), Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/World/Rig/Skeleton"))
    for time in (1, 13, 25):
        points = mesh.GetPointsAttr().Get()
        code = Usd.TimeCode(time)
        query = cache.GetSkinningQuery(mesh.GetPrim())
        query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), points, code)
        expected = moved(to_field, np.array(points))
        pose = recipe.at(time).skin
        assert pose is not None and pose.surface is not None
        assert np.allclose(pose.surface.points, expected, atol=1e-5)
        found = skinned(
            binding, pose, binding.surface.points, binding.surface_indices, binding.surface_weights
        )
        assert np.allclose(found, expected, atol=1e-5)


def test_a_field_may_say_where_it_was_bound() -> None:
    """Oracle: UsdSkel's words: `skel:geomBindTransform` leads to the skeleton's bind pose."""
    stage = make_stage(COUNT)
    add_rig(stage)
    place(field_of(stage), rigid(6, 0.7))
    geom = rigid(9, 0.8)
    api = UsdSkel.BindingAPI.Apply(field_of(stage))
    api.CreateGeomBindTransformAttr(Gf.Matrix4d(*geom.T.ravel().tolist()))
    binding = bound(stage, "/World/Rig/Mesh").binding
    skeleton = stage.GetPrimAtPath("/World/Rig/Skeleton")
    expected = np.linalg.inv(world(field_of(stage))) @ world(skeleton) @ geom
    assert binding is not None and np.allclose(binding.bind, expected)


def test_weights_add_up_to_1() -> None:
    """Oracle: their shares of what was written."""
    stage = make_stage(2)
    add_rig(stage)
    api = UsdSkel.BindingAPI.Apply(field_of(stage))
    api.CreateJointIndicesPrimvar(False, 2).Set([0, 1, 2, 0])
    api.CreateJointWeightsPrimvar(False, 2).Set([1.0, 3.0, 0.5, 0.0])
    binding = bound(stage).binding
    assert binding is not None and binding.weights is not None and binding.indices is not None
    assert binding.weights.tolist() == [[0.25, 0.75], [1, 0]]
    assert binding.indices.tolist() == [[0, 1], [2, 0]]
    api.GetJointWeightsPrimvar().Set([1.0, 3.0, 0.0, 0.0])
    with pytest.raises(StageError, match="found weights that are negative, not finite"):
        bound(stage)


def test_a_real_figures_points_are_where_its_joints_take_them(data) -> None:
    """Oracle: UsdSkel's skinned points of CesiumMan."""
    stage = make_stage(COUNT)
    holder = stage.DefinePrim("/World/Man", "Xform")
    holder.GetReferences().AddReference(str(data / "usd/usdwg/CesiumMan.usdz"))
    prim = next(each for each in stage.Traverse() if each.IsA(UsdSkel.Skeleton))
    root = UsdSkel.Root.Find(prim)
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    (found,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query = found.GetSkinningTargets()[0]
    sim = simulation_of(stage)
    sim.ApplyAPI("SplatSimDeformAPI")
    sim.GetRelationship("splatSim:skin:skeleton").SetTargets([prim.GetPath()])
    sim.GetRelationship("splatSim:skin:mesh").SetTargets([query.GetPrim().GetPath()])
    (recipe,) = recipes(stage, sim, start=1)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(prim))
    binding = recipe.binding
    assert binding is not None and binding.surface is not None
    for time in (1.0, 20.5):
        code = Usd.TimeCode(time)
        points = UsdGeom.Mesh(query.GetPrim()).GetPointsAttr().Get(code)
        query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), points, code)
        expected = moved(world(prim, time), np.array(points))
        pose = recipe.at(time).skin
        assert pose is not None
        result = skinned(
            binding, pose, binding.surface.points, binding.surface_indices, binding.surface_weights
        )
        assert np.abs(result - expected).max() <= 1e-5 * np.ptp(expected, axis=0).max()


def test_bindings_that_do_not_fit_are_one_sentence() -> None:
    """Oracle: the sentences."""
    stage = make_stage(COUNT)
    add_rig(stage)
    with pytest.raises(StageError, match="skin:mesh: found no mesh, and no joint weights"):
        bound(stage)
    give_weights(field_of(stage))
    api = UsdSkel.BindingAPI(field_of(stage))
    api.GetJointIndicesPrimvar().Set([0] * 7)
    with pytest.raises(StageError, match="Indices: found 7 joints and 100 weights, expected 2 of"):
        bound(stage)
    api.GetJointIndicesPrimvar().Set([3] * 100)
    with pytest.raises(StageError, match="found joint 3, expected 0 or more and less than 3"):
        bound(stage)
    api.GetJointIndicesPrimvar().Set([0] * 100)
    api.GetJointsAttr().Set(["a", "knee", "a/b"])
    with pytest.raises(StageError, match="found the joint knee, expected one of /World/Rig/Skel"):
        bound(stage)
    sim = simulation_of(stage)
    sim.GetRelationship("splatSim:skin:skeleton").SetTargets(["/World/Field"])
    with pytest.raises(
        StageError, match=r"/World/Field: found a prim of type Particle.*a Skeleton"
    ):
        recipes(stage, sim)
