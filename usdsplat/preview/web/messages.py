"""The messages of a page: one frozen class each, read from JSON and checked.

    {"type": "orbit", "right": 0.1, "down": 0.0}  ->  Orbit(right=0.1, down=0.0)

Drags are in fractions of the viewport's height, places in viewport pixels from the upper left.
"""

from __future__ import annotations

import json
import re
from dataclasses import MISSING, dataclass
from typing import Any, Literal, NoReturn

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import checked, knob, knobs

MAX_BYTES = 16384
"""Largest message; every valid one is far smaller."""
MAX_SIDE = 4096
"""Largest side of a viewport [pixel]."""
_LONG = 1024  # characters of a name, path or text; no real path is longer
_DRAG = (-100.0, 100.0)
_SPEED = (-8.0, 8.0)
_PLACE = (0.0, float(MAX_SIDE))
_TIME = (-1e9, 1e9)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Size:
    """The size of the viewport."""

    width: int = knob(MISSING, "width of the viewport", unit="pixel", range=(16, MAX_SIDE))
    height: int = knob(MISSING, "height of the viewport", unit="pixel", range=(16, MAX_SIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drag:
    """The distance that a pointer has moved."""

    right: float = knob(0.0, "distance to the right", range=_DRAG)
    down: float = knob(0.0, "distance downwards", range=_DRAG)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello(_Size):
    """The first message of a page."""

    page: str = knob(
        MISSING, "name chosen by the page; a page that is already known is accepted at once"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOver(_Size):
    """Take control from the page that drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Acknowledge:
    """Say that the page has received a message with a part of a picture. After the last part, the
    page shows the picture."""

    message: int = knob(MISSING, "number of the message", range=(0, 2**53))


@dataclass(frozen=True, slots=True, kw_only=True)
class Resize(_Size):
    """The viewport was resized."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orbit(_Drag):
    """Orbit the target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pan(_Drag):
    """Pan with a drag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dolly:
    """Move towards the target, or away from it."""

    factor: float = knob(MISSING, "factor on the distance", range=(0.01, 100.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class LookAround(_Drag):
    """Turn about the eye."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fly:
    """Set the flight direction, until the next message of this type or the end of the move."""

    right: float = knob(0.0, "multiple of the flight speed", range=_SPEED)
    up: float = knob(0.0, "multiple of the flight speed", range=_SPEED)
    forward: float = knob(0.0, "multiple of the flight speed", range=_SPEED)


@dataclass(frozen=True, slots=True, kw_only=True)
class EndMove:
    """The pointer or keys were released: a picture of full quality is requested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Frame the selection, or everything."""

    everything: bool = knob(False, "whether to frame everything instead of the selection")


@dataclass(frozen=True, slots=True, kw_only=True)
class UseCamera:
    """Look through a camera of the stage."""

    path: str | None = knob(MISSING, "path of the camera; None frames everything")


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Start or stop playback."""

    is_playing: bool = knob(MISSING, "whether playback runs")


@dataclass(frozen=True, slots=True, kw_only=True)
class Advance:
    """Move by frames, and stop playback."""

    frames: int = knob(MISSING, "number of frames", range=(-1000, 1000))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetTime:
    """Show a time."""

    time: float = knob(MISSING, "time code", range=_TIME)
    is_scrubbing: bool = knob(False, "whether further times follow soon, until the drag ends")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetRange:
    """Set the range of playback."""

    start: float = knob(MISSING, "first time code", range=_TIME)
    end: float = knob(MISSING, "last time code", range=_TIME)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLoops:
    """Set whether playback loops."""

    loops: bool = knob(MISSING, "whether playback loops")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetAov:
    """Show another AOV."""

    name: str = knob(MISSING, "name of the AOV, as in files")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSetting:
    """Set a render setting."""

    name: str = knob(MISSING, "name of the knob")
    value: object = knob(MISSING, "value of the knob's type")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetDisplay:
    """Set a display setting."""

    name: str = knob(MISSING, "name of the knob")
    value: object = knob(MISSING, "value of the knob's type")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetOther:
    """Compare with another look, right of the wipe; its settings stay as they are now."""

    aov: str | None = knob(MISSING, "name of its AOV, as in files; None for no comparison")
    time: float | None = knob(None, "its time code; None is that of the timeline", range=_TIME)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetWipe:
    """Move the wipe of a comparison."""

    part: float = knob(MISSING, "its place, as a fraction of the width", range=(0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class AddBookmark:
    """Save the view as a bookmark, which lasts as long as the session."""

    name: str = knob("", "name of the bookmark, replaced if it exists; empty for a new name")


@dataclass(frozen=True, slots=True, kw_only=True)
class RestoreBookmark:
    """Restore the view of a bookmark."""

    name: str = knob(MISSING, "name of the bookmark")


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveBookmark:
    """Remove a bookmark."""

    name: str = knob(MISSING, "name of the bookmark")


@dataclass(frozen=True, slots=True, kw_only=True)
class Select:
    """Select a prim."""

    path: str | None = knob(MISSING, "path of the prim; None for no selection")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetVisible:
    """Show or hide a prim, on the session layer."""

    path: str = knob(MISSING, "path of the prim")
    is_visible: bool = knob(MISSING, "whether it is visible")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetParameter:
    """Set a simulation parameter on the stage."""

    path: str = knob(MISSING, "path of the prim")
    name: str = knob(MISSING, "name of the knob")
    value: object = knob(MISSING, "value of the knob's type")
    drag: int = knob(0, "number shared by all changes of one drag; 0 for a single change")


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulate:
    """Control the simulation."""

    action: Literal["run", "pause", "step", "reset"] = knob(MISSING, "action on the simulation")


@dataclass(frozen=True, slots=True, kw_only=True)
class Pick:
    """Pick a pixel, and select its prim."""

    x: float = knob(MISSING, "distance from the left", unit="pixel", range=_PLACE)
    y: float = knob(MISSING, "distance from the top", unit="pixel", range=_PLACE)
    is_target: bool = knob(False, "whether the camera orbits the picked point from now on")
    is_framed: bool = knob(False, "whether the picked prim is framed; without one, everything")


@dataclass(frozen=True, slots=True, kw_only=True)
class Undo:
    """Undo the last edit of the stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Redo:
    """Redo the last undone edit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reload:
    """Reload the files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListPrims:
    """Request some children of a prim."""

    path: str = knob("/", "path of the prim; / for the roots")
    first: int = knob(0, "index of the first child", range=(0, 2**31))


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPrims:
    """Request the prims whose name, path or type contains a text."""

    text: str = knob(MISSING, "text; * and ? are wildcards")


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """Request the values of a pixel."""

    x: float = knob(MISSING, "distance from the left", unit="pixel", range=_PLACE)
    y: float = knob(MISSING, "distance from the top", unit="pixel", range=_PLACE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Count:
    """Request the histogram of the picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Screenshot:
    """Request the view in full quality, as a PNG to download."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """Request the frames of the timeline's range, to download: a movie, or PNGs in a zip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EndRecord:
    """Stop recording; the frames so far are sent."""


Look = ListPrims | SearchPrims | Probe | Count | Screenshot
"""Messages that change nothing, which pages that only watch may send, too."""
Message = (
    Hello | TakeOver | Acknowledge | Resize | Orbit | Pan | Dolly | LookAround | Fly | EndMove
    | Frame | UseCamera | Play | Advance | SetTime | SetRange | SetLoops | SetAov | SetSetting
    | SetDisplay | SetOther | SetWipe | AddBookmark | RestoreBookmark | RemoveBookmark | Select
    | SetVisible | SetParameter | Simulate | Pick | Undo | Redo | Reload | Record | EndRecord | Look
)  # fmt: skip


def _name(cls: type) -> str:
    """Convert a class name to a message type, such as TakeOver -> take_over."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


MESSAGES: dict[str, type[Message]] = {_name(cls): cls for cls in Message.__args__}
"""Message classes by the `type` of their JSON."""


def read(data: str | bytes) -> Message:
    """Parse a page's message.

    Raises:
        UsageError: If it is not a JSON object, has an unknown type, or has members or values that
            its type does not declare.
    """
    if isinstance(data, bytes):
        raise UsageError("message", f"{len(data)} bytes", "JSON as text")
    try:
        members = json.loads(data, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise UsageError("message", f"{data[:40]!r}", "JSON") from None
    if not isinstance(members, dict):
        raise UsageError("message", type(members).__name__, "a JSON object")
    kind = members.pop("type", None)
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise UsageError("message", f"type {str(kind)[:40]!r}", f"one of {', '.join(MESSAGES)}")
    cls = MESSAGES[kind]
    missing = [
        item.name for item in knobs(cls) if item.default is MISSING and item.name not in members
    ]
    if missing:
        raise UsageError(f"message {kind}", f"no {missing[0]}", f"its {', '.join(missing)}")
    for name, value in members.items():
        if len(name) > _LONG or (isinstance(value, str) and len(value) > _LONG):
            raise UsageError(f"message {kind}", f"{name[:40]!r} too long", f"{_LONG} characters")
    return checked(f"message {kind}", cls, members)


def _refuse_constant(constant: str) -> NoReturn:
    """Reject NaN and Infinity, which Python's reader accepts but JSON does not have."""
    raise ValueError(constant)


def written(kind: str, content: Any) -> str:
    """Return a message to a page as JSON, from plain values."""
    return json.dumps({"type": kind, "content": content}, allow_nan=False, separators=(",", ":"))
