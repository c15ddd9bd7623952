"""Copy the frame, the selection and the camera of usdview to our viewport.

usdview reports selections, but neither frames nor camera moves, so a timer polls it. Only changes
are copied: what a user does in our viewport stays until usdview itself changes.
"""

from __future__ import annotations

import math
from typing import Any

from pxr import Gf, Sdf

from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.viewer import Viewer


class Following:
    """Copies the state of a usdview to one of our viewers.

    Args:
        api: The API object that usdview gives its plug-ins.
        viewer: Viewer of usdview's current stage.
    """

    def __init__(self, api: Any, viewer: Viewer) -> None:
        self._api = api
        self._viewer = viewer
        self._seen: dict[str, Any] = {}

    def update(self, *, with_camera: bool) -> None:
        """Copy what changed since the last call; the first call copies everything."""
        self._follow_time()
        self._follow_selection()
        if with_camera:
            self._follow_camera()
        else:
            self._seen.pop("camera", None)

    def _follow_time(self) -> None:
        """Copy the frame; pictures may be coarse while usdview plays."""
        frame = self._api.frame
        is_playing = bool(self._api.dataModel.playing)
        if self._is_new("time", frame) and not frame.IsDefault():
            self._viewer.set_time(frame.GetValue(), is_scrubbing=is_playing)
        if self._is_new("playing", is_playing) and not is_playing:
            self._viewer.end_move()

    def _follow_selection(self) -> None:
        """Synchronise the selection both ways: a pick in our viewport selects in usdview too."""
        theirs = tuple(str(path) for path in self._api.selectedPaths if str(path) != "/")
        if self._is_new("selection", theirs):
            self._viewer.select(theirs)
        elif (ours := self._viewer.state.selected) != theirs:
            self._seen["selection"] = ours
            selection = self._api.dataModel.selection
            selection.clearPrims()
            for prim in filter(None, map(self._api.stage.GetPrimAtPath, ours)):
                if selection.getPrimPaths() == [Sdf.Path.absoluteRootPath]:
                    selection.setPrim(prim)  # drops the root, which stands for an empty selection
                else:
                    selection.addPrim(prim)

    def _follow_camera(self) -> None:
        """Copy the camera: pictures are coarse while it moves, and full quality one turn later."""
        camera = self._camera()
        if camera is None:
            return
        if self._is_new("camera", camera):
            self._viewer.use_camera(camera, is_moving="moved" in self._seen)
            self._seen["moved"] = True
        elif self._seen.pop("moved", False):
            self._viewer.end_move()

    def _is_new(self, name: str, value: Any) -> bool:
        is_new = name not in self._seen or self._seen[name] != value
        self._seen[name] = value
        return is_new

    def _camera(self) -> FreeCamera | str | None:
        """Return the camera's path, or usdview's free camera; None before usdview has drawn."""
        prim = self._api.cameraPrim
        if prim:
            return str(prim.GetPath())
        camera = self._api.currentGfCamera
        if camera is None:
            return None
        return free_camera(camera, up_axis=self._viewer.up_axis)


def free_camera(camera: Gf.Camera, *, up_axis: Any) -> FreeCamera:
    """Return our free camera with the view of a usdview camera in a viewport of the same shape."""
    frustum = camera.frustum
    eye = frustum.position
    distance = camera.focusDistance or 1.0
    target = eye + distance * frustum.ComputeViewDirection()
    is_orthographic = camera.projection == Gf.Camera.Orthographic
    if is_orthographic:
        side = min(camera.horizontalAperture, camera.verticalAperture) * Gf.Camera.APERTURE_UNIT
        angle = 2.0 * math.degrees(math.atan(0.5 * side / distance))
    else:
        ways = (Gf.Camera.FOVHorizontal, Gf.Camera.FOVVertical)
        angle = min(camera.GetFieldOfView(way) for way in ways)
    return FreeCamera(
        eye=tuple(eye),
        target=tuple(target),
        up_axis=up_axis,
        field_of_view=angle,
        is_orthographic=is_orthographic,
    )
