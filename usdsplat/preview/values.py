"""The values that windows and sessions exchange: frozen, free of USD and Qt.

A window requests a view with a `ViewState`; a session answers with `Picture`s and reports events
with the other values here. They can cross threads and, as JSON, sockets.
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
from usdsplat.preview.overlays import Overlays
from usdsplat.products.display_image import Image
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplaySettings:
    """Display settings; they do not change what is rendered."""

    exposure: float = knob(
        0.0, "of the displayed picture; not of files", unit="stop", range=(-16.0, 16.0)
    )
    gamma: float = knob(1.0, "applied after the view transform", range=(0.1, 5.0))
    channel: Literal["rgb", "red", "green", "blue", "alpha", "luminance"] = knob(
        "rgb", "displayed channel of color"
    )
    background: Literal["black", "grey", "white", "checker"] = knob(
        "grey", "background of empty pixels"
    )
    depth_range: tuple[float, float] = knob(
        (0.0, 0.0),
        "planar depths shown white and black; both 0 use the range of the picture",
        unit="scene unit",
    )
    colormap: Literal["grey", "turbo"] = knob("grey", "of depths")
    id_colors: Literal["ids", "levels"] = knob(
        "ids",
        "of splatId: one for each splat or face, or for each level of splat trees, from blue, "
        "the root, to red",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """A way to look at the stage: the whole picture, or one side of a comparison."""

    aov: str = "color"
    """Name of an AOV in files, see `images.aovs`."""
    time: float | None = None
    """Time code; None is that of the timeline."""
    settings: RenderSettings = field(default_factory=RenderSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewState:
    """The complete state of a viewport's view."""

    size: tuple[int, int] = (960, 720)
    """Width and height of the viewport [screen pixel]."""
    camera: FreeCamera | str | None = None
    """A free camera, the path of a stage's camera, or None for one that frames everything."""
    time: float | None = None
    """Current time [time code]; None is USD's default time."""
    look: Look = field(default_factory=Look)
    other: Look | None = None
    """Look shown right of the wipe; None for no comparison."""
    wipe: float = 0.5
    """Position of the wipe as a fraction of the width."""
    display: DisplaySettings = DisplaySettings()
    purposes: tuple[str, ...] = ("default", "render")
    selected: tuple[str, ...] = ()
    """Paths of the selected prims, which are outlined by their boxes."""
    shows_bounds: bool = False
    """Whether the boxes of all drawn prims are wanted."""
    shows_edges: bool = False
    """Whether the edges of meshes are wanted."""
    shows_lights: bool = False
    """Whether the places of lights are wanted; a window wants them at first."""
    shows_affectors: bool = False
    """Whether the outlines of what acts on simulations are wanted; a window wants them at first."""
    is_moving: bool = False
    """Whether a fast next picture matters more than a good one."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """A picture for a viewport, with how it was made."""

    image: Image
    """Display RGB, row 0 at the top, shape (h, w, 3); of the viewport's size divided by `scale`."""
    state: ViewState
    """The requested state."""
    camera: CameraSpec
    """Camera of the picture."""
    number: int
    """Number of the picture in its session."""
    scale: float = 1.0
    """Viewport pixels per picture pixel along a side; 1 is full quality."""
    is_final: bool = True
    """Whether no better picture follows unless something changes."""
    splats: int = 0
    """Number of splats that may touch the picture."""
    total: int = 0
    """Number of splats on the stage, each instance counted."""
    missing: int = 0
    """Parts of nodes of splat trees that coarser ones replace until they are read."""
    lacks_light: bool = False
    """Whether the picture has an earlier light, or that of the photographs, since the light of the
    stage is not computed yet."""
    milliseconds: dict[str, float] = field(default_factory=dict)
    """Wall time by stage of the frame, including "total"."""
    megabytes: float = 0.0
    """Memory of the process [MB]; 0 if the system does not report it."""
    device: str = "cpu"
    lights: int = 0
    """Number of lights that shine on the stage."""
    boxes: tuple[Corners, ...] = ()
    """Boxes of the selected prims that have one, in the order of `state.selected`."""
    overlays: Overlays = field(default_factory=Overlays)
    """What a window draws over the picture."""
    warnings: tuple[str, ...] = ()
    """A sentence for each prim that cannot be drawn as it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """Event: a stage was opened."""

    name: str
    """Name of the file."""
    start: float
    end: float
    """Last time code of its range; both are 0 if it has none."""
    rate: float
    """Time codes per second."""
    up_axis: Literal["Y", "Z"]
    cameras: tuple[str, ...]
    has_simulation: bool
    lights: tuple[str, ...] = ()
    """AOVs of the stage's light groups."""
    axes: str = ""
    """Axes of a capture, such as "rdf"; "" for a stage."""
    axes_are_assumed: bool = False
    """Whether neither a user, nor the file, nor its splats say what the axes are."""
    baked: tuple[float, float] | None = None
    """First and last frame of the stage's strongest bake [time code]; None without a bake."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageChanged:
    """Event: the stage has changed."""

    structure: bool
    """Whether prims or the time range may have changed; then `Document.opened` returns the new
    state."""
    visibility: bool = False
    """Whether prims may have been shown or hidden."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationStatus:
    """Event: the progress of a simulation."""

    state: Literal["none", "ready", "beginning", "running", "paused", "recording", "failed"]
    frame: float | None = None
    """Time code of the last simulated frame."""
    frames: tuple[float, float] | None = None
    """First and last frame that can be shown [time code]."""
    start: float | None = None
    """First frame of the earliest simulation, before which splats are as captured [time code];
    None for the first frame of the timeline."""
    end: float | None = None
    """Frame at which it stops [time code]."""
    splats: int = 0
    seconds: float = 0.0
    """Time that the last frame took [s]."""
    message: str = ""
    """A sentence for the user; "" for none."""
    notes: tuple[str, ...] = ()
    """Sentences about what was chosen for the user."""
    recorded: tuple[int, int] | None = None
    """Number of frames in the bake that is recorded, held or not, or was recorded last, and of
    those that were asked for; None for no bake."""
    bake: str = ""
    """Path of that bake once it is whole; "" before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Event: an operation failed, with a sentence; the last good picture stays."""

    sentence: str
    of_picture: bool = False
    """Whether drawing a picture failed; the next picture clears the problem."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Busy:
    """Event: a long operation, such as compiling; "" when it is over."""

    what: str
    done: int = 0
    total: int = 0
    """Number of its parts; 0 if it is not known."""
    of_picture: bool = False
    """Whether this is work on the next picture; until it is done, an older one is shown."""


Event = Picture | Opened | StageChanged | SimulationStatus | Problem | Busy


def as_json(value: Any) -> Any:
    """Convert a value of the preview to plain JSON data, pictures without image and overlays.

    A value of a class becomes an object whose "type" names the class. Tuples and arrays become
    lists, and non-finite numbers null. Raises TypeError for other types.
    """
    if is_dataclass(value) and not isinstance(value, type):
        left_out = {"image", "overlays"} if isinstance(value, Picture) else set()
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
