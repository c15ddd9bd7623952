"""Choose which items of the LOD roots of a stage are drawn, for the view of each picture."""

from __future__ import annotations

import numpy as np
from pxr import Usd

from usdsplat.core.lod_heuristics import LodView
from usdsplat.render.framing import conform
from usdsplat.render.specs import View
from usdsplat.schema.lod_roots import ItemChoice, LodRoots, choose_items, find_roots

NOTHING = ItemChoice(shown=frozenset(), hidden=frozenset(), problems=())


class LodItems:
    """The items that are drawn of a stage's LOD roots.

    A picture without a view, such as bounds, has the items of the last view.
    """

    def __init__(self, stage: Usd.Stage) -> None:
        self.choice = NOTHING
        self._stage = stage
        self._roots = LodRoots(prims=(), replaced=frozenset())
        self._view: View | None = None
        self._time: Usd.TimeCode | None = None

    def choose(
        self, view: View | None, time: Usd.TimeCode, *, changed: bool, structural: bool
    ) -> bool:
        """Choose the items for a view; None for the last one. Return whether the choice changed.

        Args:
            view: The view of the next picture.
            time: Time of the picture.
            changed: Whether the stage changed since the last choice.
            structural: Whether there may be other roots than at the last choice.
        """
        if structural:
            self._roots = find_roots(self._stage)
        view = view or self._view
        is_same = not (changed or structural) and (view, time) == (self._view, self._time)
        self._view, self._time = view, time
        if is_same or (not self._roots.prims and self.choice == NOTHING):
            return False
        before = self.choice
        self.choice = choose_items(self._roots, time, None if view is None else lod_view(view))
        return before != self.choice


def lod_view(view: View) -> LodView:
    """Return what heuristics need of a view."""
    camera = view.camera
    to_camera = np.array(camera.world_to_camera, np.float64).reshape(4, 4)
    (left, bottom, right, top), _ = conform(camera.window, view.framing)
    near, far = camera.clipping_range
    wide, high, deep = right - left, top - bottom, far - near
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2 / wide, 2 / high
    if camera.orthographic:
        projection[:3, 3] = -(right + left) / wide, -(top + bottom) / high, -(far + near) / deep
        projection[2, 2], projection[3, 3] = -2 / deep, 1
    else:
        projection[:3, 2] = (right + left) / wide, (top + bottom) / high, -(far + near) / deep
        projection[2, 3], projection[3, 2] = -2 * far * near / deep, -1
    eye = np.linalg.inv(to_camera)[:3, 3]
    return LodView(
        eye=(float(eye[0]), float(eye[1]), float(eye[2])),
        window=(wide, high),
        to_clip=projection @ to_camera,
        is_orthographic=camera.orthographic,
    )
