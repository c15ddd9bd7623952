"""Tests of the messages that a page may send."""

from __future__ import annotations

import json

import pytest

from usdsplat.core.errors import UsageError
from usdsplat.preview.web.messages import MESSAGES, Orbit, SetParameter, TakeOver, UseCamera, read


def test_messages_become_values() -> None:
    """Oracle: written out by hand."""
    assert read('{"type": "orbit", "right": 1, "down": -0.5}') == Orbit(right=1.0, down=-0.5)
    assert read('{"type": "use_camera", "path": null}') == UseCamera(path=None)
    assert read('{"type": "take_over", "width": 640, "height": 480}') == TakeOver(
        width=640, height=480
    )
    assert read(
        '{"type": "set_parameter", "path": "/S", "name": "gain", "value": [1, 2.5, "x"]}'
    ) == SetParameter(path="/S", name="gain", value=[1, 2.5, "x"])


@pytest.mark.parametrize(
    "data",
    [
        "",
        "orbit",
        "[]",
        "null",
        "1",
        '"orbit"',
        "{}",
        '{"type": null}',
        '{"type": ["orbit"]}',
        '{"type": "shutdown"}',
        '{"type": "__class__"}',
        '{"type": "orbit", "right": "1"}',
        '{"type": "orbit", "right": NaN}',
        '{"type": "orbit", "right": Infinity}',
        '{"type": "orbit", "right": 1e400}',
        '{"type": "orbit", "right": 1e9}',
        '{"type": "orbit", "right": true}',
        '{"type": "orbit", "up": 1}',
        '{"type": "orbit", "right": ' + "9" * 6000 + "}",
        '{"type": "resize", "width": 640}',
        '{"type": "resize", "width": 640.5, "height": 480}',
        '{"type": "resize", "width": 1000000, "height": 480}',
        '{"type": "resize", "width": 0, "height": -1}',
        '{"type": "simulate", "action": "close"}',
        '{"type": "simulate", "action": "__init__"}',
        '{"type": "set_time", "time": null}',
        '{"type": "set_aov", "name": "' + "x" * 2000 + '"}',
        '{"type": "hello", "page": "p", "width": 640, "height": 480, "admin": true}',
        "[" * 8000,
        '{"type": "set_setting", "name": "x", "value": ' + "[" * 8000,
        b"\x00\x01",
        b'{"type": "undo"}',
    ],
)
def test_anything_else_is_one_sentence(data: str | bytes) -> None:
    """Oracle: the house's words, *where: found X, expected Y*, short enough for a banner."""
    with pytest.raises(UsageError, match=r"found .*, expected ") as caught:
        read(data)
    assert len(str(caught.value)) < 800


def test_every_message_is_named_as_pages_say_it() -> None:
    """Oracle: the page itself says these."""
    assert {"hello", "take_over", "end_move", "set_parameter", "look_around"} <= set(MESSAGES)
    for kind, cls in MESSAGES.items():
        assert kind == kind.lower() and cls.__doc__
    with pytest.raises(UsageError, match="expected its "):
        read(json.dumps({"type": "hello", "width": 640}))
