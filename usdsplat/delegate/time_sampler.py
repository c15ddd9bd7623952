"""Scene and view at other times than that of the picture."""

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
    """Return the scene and the view by times relative to a frame.

    A camera of the stage moves; what `view` has otherwise than the stage stays as it is.

    Args:
        scene: What `go` brings to a time.
        frame: The picture's own time code; None for USD's default time, at which nothing moves.
        spec: The camera of the stage that `view` looks through, at the frame; None for one that is
            nobody's, which stands still.
        go: Goes to a time code.
        camera: The stage's camera at the time gone to.
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
