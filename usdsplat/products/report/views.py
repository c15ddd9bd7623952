"""Draw orthographic pictures from the front, the right and above, all at the same scale."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core import axes
from usdsplat.core.cloud import F64
from usdsplat.delegate.engine import Engine
from usdsplat.products.report.values import Picture, round_down
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View
from usdsplat.schema.stage_values import up_axis

SIDE = 480
"""Width and height of each picture [pixel]."""
BACKGROUND = (32, 34, 38)
_MARGIN = 1.15
_AROUND = 0.25
"""Depth range in front of and behind the subject that is drawn, as a fraction of its size."""

_SIDES = {
    "front": ((1, 0, 0), (0, 1, 0)),
    "right": ((0, 0, -1), (0, 1, 0)),
    "top": ((1, 0, 0), (0, 0, -1)),
}
"""Side -> directions of the picture's right and up, with x right, y up and z back."""


def views(stage: Usd.Stage, time: float | None, frame: str) -> tuple[Picture, ...]:
    """Draw a stage from three sides, framed on the subject without outliers.

    Args:
        stage: The stage; it is not changed.
        time: Time code; None for USD's default time.
        frame: Axes that the titles name: those of the stage, or those of its only capture.

    Returns:
        The pictures; empty if nothing is visible.
    """
    to_reference = axes.change(axes.UP_AXIS_FRAME[up_axis(stage)], "rub")
    with Engine(stage, time=time) as engine:
        engine.sync()
        box = engine.render_scene.subject()
        if box is None or not np.isfinite(box).all():
            return ()
        low, high = np.sort([to_reference @ corner for corner in box], axis=0)
        half = 0.5 * _MARGIN * (float((high - low).max()) or 1.0)
        length = round_down(half / 2)
        return tuple(
            Picture(
                title=f"{side}: {_named(frame, right)} right, {_named(frame, up)} up",
                pixels=_drawn(engine, _camera(to_reference, (low, high), half, right, up)),
                bar=length / (2 * half),
                bar_text=f"{length:g}",
            )
            for side, (right, up) in _SIDES.items()
        )


def _camera(
    to_reference: F64,
    box: tuple[F64, F64],
    half: float,
    right: tuple[int, int, int],
    up: tuple[int, int, int],
) -> CameraSpec:
    """Return a camera that looks at the centre of the box, which is in reference axes."""
    turn = np.array([right, up, np.cross(right, up)], np.float64)
    center, size = 0.5 * (box[0] + box[1]), box[1] - box[0]
    depth = abs(turn[2]) @ size * (0.5 + _AROUND) + _AROUND * half
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ to_reference
    matrix[:3, 3] = -turn @ center - (0.0, 0.0, 2 * depth)
    return CameraSpec(
        world_to_camera=tuple(matrix.ravel().tolist()),
        orthographic=True,
        window=(-half, -half, half, half),
        clipping_range=(depth, 3 * depth),
    )


def _drawn(engine: Engine, camera: CameraSpec) -> npt.NDArray[np.uint8]:
    """Return a picture over the background, shape (SIDE, SIDE, 3)."""
    view = View(camera=camera, framing=Framing(resolution=(SIDE, SIDE)))
    color = engine.picture(view, RenderSettings(color_mode="display"))["color"]
    behind = (1 - color[..., 3:]) * np.array(BACKGROUND, np.float32) / 255
    over = np.clip(np.nan_to_num(color[..., :3] + behind), 0, 1)
    pixels: npt.NDArray[np.uint8] = (over * 255 + 0.5).astype(np.uint8)
    return pixels


def _named(frame: str, direction: tuple[int, int, int]) -> str:
    """Return a direction given in reference axes as an axis of a frame, such as "-y"."""
    along = axes.frame_matrix(frame).T @ direction
    axis = int(np.argmax(np.abs(along)))
    return ("-" if along[axis] < 0 else "") + "xyz"[axis]
