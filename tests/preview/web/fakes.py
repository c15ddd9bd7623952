"""A document that draws nothing, for tests of the layers between document and page."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Usd

from tests.preview.web.pictures import camera
from usdsplat.core.errors import StageError
from usdsplat.preview.values import Event, Opened, Picture, ViewState
from usdsplat.render.subject import Subject, of_box


class FakeDocument:
    """Shows one colour, which is how many pictures there were."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self.stage = Usd.Stage.CreateInMemory()
        self.lock = threading.RLock()
        self.wake: Callable[[], None] = lambda: None
        self.publish = publish
        self.simulation = None
        self.shown = None
        self.states: list[ViewState] = []
        self.may_go_on = threading.Event()
        """Tasks that wait for it keep the session busy."""

    def opened(self) -> Opened:
        """Ten frames, two cameras."""
        return Opened(
            name="fake.usda",
            start=1.0,
            end=10.0,
            rate=24.0,
            up_axis="Y",
            cameras=("/A", "/B"),
            has_simulation=False,
        )

    def bounds(self, paths: tuple[str, ...] = ()) -> Any:
        """There is one box, and anything that is named is as large."""
        return np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0])

    def subject(self, paths: tuple[str, ...] = ()) -> Subject:
        """What is in that box."""
        return of_box(self.bounds(paths))

    def draw(self, state: ViewState, cancel: object = None) -> bool:
        """One picture for each state."""
        if self.states and state == self.states[-1]:
            return False
        self.states.append(state)
        if state.look.aov == "Z":
            raise StageError("/World", "no depth", "some")
        number = len(self.states)
        width, height = state.size
        image = np.full((height, width, 3), number % 256, np.uint8)
        self.publish(
            Picture(
                image=image,
                state=state,
                camera=camera(),
                number=number,
                is_final=not state.is_moving,
                splats=5,
                total=7,
            )
        )
        return False

    def close(self) -> None:
        """Nothing is held."""
        self.may_go_on.set()
