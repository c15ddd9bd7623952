"""The preset wade: a figure walks through the capture, which parts and closes behind it."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.presets.matter import material_option, matter
from usdsplat.sim.stage.presets.preset import Choice, Preset
from usdsplat.sim.stage.presets.scene import FIRST, Scene, as_grey, as_guide, author_camera

_HEIGHT = 0.6
"""Height of the figure, in sizes of the capture."""
_SHOWN = 1.25
"""Height of the camera's picture, in heights of the figure or the capture."""
_THROUGH = 0.75
"""Part of the time in which it walks through."""
_STRIDE = 0.45
"""Length of a step, in heights."""
_SWING, _BEND = 26.0, 40.0
"""Largest angles of legs and arms, and of knees [deg]."""
_KEYS = 12
"""Number of keys of a step."""

# Of a figure of height 1: places above the ground, or below the joint; radii and lengths.
_TORSO, _HEAD = (0.66, 0.1, 0.24), (0.93, 0.07)
_HIP, _SHOULDER = (0.07, 0.49), (0.155, 0.77)
_THIGH, _SHIN, _ARM = (0.12, 0.06, 0.2), (0.12, 0.05, 0.2), (0.17, 0.04, 0.3)


def _author(scene: Scene, sim: Usd.Prim, choice: Choice) -> None:
    assert choice.name is not None  # the option has a default
    author(sim, matter(scene, choice.name))
    last = max(round(_THROUGH * scene.last), FIRST + 1)
    _Figure(scene, last).author()
    # the whole capture, with its surroundings, is too wide to see what the figure does
    high = float(scene.extent[scene.up])
    shown = max(_HEIGHT * scene.size, high)
    middle = scene.center.copy()
    middle[scene.up] += 0.5 * (shown - high)
    author_camera(scene, middle=middle, height=_SHOWN * shown)


class _Figure:
    """A figure of capsules that walks along the capture's longer side.

    Args:
        scene: The preset's scene.
        last: Frame at which it has passed.
    """

    def __init__(self, scene: Scene, last: int) -> None:
        self._scene, self._last = scene, last
        self._height = _HEIGHT * scene.size
        self._across = 3 - scene.side - scene.up
        reach = 0.5 * float(scene.extent[scene.side]) + 0.5 * self._height
        self._way = -reach, reach
        self._steps = max(1, round(2 * reach / (_STRIDE * self._height)))

    def author(self) -> None:
        """Author its prims."""
        scene = self._scene
        root = UsdGeom.Xform.Define(scene.stage, scene.parent.AppendChild("Figure"))
        as_guide(root.GetPrim())
        move = root.AddTranslateOp()
        ground = scene.center[scene.up] - 0.5 * scene.extent[scene.up]
        for frame, way in zip((FIRST, self._last), self._way, strict=True):
            at = scene.center.copy()
            at[scene.up], at[scene.side] = ground, scene.center[scene.side] + way
            move.Set(Gf.Vec3d(*at.tolist()), frame)
        path = root.GetPath()
        self._capsule(path.AppendChild("Torso"), *_TORSO)
        self._ball(path.AppendChild("Head"), *_HEAD)
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            leg = self._joint(path.AppendChild(f"{side}Leg"), *_HIP, sign, sign * _SWING)
            self._capsule(leg.AppendChild("Thigh"), -_THIGH[0], *_THIGH[1:])
            knee = self._joint(
                leg.AppendChild("Knee"), 0.0, -2 * _THIGH[0], 0.0, sign * _BEND, is_knee=True
            )
            self._capsule(knee.AppendChild("Shin"), -_SHIN[0], *_SHIN[1:])
            arm = self._joint(path.AppendChild(f"{side}Arm"), *_SHOULDER, sign, -sign * _SWING)
            self._capsule(arm.AppendChild("Arm"), -_ARM[0], *_ARM[1:])

    def _joint(
        self,
        path: Sdf.Path,
        out: float,
        above: float,
        sign: float,
        angle: float,
        *,
        is_knee: bool = False,
    ) -> Sdf.Path:
        """Author a joint that swings about the axis across the way.

        Args:
            path: Where.
            out, above: Distances from the middle and above the parent's origin [height].
            sign: Side on which it is.
            angle: Largest angle [deg].
            is_knee: Whether it bends one way only, while its leg swings forward.
        """
        joint = UsdGeom.Xform.Define(self._scene.stage, path)
        place = np.zeros(3)
        place[self._across], place[self._scene.up] = sign * out, above
        joint.AddTranslateOp().Set(Gf.Vec3d(*(self._height * place).tolist()))
        turn = (joint.AddRotateXOp, joint.AddRotateYOp, joint.AddRotateZOp)[self._across]()
        count = self._steps * _KEYS
        for number in range(count + 1):
            phase = math.pi * number / _KEYS
            swing = max(0.0, math.cos(phase) * math.copysign(1.0, angle)) if is_knee else None
            value = angle * math.sin(phase) if swing is None else abs(angle) * swing
            frame = FIRST + (self._last - FIRST) * number / count
            turn.Set(self._forward * value * (-1.0 if is_knee else 1.0), frame)
        return path

    @property
    def _forward(self) -> float:
        """Sign of a rotation that swings what hangs down forward."""
        axes = np.eye(3)
        moved = np.cross(axes[self._across], -axes[self._scene.up])
        return math.copysign(1.0, float(moved[self._scene.side]))

    def _capsule(self, path: Sdf.Path, above: float, radius: float, length: float) -> None:
        """Author an upright capsule; `above` is the height of its middle."""
        capsule = UsdGeom.Capsule.Define(self._scene.stage, path)
        radius, length = radius * self._height, length * self._height
        capsule.CreateRadiusAttr(radius)
        capsule.CreateHeightAttr(length)
        capsule.CreateAxisAttr("XYZ"[self._scene.up])
        half = np.full(3, radius)
        half[self._scene.up] += 0.5 * length
        self._finish(capsule, above, half)

    def _ball(self, path: Sdf.Path, above: float, radius: float) -> None:
        """Author a ball; `above` is the height of its middle."""
        ball = UsdGeom.Sphere.Define(self._scene.stage, path)
        ball.CreateRadiusAttr(radius * self._height)
        self._finish(ball, above, np.full(3, radius * self._height))

    def _finish(self, shape: UsdGeom.Gprim, above: float, half: np.ndarray) -> None:
        """Place a shape, and let it push."""
        low, high = (Gf.Vec3f(*(sign * half).tolist()) for sign in (-1.0, 1.0))
        shape.CreateExtentAttr([low, high])
        as_grey(shape)
        place = np.zeros(3)
        place[self._scene.up] = above * self._height
        shape.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
        blend = self._scene.local(0.01 * self._height)
        values = {"affector:role": "collide", "affector:friction": 0.1, "affector:blend": blend}
        author(shape.GetPrim(), values)


WADE = Preset(
    name="wade",
    text="a figure walks through the capture, which closes behind it",
    author=_author,
    option=material_option("foliage"),
)
