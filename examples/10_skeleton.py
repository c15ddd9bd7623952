"""Let a UsdSkel figure walk through a capture. Its limbs push splats aside.

python examples/10_skeleton.py [FOLDER]

The figure is CesiumMan of the test data (CC BY 4.0, Cesium); without the data, it is a swinging
leg.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel

from usdsplat import author_parameters, procedural_capture, schema
from usdsplat import main as usdsplat

DATA = os.environ.get("USDSPLAT_TEST_DATA") or Path(__file__).parents[2] / "shared" / "data"
WALKER = Path(DATA) / "usd" / "usdwg" / "CesiumMan.usdz"
FIELD, FIGURE = "/World/Capture", "/World/Figure"
SCALE, RADIUS = 0.6, 0.07
"""Scale of the figure, and radius of its limbs before scaling [m]."""
LAST = 24
LEG = """#usda 1.0
(
    defaultPrim = "Figure"
)
def SkelRoot "Figure"
{
    def Skeleton "Skeleton" (prepend apiSchemas = ["SkelBindingAPI"])
    {
        uniform token[] joints = ["Hip", "Hip/Knee"]
        uniform matrix4d[] bindTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 1, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0.5, 0, 1)) ]
        uniform matrix4d[] restTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 1, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, -0.5, 0, 1)) ]
        rel skel:animationSource = </Figure/Swing>
    }
    def SkelAnimation "Swing"
    {
        uniform token[] joints = ["Hip", "Hip/Knee"]
        float3[] translations = [(0, 1, 0), (0, -0.5, 0)]
        half3[] scales = [(1, 1, 1), (1, 1, 1)]
        quatf[] rotations.timeSamples = {
            1: [(0.966, 0.259, 0, 0), (0.991, -0.131, 0, 0)],
            12: [(0.966, -0.259, 0, 0), (0.991, -0.131, 0, 0)],
            24: [(0.966, 0.259, 0, 0), (0.991, -0.131, 0, 0)],
        }
    }
    def Mesh "Leg" (prepend apiSchemas = ["SkelBindingAPI"])
    {
        uniform token subdivisionScheme = "none"
        point3f[] points = [
            (-0.07, 1, -0.07), (0.07, 1, -0.07), (0.07, 1, 0.07), (-0.07, 1, 0.07),
            (-0.07, 0.5, -0.07), (0.07, 0.5, -0.07), (0.07, 0.5, 0.07), (-0.07, 0.5, 0.07),
            (-0.07, 0, -0.07), (0.07, 0, -0.07), (0.07, 0, 0.07), (-0.07, 0, 0.07) ]
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [
            0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7,
            4, 5, 9, 8, 5, 6, 10, 9, 6, 7, 11, 10, 7, 4, 8, 11 ]
        int[] primvars:skel:jointIndices = [0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        float[] primvars:skel:jointWeights = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1] (
            elementSize = 1
            interpolation = "vertex"
        )
        rel skel:skeleton = </Figure/Skeleton>
    }
}
"""


def main(folder: Path) -> Path:
    """Write capture.usdc, walk.usda with the simulation, and walked.usda with the result.

    Return walked.usda.
    """
    base = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(base, FIELD, procedural_capture(10_000))
    base.Save()
    stage = Usd.Stage.CreateNew(str(folder / "walk.usda"))
    stage.GetRootLayer().subLayerPaths = ["capture.usdc"]
    stage.SetTimeCodesPerSecond(24)
    figure = stage.DefinePrim(FIGURE)
    walker = WALKER
    if not walker.exists():
        walker = folder / "leg.usda"
        walker.write_text(LEG)
    figure.GetReferences().AddReference(str(walker))
    place = UsdGeom.Xformable(figure)
    place.ClearXformOpOrder()
    move = place.AddTranslateOp()
    for frame, z in ((1, -0.9), (LAST, 0.5)):
        move.Set(Gf.Vec3d(0.45, 0, z), frame)
    place.AddScaleOp().Set(Gf.Vec3f(SCALE))
    author_parameters(skeleton_of(stage).GetPrim(), {"affector:jointRadius": RADIUS})
    author_parameters(stage.DefinePrim("/World/Sim", "SplatSim"), {"settle:omega": 6.0})
    stage.Save()
    baked = folder / "walked.usda"
    assert usdsplat(f"simulate {folder}/walk.usda -o {baked} --frames 1:{LAST}".split()) == 0
    return baked


def check(path: Path) -> None:
    """Check that no splat is in a limb at any frame, and that only splats near the figure moved."""
    stage = Usd.Stage.Open(str(path))
    base = Usd.Stage.Open(str(path.parent / "capture.usdc"))
    rest = schema.fetch(base.GetPrimAtPath(FIELD)).positions
    field = stage.GetPrimAtPath(FIELD)
    most, track, nearest = np.zeros(len(rest)), np.full(len(rest), np.inf), np.inf
    for frame in range(1, LAST + 1):
        positions = schema.fetch(field, frame).positions
        bones = bones_of(stage, frame)
        nearest = min(nearest, distance(positions, bones).min())
        track = np.minimum(track, distance(rest, bones))
        most = np.maximum(most, np.linalg.norm(positions - rest, axis=1))
    moved, radius = most > 1e-6, RADIUS * SCALE
    print(
        f"{len(bones)} bones pushed {moved.sum()} of {len(rest)} splats, by up to {most.max():.3f} "
        f"m; none is nearer than {nearest / radius:.5f} radii; those that moved were within "
        f"{np.percentile(track[moved], 95):.3f} m of its track, 95 of 100"
    )
    assert nearest > (1 - 1e-5) * radius
    assert 100 < moved.sum() < 0.5 * len(rest)
    assert moved[track < radius].all()
    assert np.percentile(track[moved], 95) < 0.2


def skeleton_of(stage: Usd.Stage) -> UsdSkel.Skeleton:
    """Return the skeleton of the figure."""
    every = Usd.PrimRange(stage.GetPrimAtPath(FIGURE))
    return next(UsdSkel.Skeleton(prim) for prim in every if prim.IsA(UsdSkel.Skeleton))


def bones_of(stage: Usd.Stage, frame: int) -> np.ndarray:
    """Return the ends of each bone in the stage's space, shape (b, 2, 3).

    A leaf's bone repeats the length of its parent's.
    """
    skeleton = skeleton_of(stage)
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Find(skeleton.GetPrim()), Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(skeleton)
    place = skeleton.ComputeLocalToWorldTransform(frame)
    joints = [matrix * place for matrix in query.ComputeJointSkelTransforms(frame)]
    bind = query.GetJointWorldBindTransforms()
    parents = list(query.GetTopology().GetParentIndices())
    bones = []
    for joint, parent in enumerate(parents):
        end = joints[joint].ExtractTranslation()
        if parent >= 0:
            bones.append((joints[parent].ExtractTranslation(), end))
        if joint not in parents:
            before, at = (bind[i].ExtractTranslation() for i in (parent, joint))
            tip = bind[joint].GetInverse().Transform(2 * at - before)
            bones.append((end, joints[joint].Transform(tip)))
    return np.array(bones)


def distance(points: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """Return the distance of each point from the nearest bone, shape (n,)."""
    found = np.full(len(points), np.inf)
    for first, second in bones:
        along = second - first
        t = np.clip((points - first) @ along / max(along @ along, 1e-12), 0, 1)
        found = np.minimum(found, np.linalg.norm(points - first - t[:, None] * along, axis=1))
    return found


if __name__ == "__main__":
    place = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    place.mkdir(parents=True, exist_ok=True)
    check(main(place))
