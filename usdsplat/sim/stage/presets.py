"""Presets: simulations that are ready to run, with a capture, affectors and parameters to edit.

All sizes derive from the capture: from the box that contains nine tenths of its splats along each
axis.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.readable import check_referable
from usdsplat.schema.lod_roots import find_roots
from usdsplat.schema.stage_values import up_axis
from usdsplat.schema.usd_files import export_layer
from usdsplat.sim.parameters import SimParameters
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.authoring import author, relate
from usdsplat.sim.stage.preset_targets import author_target
from usdsplat.sim.stage.torus import author_torus
from usdsplat.sim.stage.trees import is_simulated, simulated_cut

PresetName = Literal["grow", "push", "conform", "morph", "dissolve"]
TARGETED = ("conform", "morph")
"""Presets that take a target."""
FIRST, LAST, RATE = 1, 100, 24
"""First and last frame, and frames per second."""
LEAST, MOST = 5, 95
"""Percentiles at the ends of the box."""

_PATTERN = 110
"""Lattice units along a capture: about nine stripes. The number of carriers, and the time of a
frame, grow with its square."""
_REACTION_STEPS = 6000
"""Reaction steps until the last frame, when the pattern has formed; a frame has 256 at most."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """Paths of the preset's prims, and the box of the capture in their space."""

    stage: Usd.Stage
    parent: Sdf.Path
    count: int
    center: F64
    """[unit], shape (3,)."""
    extent: F64
    """Edges of the box [unit], shape (3,)."""
    up: int
    """The axis that points up."""
    field_unit: float
    """Length of the field's unit in this space."""
    linear: F64
    """Rotates vectors of this space to the stage's, (3, 3)."""
    last: int
    """Last frame."""
    target: Usd.Stage | None = None
    """What splats conform to; None makes a ring."""

    @property
    def size(self) -> float:
        """The longest edge."""
        return float(self.extent.max())

    @property
    def side(self) -> int:
        """The longer one of the horizontal axes."""
        level = [axis for axis in range(3) if axis != self.up]
        return max(level, key=lambda axis: float(self.extent[axis]))

    def local(self, length: float) -> float:
        """Return a length in units of the field, in which it is simulated."""
        return length / self.field_unit

    def world(self, *vector: float) -> tuple[float, float, float]:
        """Return a vector (along the side, up, across) in the stage's space."""
        across = 3 - self.side - self.up
        here = np.zeros(3)
        here[[self.side, self.up, across]] = vector
        x, y, z = (self.linear @ here).tolist()
        return x, y, z


def author_preset(
    name: PresetName,
    capture: Usd.Stage,
    target: Path | str,
    *,
    last: int = LAST,
    goal: Usd.Stage | None = None,
) -> None:
    """Write a stage in which a capture is simulated, from frame 1 on at 24 frames per second.

    It has the capture as a sublayer, a SplatSim prim `Simulation/Sim` under the capture's default
    prim, and the affectors beside it.

    Args:
        name: "grow": a labyrinth pattern colours, raises and multiplies splats, and a ball passes
            slowly. "push": a ball passes through. "conform": splats move onto a ring around them,
            or onto the meshes of `goal`. "morph": they become the capture of `goal`. "dissolve":
            splats are blown away.
        capture: A stage from a file, with one splat field or splat tree.
        target: A .usda or .usdc file, replaced when complete; it refers to the capture by a
            relative path.
        last: Frame at which the ball has passed and the pattern has formed, at least 24.
        goal: A stage from a file with meshes or one splat field, for the presets in TARGETED; it is
            referred to, and stands where the capture stands.

    Raises:
        UsageError: If there is no such preset.
        StageError: If a goal is missing or cannot be used, or the stage is not from a file, or from
            one of a name that a layer cannot refer to, does not have exactly one field or tree, or
            has a simulation.
        OutputError: If the target cannot be written.
    """
    if name not in get_args(PresetName):
        raise UsageError("preset", repr(name), f"one of {', '.join(get_args(PresetName))}")
    if goal is not None and name not in TARGETED:
        raise UsageError("target", f"one for preset {name}", f"preset {' or '.join(TARGETED)}")
    if goal is None and name == "morph":
        raise UsageError("target", "none, and preset morph", "a capture to become")
    field, file = _only_field(capture), Path(capture.GetRootLayer().realPath)
    check_referable(file)
    final = Path(os.path.realpath(target))
    if file == final:
        raise UsageError("target", str(target), "another file than the capture's")
    stage = Usd.Stage.CreateInMemory()
    root = stage.GetRootLayer()
    root.subLayerPaths.append(str(file))
    UsdGeom.SetStageUpAxis(stage, up_axis(capture))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(capture))
    for setter in (stage.SetFramesPerSecond, stage.SetTimeCodesPerSecond):
        setter(RATE)
    stage.SetStartTimeCode(FIRST)
    stage.SetEndTimeCode(last)
    if capture.GetDefaultPrim():
        root.defaultPrim = capture.GetRootLayer().defaultPrim
    scene = replace(_scene(stage, field, last), target=goal)
    UsdGeom.Scope.Define(stage, scene.parent)
    sim = stage.DefinePrim(scene.parent.AppendChild("Sim"), "SplatSim")
    _include(sim, "splats", field.GetPath())
    _include(sim, "affectors", scene.parent)
    _PRESETS[name](scene, sim)
    copy = Sdf.Layer.CreateAnonymous(".usda")  # of no stage, which would look for the capture
    copy.TransferContent(root)
    for used in (capture, goal):
        if used is not None:
            layer = used.GetRootLayer().realPath
            copy.UpdateCompositionAssetDependency(layer, _relative(Path(layer), final.parent))
    export_layer(copy, final)


def _grow(scene: Scene, sim: Usd.Prim) -> None:
    """Author a pattern that colours, raises and multiplies splats, and a ball that passes
    slowly."""
    # distance of splats that are spread evenly over a surface of about three times size^2
    spacing = scene.size * np.sqrt(3 / scene.count)
    unit = max(scene.size / _PATTERN, spacing)
    author(
        sim,
        {
            "rd:enabled": True,
            "rd:preset": "labyrinth",
            "rd:substeps": min(round(_REACTION_STEPS / scene.last), 256),
            "rd:patternScale": scene.local(unit),
            "growth:rate": scene.local(0.002 * scene.size),
            "growth:birthRate": 0.15,
            "settle:omega": 6.0,
            "driver:colour:source": "v",
            "driver:colour:inMin": 0.1,
            "driver:colour:inMax": 0.35,
            "driver:colour:output": "color",
            "driver:colour:amount": 0.85,
            "driver:colour:color": (0.95, 0.35, 0.1),
            "driver:relief:source": "v",
            "driver:relief:inMin": 0.1,
            "driver:relief:inMax": 0.35,
            "driver:relief:output": "displacement",
            "driver:relief:amount": scene.local(0.8 * unit),
            "driver:swell:source": "v",
            "driver:swell:inMin": 0.1,
            "driver:swell:inMax": 0.35,
            "driver:swell:output": "scale",
            "driver:swell:amount": 1.15,
        },
    )
    _ball(scene, radius=0.12 * scene.size, frames=(FIRST, scene.last), friction=0.1)


def _push(scene: Scene, sim: Usd.Prim) -> None:
    """Author a ball that passes through the capture, which settles behind it.

    When the ball stops it is disabled, so that splats in front of it can return to their places.
    """
    author(sim, {"settle:omega": 5.0, "settle:delay": 0.1, "appearance:covariance": "full"})
    through = max(round(0.6 * scene.last), 2)
    ball = _ball(scene, radius=0.18 * scene.size, frames=(FIRST, through), friction=0.1)
    author(ball, {"affector:enabled": True}, time=FIRST)
    author(ball, {"affector:enabled": False}, time=through + 1)


def _conform(scene: Scene, sim: Usd.Prim) -> None:
    """Author splats that move onto a target, or onto a ring around them, and ride on it."""
    if scene.target is None:
        target = _ring(scene)
    else:
        target = _target(scene)
        if is_simulated(target):
            found = scene.target.GetRootLayer().identifier
            raise StageError(found, "a capture", "meshes; preset morph takes a capture")
    author(sim, _TRANSPORT)
    relate(sim, "conform:target", target)


def _morph(scene: Scene, sim: Usd.Prim) -> None:
    """Author splats that become another capture."""
    assert scene.target is not None  # checked by author_preset
    target = _target(scene)
    if not is_simulated(target):
        found = scene.target.GetRootLayer().identifier
        raise StageError(found, "meshes", "a capture; preset conform takes meshes")
    author(sim, _TRANSPORT)
    relate(sim, "conform:target", target)


_TRANSPORT = {
    "carriers:count": 14000,
    "conform:weight": 1.0,
    "conform:start": 0.5,
    "conform:duration": 1.75,
    "conform:stagger": 1.0,
    "settle:omega": 30.0,
}
"""Values of the presets that transport splats, which arrive before the last frame."""


def _target(scene: Scene) -> Usd.Prim:
    """Reference the target where the capture is."""
    assert scene.target is not None
    path = scene.parent.AppendChild("Target")
    half = scene.extent / 2
    low, high = scene.center - half, scene.center + half
    return author_target(scene.stage, path, scene.target, low, high, time=FIRST)


def _ring(scene: Scene) -> Usd.Prim:
    """Author a ring around the capture that turns."""
    level = np.delete(scene.extent, scene.up)
    outer = 0.5 * float(np.hypot(*level)) + 0.1 * scene.size
    ring = author_torus(
        scene.stage,
        scene.parent.AppendChild("Ring"),
        radius=outer,
        tube=0.15 * outer,
        axis="XYZ"[scene.up],
    )
    ring.AddTranslateOp().Set(Gf.Vec3d(*scene.center.tolist()))
    turn = ring.AddRotateYOp() if scene.up == 1 else ring.AddRotateZOp()
    for frame, angle in ((FIRST, 0.0), (scene.last, 60.0)):
        turn.Set(angle, frame)
    ring.CreatePurposeAttr(UsdGeom.Tokens.guide)
    return ring.GetPrim()


def _dissolve(scene: Scene, sim: Usd.Prim) -> None:
    """Author patches that detach and are blown away."""
    author(
        sim,
        {
            "dissolve:enabled": True,
            "dissolve:by": "noise",
            "dissolve:size": scene.local(0.15 * scene.size),
            "dissolve:start": 0.25,
            "dissolve:duration": 2.5,
            "dissolve:speed": scene.local(0.15 * scene.size),
            "dissolve:spread": 40.0,
            "dissolve:fade": 1.0,
            "dissolve:shrink": 0.8,
            "particles:wind": scene.world(0.6 * scene.size, 0.15 * scene.size, 0.0),
            "particles:turbulence": scene.local(0.3 * scene.size),
            "particles:turbulenceScale": scene.local(0.3 * scene.size),
            "particles:turbulenceSpeed": 0.5,
            "particles:drag": 1.5,
        },
    )


_PRESETS: dict[str, Callable[[Scene, Usd.Prim], None]] = {
    "grow": _grow,
    "push": _push,
    "conform": _conform,
    "morph": _morph,
    "dissolve": _dissolve,
}


def _ball(scene: Scene, *, radius: float, frames: tuple[int, int], friction: float) -> Usd.Prim:
    """Author a ball that moves along the capture's longer side, through its centre."""
    ball = UsdGeom.Sphere.Define(scene.stage, scene.parent.AppendChild("Ball"))
    ball.CreateRadiusAttr(radius)
    ball.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
    ball.CreateDisplayColorAttr([Gf.Vec3f(0.12, 0.3, 0.6)])
    move = ball.AddTranslateOp()
    reach = 0.5 * float(scene.extent[scene.side]) + 1.5 * radius
    for frame, way in zip(frames, (-reach, reach), strict=True):
        at = scene.center.copy()
        at[scene.side] += way
        move.Set(Gf.Vec3d(*at.tolist()), frame)
    author(
        ball.GetPrim(),
        {
            "affector:role": "collide",
            "affector:friction": friction,
            "affector:blend": scene.local(0.05 * radius),
        },
    )
    return ball.GetPrim()


def _only_field(capture: Usd.Stage) -> Usd.Prim:
    """Return the only field or tree of the stage."""
    where = capture.GetRootLayer().identifier
    if not capture.GetRootLayer().realPath:
        raise StageError(where, "a stage without a file", "one that can be a sublayer")
    roots = find_roots(capture)
    everything = (prim for prim in capture.Traverse() if not roots.is_replaced(prim))
    fields = list(filter(is_simulated, everything))
    if len(fields) != 1:
        raise StageError(where, f"{len(fields)} splat fields", "one")
    for prim in capture.Traverse():
        if prim.GetTypeName() == "SplatSim":
            raise StageError(where, f"the simulation {prim.GetPath()}", "a capture without one")
    return fields[0]


def _scene(stage: Usd.Stage, field: Usd.Prim, last: int) -> Scene:
    """Measure the capture where the preset's prims go: under the default prim, if that contains the
    field."""
    root = stage.GetDefaultPrim()
    is_above = (
        root and field.GetPath().HasPrefix(root.GetPath()) and root.GetPath() != field.GetPath()
    )
    holder = root if is_above else stage.GetPseudoRoot()
    start = Usd.TimeCode(FIRST)
    to_world = spaces.to_world(holder, start) if is_above else np.eye(4)
    own = stage.GetPrimAtPath(field.GetPath())
    matrix = np.asarray(np.linalg.solve(to_world, spaces.to_world(own, start)), np.float64)
    is_tree = schema.is_tree(own)
    cloud = simulated_cut(own, SimParameters()).cloud() if is_tree else schema.fetch(own, FIRST)
    points = spaces.transform_points(matrix, cloud.positions).astype(np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise StageError(str(field.GetPath()), "no splats", "at least one splat")
    low, high = np.percentile(points, (LEAST, MOST), axis=0)
    extent = np.maximum(high - low, 1e-6 * max(float((high - low).max()), 1e-6))
    return Scene(
        stage=stage,
        parent=holder.GetPath().AppendChild("Simulation"),
        count=len(points),
        center=(low + high) / 2,
        extent=extent,
        up="XYZ".index(up_axis(stage)),
        field_unit=spaces.size_of(matrix),
        linear=to_world[:3, :3],
        last=last,
    )


def _include(sim: Usd.Prim, name: str, path: Sdf.Path) -> None:
    """Include a prim in a collection of the simulation."""
    sim.CreateRelationship(f"collection:{name}:includes", custom=False).SetTargets([path])


def _relative(file: Path, folder: Path) -> str:
    """Return the path of a file relative to a folder, with forward slashes."""
    path = Path(os.path.relpath(file, folder)).as_posix()
    return path if path.startswith("../") else f"./{path}"
