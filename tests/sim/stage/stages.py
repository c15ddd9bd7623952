"""Small stages with a field, a simulation and affectors."""

from __future__ import annotations

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel

from tests.schema.clouds import cloud
from usdsplat import schema

FIELD = "/World/Field"
SIM = "/World/Sim"


def make_stage(count: int = 50) -> Usd.Stage:
    """A field and a simulation that holds everything."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(1)
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, FIELD, cloud(n=count))
    stage.DefinePrim(SIM, "SplatSim")
    return stage


def field_of(stage: Usd.Stage) -> Usd.Prim:
    """The field."""
    return stage.GetPrimAtPath(FIELD)


def simulation_of(stage: Usd.Stage) -> Usd.Prim:
    """The SplatSim prim."""
    return stage.GetPrimAtPath(SIM)


def place(prim: Usd.Prim, matrix: np.ndarray, time: float | None = None) -> None:
    """Place a prim by a matrix for column vectors."""
    xformable = UsdGeom.Xformable(prim)
    ops = xformable.GetOrderedXformOps()
    op = ops[0] if ops else xformable.AddTransformOp()
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    op.Set(Gf.Matrix4d(*np.asarray(matrix, np.float64).T.ravel().tolist()), code)


def world(prim: Usd.Prim, time: float = 1) -> np.ndarray:
    """USD's own local-to-world transform, for column vectors."""
    found = UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(Usd.TimeCode(time))
    return np.array(found).T


def rigid(seed: int, scale: float = 1.0, mirrored: bool = False) -> np.ndarray:
    """A random rotation and move with an even scale."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if (np.linalg.det(q) < 0) != mirrored:
        q[:, 0] *= -1
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = q * scale, rng.normal(size=3)
    return matrix


def moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points through a matrix."""
    return np.asarray(points) @ matrix[:3, :3].T + matrix[:3, 3]


def add_rig(stage: Usd.Stage, path: str = "/World/Rig") -> UsdGeom.Mesh:
    """A tube of three joints along x, 2 and 1 long, whose middle one turns about z from time 1
    to 25; it stands somewhere."""
    root = UsdSkel.Root.Define(stage, path)
    place(root.GetPrim(), rigid(3, 1.5))
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skeleton")
    joints = ["a", "a/b", "a/b/c"]
    at = [Gf.Vec3d(0, 0, 0), Gf.Vec3d(2, 0, 0), Gf.Vec3d(3, 0, 0)]
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1).SetTranslate(each) for each in at])
    local = [at[0], at[1] - at[0], at[2] - at[1]]
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1).SetTranslate(each) for each in local])
    animation = UsdSkel.Animation.Define(stage, f"{path}/Animation")
    animation.CreateJointsAttr(joints)
    animation.CreateTranslationsAttr([Gf.Vec3f(each) for each in local])
    animation.CreateScalesAttr([Gf.Vec3h(1)] * 3)
    turns = animation.CreateRotationsAttr()
    turns.Set([Gf.Quatf(1)] * 3, 1)
    bent = Gf.Quatf(Gf.Rotation(Gf.Vec3d(0, 0, 1), 90).GetQuat())
    turns.Set([Gf.Quatf(1), bent, Gf.Quatf(1)], 25)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    mesh = UsdGeom.Mesh.Define(stage, f"{path}/Mesh")
    x = np.repeat([0.5, 1.5, 2.2, 2.8], 4)
    angle = np.tile(np.arange(4) * np.pi / 2, 4)
    radius = np.repeat([0.3, 0.3, 0.2, 0.2], 4)
    cage = np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    mesh.CreatePointsAttr(cage.tolist())
    quads = [
        (4 * r + s, 4 * r + (s + 1) % 4, 4 * r + 4 + (s + 1) % 4, 4 * r + 4 + s)
        for r in range(3)
        for s in range(4)
    ]
    mesh.CreateFaceVertexCountsAttr([4] * len(quads))
    mesh.CreateFaceVertexIndicesAttr([i for quad in quads for i in quad])
    mesh.CreateSubdivisionSchemeAttr("none")
    skin = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    skin.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    follows = np.where(np.arange(16)[:, None] < 8, [[0, 1]], [[1, 0]])
    skin.CreateJointIndicesPrimvar(False, 2).Set(follows.ravel().tolist())
    skin.CreateJointWeightsPrimvar(False, 2).Set([0.75, 0.25] * 16)
    return mesh
