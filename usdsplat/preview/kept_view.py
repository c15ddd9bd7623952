"""What a view keeps when its window opens another file, or another form of the same scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from usdsplat.preview.bookmarks import Bookmark
from usdsplat.preview.values import DisplaySettings, Look, ViewState
from usdsplat.preview.viewer import Viewer

COLOUR = (
    *("color_mode", "blend_space", "working_space"),
    *("ocio_config", "ocio_display", "ocio_view", "ocio_look", "inverse_max"),
)
"""Render settings of colour, which apply to any file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptView:
    """A view of the stage that is left."""

    state: ViewState
    bookmarks: tuple[Bookmark, ...]
    is_same_scene: bool
    """Whether the next stage shows the same scene, so that camera and bookmarks fit it too."""

    def begin(self, viewer: Viewer) -> None:
        """Give a viewer the display, the colour and the overlays, before its stage is opened.

        Of another scene, depths are displayed in the range of its own pictures.
        """
        before, now = self.state, viewer.state
        display, look = before.display, before.look
        if not self.is_same_scene:
            display = replace(display, depth_range=DisplaySettings().depth_range)
            chosen: dict[str, Any] = {name: getattr(look.settings, name) for name in COLOUR}
            look = Look(settings=replace(now.look.settings, **chosen))
        viewer.state = replace(
            now,
            display=display,
            look=look,
            shows_bounds=before.shows_bounds,
            shows_edges=before.shows_edges,
            shows_lights=before.shows_lights,
            shows_affectors=before.shows_affectors,
        )

    def finish(self, viewer: Viewer) -> None:
        """Give a viewer the camera, the purposes and the bookmarks of the same scene, once its
        stage is open."""
        if not self.is_same_scene:
            return
        viewer.bookmarks = self.bookmarks
        viewer.set_purposes(self.state.purposes)
        camera = self.state.camera
        if not isinstance(camera, str) or camera in viewer.cameras:
            viewer.use_camera(camera)
