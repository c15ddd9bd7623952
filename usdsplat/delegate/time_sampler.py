"""Sample scene and view at times other than that of the picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace

from usdsplat.render.frame_context import Moment, TimeSampler
from usdsplat.render.scene import RenderScene
from usdsplat.render.specs import CameraSpec, View


def other_times(
    scene: RenderScene,
    view: View,
    *,
    frame: float | None,
    spec: CameraSpec | None,
    go: Callable[[float], None],
    camera: Callable[[], CameraSpec],
) -> TimeSampler:
    """Return a sampler of scene and view at times relative to a frame.

    A camera of the stage moves; values that `view` overrides stay constant.

    Args:
        scene: The render scene, which `go` brings to a time.
        frame: The picture's own time code; None for USD's default time, at which nothing moves.
        spec: The stage's camera of `view`, at the frame; None for a camera that is not on the
            stage, which does not move.
        go: Function that goes to a time code.
        camera: Function that returns the stage's camera at that time.
    """
    own = {k: v for k, v in asdict(view.camera).items() if spec and v != getattr(spec, k)}

    def at(time: float) -> Moment:
        if frame is None:
            return scene, view
        go(frame + time)
        if spec is None or time == 0.0:
            return scene, view
        return scene, replace(view, camera=replace(camera(), **own))

    return at
