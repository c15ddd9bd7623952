"""A session that records requests, for tests of its clients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat.core.errors import UsdSplatError
from usdsplat.delegate.default_camera import frame_subject
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.session import Session
from usdsplat.preview.values import Opened, Picture, ViewState
from usdsplat.preview.viewer import Viewer
from usdsplat.render.fields import Box
from usdsplat.render.specs import Matrix
from usdsplat.render.subject import Subject, of_box

BOX = (np.array((-1.0, -1.0, -1.0)), np.array((1.0, 2.0, 1.0)))
OPENED = Opened(
    name="tiny.usda",
    start=1.0,
    end=24.0,
    rate=24.0,
    up_axis="Y",
    cameras=("/Camera",),
    has_simulation=False,
)


class FakeEdits:
    """Remembers what was moved where, under which key."""

    def __init__(self) -> None:
        self.moves: list[tuple[str, Matrix, float | None, str | None]] = []
        self.error: UsdSplatError | None = None
        self.verbs: list[str] = []

    def set_transform(
        self,
        path: str,
        matrix: Matrix,
        *,
        time: float | None = None,
        merge: str | None = None,
        verb: str = "Move",
    ) -> None:
        """As `Edits.set_transform`."""
        self.verbs.append(verb)
        if self.error is not None:
            raise self.error
        self.moves.append((path, matrix, time, merge))


class FakeDocument:
    """Answers for boxes, and has a stage with a ball at (0.5, 0, 0) and a material."""

    def __init__(self) -> None:
        self.box: Box | None = BOX
        self.says = OPENED
        self.asked: list[tuple[str, ...]] = []
        self.edits = FakeEdits()
        self.stage = Usd.Stage.CreateInMemory()
        UsdGeom.Sphere.Define(self.stage, "/Ball").AddTranslateOp().Set((0.5, 0.0, 0.0))
        self.stage.DefinePrim("/Look", "Material")

    def opened(self) -> Opened:
        """As `Document.opened`."""
        return self.says

    def bounds(self, paths: tuple[str, ...] = ()) -> Box | None:
        """As `Document.bounds`."""
        self.asked.append(paths)
        return self.box

    def subject(self, paths: tuple[str, ...] = ()) -> Subject | None:
        """As `Document.subject`."""
        self.asked.append(paths)
        return None if self.box is None else of_box(self.box)


class FakeSession(Session):
    """Remembers states; does tasks at once, or, held back, when it is let."""

    def __init__(self) -> None:
        super().__init__(lambda publish: None, own_thread=False)
        self.document = FakeDocument()
        self.states: list[ViewState] = []
        self.waiting: list[tuple[Any, Any, Any]] = []
        self.is_held_back = False
        self.problems: list[str] = []

    def look(self, state: ViewState) -> None:
        """Remember what shall be seen."""
        self.states.append(state)

    def ask(
        self,
        task: Callable[[Any], Any],
        done: Callable[[Any], None] = lambda result: None,
        failed: Callable[[UsdSplatError], None] | None = None,
    ) -> None:
        """Do it, or keep it for `let`."""
        self.waiting.append((task, done, failed or self.complain))
        if not self.is_held_back:
            self.let()

    def complain(self, error: UsdSplatError) -> None:
        """Remember the sentence."""
        self.problems.append(str(error))

    def let(self) -> None:
        """Do what waits."""
        waiting, self.waiting = self.waiting, []
        for task, done, failed in waiting:
            try:
                result = task(self.document)
            except UsdSplatError as error:
                failed(error)
            else:
                done(result)


def picture_of(state: ViewState, **values: Any) -> Picture:
    """What a session would show for a state, in plain grey."""
    width, height = state.size
    aspect = width / height
    camera = (
        state.camera.spec(aspect=aspect, bounds=BOX)
        if isinstance(state.camera, FreeCamera)
        else frame_subject(of_box(BOX), BOX, up_axis="Y", aspect=aspect)
    )
    image = np.full((height, width, 3), 90, np.uint8)
    return Picture(**{"image": image, "state": state, "camera": camera, "number": 1, **values})


def begun(**options: object) -> tuple[Viewer, FakeSession]:
    """A viewer that has seen a first picture."""
    session = FakeSession()
    viewer = Viewer(session, **options)
    viewer.resize(800, 400)
    viewer.opened(OPENED)
    viewer.shown(picture_of(viewer.state))
    return viewer, session


def camera_of(viewer: Viewer) -> FreeCamera:
    """The free camera that is looked through."""
    assert isinstance(viewer.state.camera, FreeCamera)
    return viewer.state.camera
