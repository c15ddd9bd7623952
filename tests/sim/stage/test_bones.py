"""Tests of skeletons as capsules."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel

from tests.sim.stage.stages import add_rig, field_of, make_stage, moved, place, rigid, world
from usdsplat.core.errors import StageError
from usdsplat.sim.specs import Solid
from usdsplat.sim.stage.affectors import AffectorReader
from usdsplat.sim.stage.skeletons import Rigs
from usdsplat.sim.stage.spaces import Space


def reader(stage: Usd.Stage, path: str) -> AffectorReader:
    """A skeleton as an affector of the stage's field."""
    prim = stage.GetPrimAtPath(path)
    prim.ApplyAPI("SplatAffectorAPI")
    return AffectorReader(prim, Space(field_of(stage), "local", Usd.TimeCode(1)), Rigs())


def ends(solid: Solid) -> np.ndarray:
    """Centres at both ends of a capsule, shape (2, 3)."""
    return moved(solid.matrix, np.array([[0, 0, -1], [0, 0, 1]]) * solid.size[2])


@pytest.mark.parametrize("time", [1, 13, 25])
def test_capsules_go_from_joint_to_joint_and_a_leafs_as_far_again(time: int) -> None:
    """Oracle: UsdSkel's own joint transforms; the last bone is as long as the one before it and
    goes on in its direction."""
    stage = make_stage()
    place(field_of(stage), rigid(4, 0.5))
    add_rig(stage)
    found = reader(stage, "/World/Rig/Skeleton").at(Usd.TimeCode(time))
    skeleton = UsdSkel.Skeleton.Get(stage, "/World/Rig/Skeleton")
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/World/Rig"), Usd.PrimDefaultPredicate)
    joints = np.array(cache.GetSkelQuery(skeleton).ComputeJointSkelTransforms(Usd.TimeCode(time)))[
        :, 3, :3
    ]
    joints = np.concatenate([joints, [2 * joints[2] - joints[1]]])
    to_field = np.linalg.inv(world(field_of(stage))) @ world(skeleton.GetPrim())
    at = moved(to_field, joints)
    assert [solid.kind for solid in found.solids] == ["capsule"] * 3
    for number, solid in enumerate(found.solids):
        assert np.allclose(ends(solid), at[number : number + 2], atol=1e-5)
        turn = solid.matrix[:3, :3]
        assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0


def test_radii_are_the_median_distance_of_the_skinned_points_from_the_bone() -> None:
    """Oracle: the tube's radii: 0.3 about the first bone, 0.2 about the second, whose joint the
    leaf has no points for; the rig is 1.5 and the field 0.5 as large."""
    stage = make_stage()
    place(field_of(stage), rigid(4, 0.5))
    add_rig(stage)
    prim = stage.GetPrimAtPath("/World/Rig/Skeleton")
    affector = reader(stage, "/World/Rig/Skeleton")
    sizes = np.array([solid.size[:2] for solid in affector.at(Usd.TimeCode(1)).solids])
    assert np.allclose(sizes / 3, [[0.3, 0.2], [0.2, 0.25], [0.25, 0.25]], atol=1e-6)
    prim.GetAttribute("splatSim:affector:radiusScale").Set(2.0)
    prim.GetAttribute("splatSim:affector:jointRadius").Set(0.1)
    again = np.array([solid.size[:2] for solid in affector.at(Usd.TimeCode(1)).solids])
    assert np.allclose(again, 0.6)


def test_a_mesh_is_measured_where_it_was_bound() -> None:
    """Oracle: a mesh that was bound twice as large across the bones."""
    stage = make_stage()
    mesh = add_rig(stage)
    api = UsdSkel.BindingAPI(mesh)
    api.CreateGeomBindTransformAttr(Gf.Matrix4d().SetScale(Gf.Vec3d(1, 2, 2)))
    solids = reader(stage, "/World/Rig/Skeleton").at(Usd.TimeCode(1)).solids
    sizes = np.array([solid.size[:2] for solid in solids])
    assert np.allclose(sizes / 1.5, [[0.6, 0.4], [0.4, 0.5], [0.5, 0.5]], atol=1e-6)


def test_no_end_of_a_capsule_holds_the_other() -> None:
    """Oracle: radii differ by less than the distance of their centres; the first is the median."""
    stage = make_stage()
    mesh = add_rig(stage)
    points = np.array(mesh.GetPointsAttr().Get())
    points[:8, 1:] *= 10
    mesh.GetPointsAttr().Set(points.tolist())
    solids = reader(stage, "/World/Rig/Skeleton").at(Usd.TimeCode(1)).solids
    low, high, half = solids[0].size
    assert low == pytest.approx(4.5, abs=1e-5)
    assert low - high == pytest.approx(0.9 * 2 * half)
    assert all(abs(a - b) < 2 * c for a, b, c in (solid.size for solid in solids))


def test_a_frame_does_not_spin_about_its_bone() -> None:
    """Oracle: the joint's own turn: what a capsule does from one time to the next is what the
    joint does."""
    stage = make_stage()
    add_rig(stage)
    affector = reader(stage, "/World/Rig/Skeleton")
    query = Rigs().query(stage.GetPrimAtPath("/World/Rig/Skeleton"))
    for first, second in ((1, 4), (4, 25)):
        for joint in range(3):
            a, b = (
                affector.at(Usd.TimeCode(time)).solids[joint].matrix[:3, :3]
                for time in (first, second)
            )
            place_of = world(stage.GetPrimAtPath("/World/Rig/Skeleton"))[:3, :3] / 1.5
            p, q = (
                place_of
                @ np.array(query.ComputeJointSkelTransforms(Usd.TimeCode(time))[joint]).T[:3, :3]
                for time in (first, second)
            )
            assert np.allclose(b @ a.T, q @ p.T, atol=1e-6)


def test_joints_are_chosen_by_name_or_path() -> None:
    """Oracle: by hand."""
    stage = make_stage()
    add_rig(stage)
    prim = stage.GetPrimAtPath("/World/Rig/Skeleton")
    prim.ApplyAPI("SplatAffectorAPI")
    whole = reader(stage, "/World/Rig/Skeleton").at(Usd.TimeCode(9)).solids
    prim.GetAttribute("splatSim:affector:joints").Set(["b", "a/b/c"])
    some = reader(stage, "/World/Rig/Skeleton").at(Usd.TimeCode(9)).solids
    assert [solid.size for solid in some] == [solid.size for solid in whole[1:]]
    prim.GetAttribute("splatSim:affector:joints").Set(["knee"])
    with pytest.raises(StageError, match="affector:joints: found the joint knee, expected one of"):
        reader(stage, "/World/Rig/Skeleton")


def test_a_joint_with_two_children_has_two_bones_and_a_lone_one_none_to_speak_of() -> None:
    """Oracle: by hand, without a mesh and without a SkelRoot: a tenth of the median length."""
    stage = make_stage()
    skeleton = UsdSkel.Skeleton.Define(stage, "/World/Fork")
    skeleton.CreateJointsAttr(["a", "a/b", "a/c", "lone"])
    at = [(0, 0, 0), (0, 4, 0), (0, 0, 2), (5, 0, 0)]
    matrices = [Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(*each)) for each in at]
    skeleton.CreateBindTransformsAttr(matrices)
    skeleton.CreateRestTransformsAttr(matrices)
    solids = reader(stage, "/World/Fork").at(Usd.TimeCode(1)).solids
    assert [2 * solid.size[2] for solid in solids] == pytest.approx([4, 2, 4, 2, 0])
    assert {round(solid.size[0], 6) for solid in solids} == {0.2}
    assert np.allclose(ends(solids[2]), [[0, 4, 0], [0, 8, 0]])
    assert np.isfinite(solids[4].matrix).all()


def test_a_real_figures_capsules_are_where_its_joints_are(data) -> None:
    """Oracle: UsdSkel's joints of CesiumMan in the world; most of its skinned points lie within
    twice a capsule's radius of its bone."""
    stage = Usd.Stage.Open(str(data / "usd/usdwg/CesiumMan.usdz"))
    stage.SetEditTarget(stage.GetSessionLayer())
    field = stage.DefinePrim("/Field", "Xform")
    prim = next(each for each in stage.Traverse() if each.IsA(UsdSkel.Skeleton))
    space = Space(field, "local", Usd.TimeCode(1))
    rigs = Rigs()
    affector = AffectorReader(prim, space, rigs)
    query = rigs.query(prim)
    mesh = rigs.skinned(prim)[0]
    skin, placer = rigs.skin(mesh)
    for time in (stage.GetStartTimeCode(), (stage.GetStartTimeCode() + stage.GetEndTimeCode()) / 2):
        code = Usd.TimeCode(time)
        cache = UsdGeom.XformCache(code)
        joints = np.array(query.ComputeJointWorldTransforms(cache))[:, 3, :3]
        solids = affector.at(code).solids
        both = np.array([ends(solid) for solid in solids])
        gap = np.linalg.norm(both[:, 0, None] - joints[None], axis=2).min(axis=1)
        assert gap.max() <= 1e-5 * np.ptp(joints, axis=0).max()
        points = np.array(UsdGeom.Mesh(mesh).GetPointsAttr().Get(code), np.float32)
        points = moved(world(placer, time), skin.points(points, code))
        near = np.zeros(len(points), bool)
        for solid in solids:
            p = moved(np.linalg.inv(solid.matrix), points)
            p[:, 2] -= np.clip(p[:, 2], -solid.size[2], solid.size[2])
            near |= np.linalg.norm(p, axis=1) <= 2 * max(solid.size[:2])
        assert near.mean() > 0.95
