"""Table of keys and gestures, used by menus and the help.

Letters for flight and manipulators are reserved for the viewport, so channels use Shift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Place = Literal["window", "viewport"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """An action with its menu entry and keys."""

    name: str
    """Name of the action."""
    menu: str
    """Menu, and heading in the help."""
    text: str
    keys: tuple[str, ...] = ()
    """Keys; the first one is shown in the menu."""
    place: Place = "window"
    """Scope of the keys: the whole window, or viewport and timeline only."""
    is_checkable: bool = False
    begins: bool = False
    """Whether a separator precedes it in its menu."""


KEYS = (
    Key(name="open", menu="File", text="Open…", keys=("Ctrl+O",)),
    Key(name="new", menu="File", text="New window", keys=("Ctrl+N",)),
    Key(name="reload", menu="File", text="Reload", keys=("Ctrl+R", "F5")),
    Key(
        name="save_session",
        menu="File",
        text="Save session layer as…",
        keys=("Ctrl+S",),
        begins=True,
    ),
    Key(name="save_camera_layer", menu="File", text="Save view as a camera layer…"),
    Key(
        name="screenshot",
        menu="File",
        text="Screenshot…",
        keys=("Ctrl+Shift+S", "F12"),
        begins=True,
    ),
    Key(name="flipbook", menu="File", text="Flipbook…", keys=("Ctrl+Shift+F",)),
    Key(name="export", menu="File", text="Export visible splats…", keys=("Ctrl+E",), begins=True),
    Key(name="close", menu="File", text="Close window", keys=("Ctrl+W",), begins=True),
    Key(name="quit", menu="File", text="Quit", keys=("Ctrl+Q",)),
    Key(name="undo", menu="Edit", text="Undo", keys=("Ctrl+Z",)),
    Key(name="redo", menu="Edit", text="Redo", keys=("Shift+Ctrl+Z", "Ctrl+Y")),
    Key(name="find", menu="Edit", text="Find a prim or a property", keys=("Ctrl+F",), begins=True),
    Key(name="deselect", menu="Edit", text="Clear the selection", keys=("Shift+Ctrl+A",)),
    Key(name="tool_none", menu="Edit", text="Select", keys=("Q",), is_checkable=True, begins=True),
    Key(name="tool_translate", menu="Edit", text="Move", keys=("W",), is_checkable=True),
    Key(name="tool_rotate", menu="Edit", text="Turn", keys=("E",), is_checkable=True),
    Key(name="tool_scale", menu="Edit", text="Scale", keys=("R",), is_checkable=True),
    Key(name="leave", menu="Edit", text="Back to the viewport", keys=("Esc",)),
    Key(name="frame_selected", menu="View", text="Frame the selection", keys=("F",)),
    Key(name="frame_all", menu="View", text="Frame everything", keys=("Shift+F",)),
    Key(name="front", menu="Camera", text="From the front", keys=("1",)),
    Key(name="right", menu="Camera", text="From the right", keys=("3",)),
    Key(name="top", menu="Camera", text="From the top", keys=("7",)),
    Key(name="free_camera", menu="Camera", text="Free camera", keys=("Ctrl+0",)),
    Key(name="save_camera", menu="Camera", text="Save view as a camera on the session layer"),
    Key(name="add_bookmark", menu="Camera", text="Bookmark this view", keys=("Ctrl+B",)),
    Key(name="flip", menu="View", text="Turn the capture upside down", begins=True),
    Key(
        name="hud",
        menu="View",
        text="Heads-up display",
        keys=("H",),
        is_checkable=True,
        begins=True,
    ),
    Key(name="bounds", menu="View", text="Bounds of everything", keys=("B",), is_checkable=True),
    Key(name="wireframe", menu="View", text="Wireframe of meshes", keys=("4",), is_checkable=True),
    Key(name="lights", menu="View", text="Lights", keys=("L",), is_checkable=True),
    Key(
        name="affectors",
        menu="View",
        text="Affectors of simulations",
        keys=("G",),
        is_checkable=True,
    ),
    Key(name="levels", menu="View", text="Levels of splat trees", keys=("5",), is_checkable=True),
    Key(
        name="compare",
        menu="View",
        text="Compare A | B",
        keys=("Shift+W",),
        is_checkable=True,
    ),
    Key(name="previous_aov", menu="View", text="Previous AOV", keys=("[",), begins=True),
    Key(name="next_aov", menu="View", text="Next AOV", keys=("]",)),
    Key(name="red", menu="View", text="Red only", keys=("Shift+R",), begins=True),
    Key(name="green", menu="View", text="Green only", keys=("Shift+G",)),
    Key(name="blue", menu="View", text="Blue only", keys=("Shift+B",)),
    Key(name="alpha", menu="View", text="Alpha only", keys=("Shift+A",)),
    Key(name="luminance", menu="View", text="Luminance only", keys=("Shift+L",)),
    Key(name="darker", menu="View", text="Exposure down", keys=(",",), begins=True),
    Key(name="brighter", menu="View", text="Exposure up", keys=(".",)),
    Key(name="same_exposure", menu="View", text="Exposure as rendered", keys=("/",)),
    Key(name="add_key", menu="Lights", text="Add a key light"),
    Key(name="add_dome", menu="Lights", text="Add a dome light"),
    Key(name="add_texture", menu="Lights", text="Add a dome light with a texture…"),
    Key(name="play", menu="Timeline", text="Play or pause", keys=("Space",)),
    Key(name="step_on", menu="Timeline", text="Next frame", keys=("Right",), place="viewport"),
    Key(name="step_back", menu="Timeline", text="Previous frame", keys=("Left",), place="viewport"),
    Key(name="to_start", menu="Timeline", text="First frame", keys=("Home",), place="viewport"),
    Key(name="to_end", menu="Timeline", text="Last frame", keys=("End",), place="viewport"),
    Key(name="sim_run", menu="Simulation", text="Run or pause", keys=("Ctrl+Space",)),
    Key(name="sim_step", menu="Simulation", text="One frame", keys=("Ctrl+Right",)),
    Key(name="sim_reset", menu="Simulation", text="Back to the start", keys=("Ctrl+Home",)),
    Key(name="sim_record", menu="Simulation", text="Record to a bake, or stop…", begins=True),
    Key(name="help", menu="Help", text="Keys and gestures", keys=("F1",)),
    Key(name="about", menu="Help", text="About"),
)
MENUS = ("File", "Edit", "View", "Camera", "Lights", "Timeline", "Simulation", "Help")

GESTURES = (
    ("Left drag with another tool, Alt + left drag", "orbit"),
    ("Middle drag, Alt + middle drag", "pan"),
    ("Wheel, Alt + right drag", "dolly"),
    ("Right drag", "look around"),
    ("W A S D Q E with the right button", "fly; the wheel sets the speed, Shift is faster"),
    ("Click", "select the prim, and show the splat's values"),
    ("Click the figure of a light", "select the light; the manipulator moves it"),
    ("Click the outline of an affector", "select the affector; the manipulator moves it"),
    ("Shift + click", "add the prim to the selection, or take it out"),
    ("Left drag with the Select tool, Ctrl + left drag", "select the prims in a box"),
    ("Shift + left drag with the Select tool", "add the prims in a box to the selection"),
    ("Double click", "orbit the point under the pointer"),
    ("A", "frame everything"),
    ("X", "the manipulator's axes: the world's or the prim's own"),
    ("Drag a handle", "move the selected prim, also while it simulates"),
    ("Drag the wipe or its handle", "move the line of the comparison"),
    ("Drop a file", "open it in this window"),
)
"""Gestures of the viewport, for the help."""


def help_html() -> str:
    """Return the help page."""
    sections = []
    for menu in MENUS:
        rows = [(", ".join(key.keys), key.text) for key in KEYS if key.menu == menu and key.keys]
        sections.append(_section(menu, rows))
    sections.insert(2, _section("Viewport", list(GESTURES)))
    return "".join(sections)


def _section(title: str, rows: list[tuple[str, str]]) -> str:
    lines = "".join(
        f"<tr><td style='padding: 2px 18px 2px 0'><b>{keys}</b></td><td>{text}</td></tr>"
        for keys, text in rows
    )
    return f"<h3>{title}</h3><table>{lines}</table>"
