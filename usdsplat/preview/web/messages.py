"""What a page may ask for: one frozen value each, read from JSON and checked.

    {"type": "orbit", "right": 0.1, "down": 0.0}  ->  Orbit(right=0.1, down=0.0)

Drags are in parts of the viewport's height, places in pixels of the viewport from its upper left.
"""

from __future__ import annotations

import json
import re
from dataclasses import MISSING, dataclass
from typing import Any, Literal, NoReturn

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import checked, knob, knobs

MAX_BYTES = 16384
"""Of a message; nothing that a page says comes near."""
MAX_SIDE = 4096
"""Of a viewport [pixel]."""
_LONG = 1024  # characters of a name, path or text; a path this long is nobody's
_DRAG = (-100.0, 100.0)
_SPEED = (-8.0, 8.0)
_PLACE = (0.0, float(MAX_SIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Size:
    """How large the viewport is."""

    width: int = knob(MISSING, "of the viewport", unit="pixel", range=(16, MAX_SIDE))
    height: int = knob(MISSING, "of the viewport", unit="pixel", range=(16, MAX_SIDE))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drag:
    """How far a pointer has moved."""

    right: float = knob(0.0, "of the drag", range=_DRAG)
    down: float = knob(0.0, "of the drag", range=_DRAG)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello(_Size):
    """The first message of a page."""

    page: str = knob(MISSING, "made up by the page: one that comes again is let in at once")


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOver(_Size):
    """Have the view that another page has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Acknowledge:
    """A frame is on the screen; the next one may come."""

    number: int = knob(MISSING, "of the picture", range=(0, 2**53))


@dataclass(frozen=True, slots=True, kw_only=True)
class Resize(_Size):
    """The viewport has another size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orbit(_Drag):
    """Turn about the target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pan(_Drag):
    """Move with a drag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dolly:
    """Go nearer to the target, or away from it."""

    factor: float = knob(MISSING, "of the distance", range=(0.01, 100.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class LookAround(_Drag):
    """Turn about the eye."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fly:
    """Fly from now on, until another one says otherwise or the move ends."""

    right: float = knob(0.0, "of the speed", range=_SPEED)
    up: float = knob(0.0, "of the speed", range=_SPEED)
    forward: float = knob(0.0, "of the speed", range=_SPEED)


@dataclass(frozen=True, slots=True, kw_only=True)
class EndMove:
    """The pointer or the keys have been let go: a good picture is wanted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Look at all of what is selected, or at everything."""

    everything: bool = knob(False, "whatever is selected")


@dataclass(frozen=True, slots=True, kw_only=True)
class UseCamera:
    """Look through a camera of the stage."""

    path: str | None = knob(MISSING, "None for one that frames everything")


@dataclass(frozen=True, slots=True, kw_only=True)
class Play:
    """Start or stop the timeline."""

    is_playing: bool = knob(MISSING, "whether it shall")


@dataclass(frozen=True, slots=True, kw_only=True)
class Advance:
    """Go on by frames, or back, and stop."""

    frames: int = knob(MISSING, "that are gone", range=(-1000, 1000))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetTime:
    """Go to a time."""

    time: float = knob(MISSING, "time code", range=(-1e9, 1e9))
    is_scrubbing: bool = knob(False, "whether others follow soon, until the move ends")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetRange:
    """Play only a part."""

    start: float = knob(MISSING, "first time code", range=(-1e9, 1e9))
    end: float = knob(MISSING, "last time code", range=(-1e9, 1e9))


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLoops:
    """Begin again at the end, or stop there."""

    loops: bool = knob(MISSING, "whether it begins again")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetAov:
    """Show another AOV."""

    name: str = knob(MISSING, "as files have it")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSetting:
    """Turn a knob of the render settings."""

    name: str = knob(MISSING, "of the knob")
    value: object = knob(MISSING, "of the knob's own type")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetDisplay:
    """Turn a knob of the display."""

    name: str = knob(MISSING, "of the knob")
    value: object = knob(MISSING, "of the knob's own type")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetParameter:
    """Turn a knob of the simulation, on the stage."""

    path: str = knob(MISSING, "of the prim")
    name: str = knob(MISSING, "of the knob")
    value: object = knob(MISSING, "of the knob's own type")
    drag: int = knob(0, "which all changes of one drag share; 0 for a change alone")


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulate:
    """Drive the simulation."""

    action: Literal["run", "pause", "step", "reset"] = knob(MISSING, "what it shall do")


@dataclass(frozen=True, slots=True, kw_only=True)
class Pick:
    """Say what is at a place, and select its prim."""

    x: float = knob(MISSING, "from the left", unit="pixel", range=_PLACE)
    y: float = knob(MISSING, "from the top", unit="pixel", range=_PLACE)
    is_target: bool = knob(False, "whether the camera shall turn about it from now on")


@dataclass(frozen=True, slots=True, kw_only=True)
class Undo:
    """Take back the last edit of the stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Redo:
    """Make the edit again that was taken back last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reload:
    """Read the files again."""


Message = (
    Hello | TakeOver | Acknowledge | Resize | Orbit | Pan | Dolly | LookAround | Fly | EndMove
    | Frame | UseCamera | Play | Advance | SetTime | SetRange | SetLoops | SetAov | SetSetting
    | SetDisplay | SetParameter | Simulate | Pick | Undo | Redo | Reload
)  # fmt: skip


def _name(cls: type) -> str:
    """TakeOver -> take_over."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


MESSAGES: dict[str, type[Message]] = {_name(cls): cls for cls in Message.__args__}
"""Each kind of message by the `type` that JSON has."""


def read(data: str | bytes) -> Message:
    """The message that a page sent.

    Raises:
        UsageError: If it is no JSON object, of an unknown type, or has other members or values
            than its type declares.
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
    """NaN and Infinity are not JSON, whatever Python's reader thinks."""
    raise ValueError(constant)


def written(kind: str, content: Any) -> str:
    """A message to a page, of plain values."""
    return json.dumps({"type": kind, "content": content}, allow_nan=False, separators=(",", ":"))
