"""Tests of values as JSON."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.values import (
    Busy,
    Look,
    Opened,
    Picture,
    SimulationStatus,
    ViewState,
    as_json,
)
from usdsplat.render.specs import CameraSpec


def test_a_picture_crosses_a_socket_without_its_image():
    """Oracle: Python's own JSON, which takes and gives back what `as_json` makes."""
    picture = Picture(
        image=np.zeros((2, 2, 3), np.uint8),
        state=ViewState(camera=FreeCamera(), other=Look(aov="Z"), selected=("/A",)),
        camera=CameraSpec(clipping_range=(0.1, math.inf)),
        number=3,
        milliseconds={"total": 4.5},
        boxes=(((0.0, 0.0, 0.0),) * 8,),
    )
    found = json.loads(json.dumps(as_json(picture), allow_nan=False))
    assert "image" not in found and found["type"] == "Picture" and found["number"] == 3
    assert found["camera"]["clipping_range"] == [0.1, None]
    assert found["state"]["camera"]["type"] == "FreeCamera"
    assert found["state"]["other"]["aov"] == "Z" and found["state"]["selected"] == ["/A"]
    assert found["milliseconds"] == {"total": 4.5} and len(found["boxes"][0]) == 8


@pytest.mark.parametrize(
    "event",
    [
        Busy(what="reading"),
        SimulationStatus(state="running", frames=(1.0, 2.0)),
        Opened(name="a", start=1, end=2, rate=24, up_axis="Y", cameras=(), has_simulation=False),
    ],
)
def test_events_keep_their_fields(event):
    """Oracle: their own attributes."""
    found = json.loads(json.dumps(as_json(event)))
    assert found.pop("type") == type(event).__name__
    for name, value in found.items():
        own = getattr(event, name)
        assert value == (list(own) if isinstance(own, tuple) else own)


def test_numbers_of_numpy_are_numbers():
    """Oracle: Python's."""
    value = {"a": np.float32(0.5), "b": np.arange(3), "c": (np.bool_(True), None, math.nan)}
    assert as_json(value) == {"a": 0.5, "b": [0, 1, 2], "c": [True, None, None]}


def test_what_has_no_form_is_refused():
    """Oracle: a wrong call is a bug of ours, and is told at once."""
    with pytest.raises(TypeError, match="object: found no form"):
        as_json(object())
