"""A small stage for the preview, and its expected pictures."""

from __future__ import annotations

import numpy as np

from tests.delegate.stages import add_camera, two_fields
from usdsplat.delegate.engine import Engine
from usdsplat.preview.values import DisplaySettings, Picture, ViewState

SIZE = (64, 48)
BLACK = DisplaySettings(background="black")
STATE = ViewState(size=SIZE, camera="/Camera", display=BLACK)


class Shown(list):
    """What a document published."""

    @property
    def pictures(self) -> list[Picture]:
        return [each for each in self if isinstance(each, Picture)]


def rounded(color):
    return np.clip(color[..., :3] * np.float32(255) + np.float32(0.5), 0, 255).astype(np.uint8)


def alone(stage, *, time=None, camera="/Camera", size=SIZE, settings=None):
    """What an engine of its own shows, over black."""
    with Engine(stage, time=time) as engine:
        return rounded(engine.picture(engine.view(camera, resolution=size), settings)["color"])


def drawn_by(document, state, most=9):
    """Draw until nothing better follows."""
    for _ in range(most):
        if not document.draw(state):
            return
    raise AssertionError("it never ends")


def animated():
    """Two fields, the second one moving to the right, and a camera."""
    stage = two_fields()
    add_camera(stage)
    for time, x in ((1, 0.0), (6, 3.0)):
        stage.GetAttributeAtPath("/World/B.xformOp:translate").Set((x, 0, 0), time)
    return stage
