"""The scene that a preset is authored in: its paths, and the size of the capture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.schema.stage_values import up_axis
from usdsplat.sim.parameters import SimParameters
from usdsplat.sim.stage import spaces
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.preset_targets import author_target
from usdsplat.sim.stage.trees import simulated_cut

FIRST, LAST, RATE = 1, 100, 24
"""First and last frame, and frames per second."""
_ANGLE = 30.0
"""Vertical angle of view of the camera [degree]."""
_ASIDE = (0.42, 0.3, 1.0)
"""Direction to the camera: along the side, up, and across."""
_GREY = 0.4
"""Colour of what pushes splats, where it is drawn: it must not draw the eye away from them."""
LEAST, MOST = 5, 95
"""Percentiles at the ends of the box."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """Paths of the preset's prims, and the box of the capture in their space."""

    stage: Usd.Stage
    parent: Sdf.Path
    field: Sdf.Path
    """Path of the capture's field."""
    cloud: SplatCloud
    """The capture at the first frame, in its own space."""
    count: int
    """Number of its splats at finite places."""
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


def measured(stage: Usd.Stage, field: Usd.Prim, last: int) -> Scene:
    """Measure the capture where the preset's prims go: under the default prim, if that contains the
    field.

    Args:
        stage: The preset's stage, over the capture.
        field: The field or splat tree, on any stage.
        last: Last frame.

    Raises:
        UsdSplatError: If the field cannot be read, or has no splats.
    """
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
        field=field.GetPath(),
        cloud=cloud,
        count=len(points),
        center=(low + high) / 2,
        extent=extent,
        up="XYZ".index(up_axis(stage)),
        field_unit=spaces.size_of(matrix),
        linear=to_world[:3, :3],
        last=last,
    )


def author_ball(
    scene: Scene, *, radius: float, frames: tuple[int, int], friction: float
) -> Usd.Prim:
    """Author a ball that moves along the capture's longer side, through its centre; renderers do
    not draw it, as its purpose is guide."""
    ball = UsdGeom.Sphere.Define(scene.stage, scene.parent.AppendChild("Ball"))
    as_guide(ball.GetPrim())
    as_grey(ball)
    ball.CreateRadiusAttr(radius)
    ball.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
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


def author_camera(scene: Scene, *, middle: F64, height: float) -> None:
    """Author a camera that sees a part of the capture from aside, a little from above and ahead.

    Args:
        scene: The preset's scene.
        middle: The middle of the picture [unit], shape (3,).
        height: Height of what it shows there [unit].
    """
    camera = UsdGeom.Camera.Define(scene.stage, scene.parent.AppendChild("Camera"))
    distance = 0.5 * height / math.tan(math.radians(_ANGLE) / 2)
    across = 3 - scene.side - scene.up
    direction = np.zeros(3)
    direction[[scene.side, scene.up, across]] = _ASIDE
    # on the side that looks along -z, or along y where z is up, as the default camera does
    direction[across] *= -1.0 if scene.up == 2 else 1.0
    eye = middle + distance * direction / np.linalg.norm(direction)
    view = Gf.Matrix4d().SetLookAt(
        Gf.Vec3d(*eye), Gf.Vec3d(*middle), Gf.Vec3d(*np.eye(3)[scene.up])
    )
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateFocalLengthAttr(12.0 / math.tan(math.radians(_ANGLE) / 2))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 100.0 * distance))


def author_goal(scene: Scene, goal: Usd.Stage) -> Usd.Prim:
    """Reference the content of another stage where the capture is, see `author_target`."""
    path, half = scene.parent.AppendChild("Target"), scene.extent / 2
    low, high = scene.center - half, scene.center + half
    return author_target(scene.stage, path, goal, low, high, time=FIRST)


def as_guide(prim: Usd.Prim) -> None:
    """Give a prim the purpose guide: it acts on splats, but is not part of the picture."""
    UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)


def as_grey(shape: UsdGeom.Gprim) -> None:
    """Give a shape the grey of what pushes splats."""
    shape.CreateDisplayColorAttr([Gf.Vec3f(_GREY)])
