"""What crosses between a window and a session: frozen values, and nothing of USD or Qt.

A window says what it wants to see by one `ViewState`; a session answers with `Picture`s and tells
what happened by the other values here. They may cross threads and, as JSON, sockets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

import numpy as np

from usdsplat.core.knobs import knob
from usdsplat.preview.boxes import Corners
from usdsplat.preview.camera import FreeCamera
from usdsplat.products.display_image import Image
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplaySettings:
    """How what was rendered is shown; nothing of it changes what is rendered."""

    exposure: float = knob(
        0.0, "of the picture on the screen; files are not changed", unit="stop", range=(-16.0, 16.0)
    )
    gamma: float = knob(1.0, "applied after the view transform", range=(0.1, 5.0))
    channel: Literal["rgb", "red", "green", "blue", "alpha", "luminance"] = knob(
        "rgb", "which channel of color is shown"
    )
    background: Literal["black", "grey", "white", "checker"] = knob(
        "grey", "what is seen where nothing is"
    )
    depth_range: tuple[float, float] = knob(
        (0.0, 0.0),
        "planar depths shown white and black; both 0 take those of the picture",
        unit="scene unit",
    )
    colormap: Literal["grey", "turbo"] = knob("grey", "of depths")


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One way to see the stage: all of a picture, or one side of a comparison."""

    aov: str = "color"
    """One of `images.aovs.AOVS`, by the name that files use."""
    time: float | None = None
    """Time code; None is the timeline's."""
    settings: RenderSettings = field(default_factory=RenderSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewState:
    """Everything that a viewport shall show."""

    size: tuple[int, int] = (960, 720)
    """Of the viewport, width and height [pixel of the screen]."""
    camera: FreeCamera | str | None = None
    """One of nobody's, the path of a stage's camera, or None for one that frames everything."""
    time: float | None = None
    """Of the timeline [time code]; None is USD's default time."""
    look: Look = field(default_factory=Look)
    other: Look | None = None
    """What is shown right of the wipe; None for no comparison."""
    wipe: float = 0.5
    """Where the comparison is cut, a part of the width."""
    display: DisplaySettings = DisplaySettings()
    purposes: tuple[str, ...] = ("default", "render")
    selected: tuple[str, ...] = ()
    """Paths of the selected prims, which are outlined by their boxes."""
    is_moving: bool = False
    """Whether the next picture matters more than a good one."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """What a viewport shows, once."""

    image: Image
    """Display RGB, row 0 at the top, shape (h, w, 3); of the viewport's size divided by `scale`."""
    state: ViewState
    """What was asked for."""
    camera: CameraSpec
    """What it was seen by."""
    number: int
    """Pictures so far."""
    scale: float = 1.0
    """Pixels of the viewport to a side of a pixel of the picture; 1 is full quality."""
    is_final: bool = True
    """Whether nothing better follows while nothing changes."""
    splats: int = 0
    """That may touch the picture."""
    total: int = 0
    """On the stage, instances counted each."""
    milliseconds: dict[str, float] = field(default_factory=dict)
    """Wall time by stage, "total" among them."""
    megabytes: float = 0.0
    """What the process holds; 0 where the system does not say."""
    device: str = "cpu"
    boxes: tuple[Corners, ...] = ()
    """Of the selected prims that are somewhere, in the order of `state.selected`."""
    warnings: tuple[str, ...] = ()
    """A sentence for each prim that cannot be drawn as it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A stage is there to be looked at."""

    name: str
    """Of the file."""
    start: float
    end: float
    """Its range [time code]; both 0 where it has none."""
    rate: float
    """Time codes in a second at which it plays."""
    up_axis: Literal["Y", "Z"]
    cameras: tuple[str, ...]
    has_simulation: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class StageChanged:
    """Something on the stage is other than before."""

    structure: bool
    """Whether there may be other prims, or another range, than before: `Document.opened` says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationStatus:
    """Where a simulation is."""

    state: Literal["none", "ready", "beginning", "running", "paused", "recording", "failed"]
    frame: float | None = None
    """That was made last [time code]."""
    frames: tuple[float, float] | None = None
    """First and last that can be looked at now [time code]."""
    end: float | None = None
    """Where it stops."""
    splats: int = 0
    seconds: float = 0.0
    """That the last frame took."""
    message: str = ""
    """A sentence, where there is something to say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What could not be done, a sentence; the last good picture stays."""

    sentence: str
    of_picture: bool = False
    """Whether a picture could not be drawn: the next one takes it back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Busy:
    """What takes long, such as compiling; "" when it is over."""

    what: str


Event = Picture | Opened | StageChanged | SimulationStatus | Problem | Busy


def as_json(value: Any) -> Any:
    """Return a value of the preview as JSON has it, pictures without their image.

    A value of a class becomes an object whose "type" names the class; tuples and arrays become
    lists, and numbers that JSON has no word for null. What has no form in JSON raises TypeError.
    """
    if is_dataclass(value) and not isinstance(value, type):
        left_out = {"image"} if isinstance(value, Picture) else set()
        items = {
            item.name: as_json(getattr(value, item.name))
            for item in fields(value)
            if item.name not in left_out
        }
        return {"type": type(value).__name__, **items}
    if isinstance(value, Mapping):
        return {str(key): as_json(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return as_json(value.tolist())
    if isinstance(value, tuple | list):
        return [as_json(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    raise TypeError(f"{type(value).__name__}: found no form in JSON")
