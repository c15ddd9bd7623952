"""Actions of keys and menus, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from PySide6.QtWidgets import QApplication

from usdsplat.preview.qt.save_dialogs import Saving
from usdsplat.preview.qt.workspace import Workspace


class Acting(Protocol):
    """A window, as needed by actions."""

    new_requested: Any
    """Signal: another window is requested."""

    @property
    def workspace(self) -> Workspace | None:
        """Workspace of the open stage; None without a stage."""

    @property
    def saving(self) -> Saving | None:
        """Dialogs for saving; None without a stage."""

    def ask_open(self) -> Any:
        """Show a dialog to open a stage."""

    def flip(self) -> Any:
        """Open the capture again, turned upside down."""

    def show_help(self) -> Any:
        """Show the keys."""

    def about(self) -> Any:
        """Show the versions."""

    def close(self) -> Any:
        """Close the window."""


def acts_of(window: Acting) -> dict[str, Callable[[], Any]]:
    """Return the functions of a window's actions; most require an open stage."""

    def here() -> Workspace:
        assert window.workspace is not None
        return window.workspace

    def saving() -> Saving:
        assert window.saving is not None
        return window.saving

    return {
        "open": window.ask_open,
        "new": lambda: window.new_requested.emit(None),
        "reload": lambda: here().reload(),
        "save_session": lambda: saving().session_layer(),
        "save_camera_layer": lambda: saving().camera_layer(),
        "screenshot": lambda: saving().screenshot(),
        "flipbook": lambda: saving().flipbook(),
        "export": lambda: saving().export(),
        "close": window.close,
        "quit": QApplication.closeAllWindows,
        "undo": lambda: here().undo(),
        "redo": lambda: here().redo(),
        "find": lambda: here().search(),
        "deselect": lambda: here().context.viewer.select(()),
        **{
            f"tool_{mode or 'none'}": partial(lambda mode: here().viewport.set_mode(mode), mode)
            for mode in (None, "translate", "rotate", "scale")
        },
        "leave": lambda: here().leave(),
        **{
            side: partial(lambda side: here().context.viewer.face(side), side)
            for side in ("front", "right", "top")
        },
        "frame_selected": lambda: here().frame_selected(),
        "frame_all": lambda: here().context.viewer.frame(()),
        "free_camera": lambda: here().free_camera(),
        "save_camera": lambda: here().save_camera(),
        "add_bookmark": lambda: here().add_bookmark(),
        "flip": window.flip,
        "hud": lambda: here().toggle_hud(),
        **{
            name: partial(lambda name: here().toggle_overlay(name), name)
            for name in ("bounds", "wireframe", "lights", "affectors")
        },
        "levels": lambda: here().toggle_levels(),
        "compare": lambda: here().toggle_compare(),
        "previous_aov": lambda: here().next_aov(-1),
        "next_aov": lambda: here().next_aov(1),
        **{
            channel: partial(lambda channel: here().toggle_channel(channel), channel)
            for channel in ("red", "green", "blue", "alpha", "luminance")
        },
        "darker": lambda: here().expose(-0.5),
        "brighter": lambda: here().expose(0.5),
        "same_exposure": lambda: here().expose(None),
        "add_key": lambda: here().render_panel.lights.add_key(),
        "add_dome": lambda: here().render_panel.lights.add_dome(),
        "add_texture": lambda: here().render_panel.lights.ask_texture(),
        "play": lambda: here().timeline.toggle(),
        "step_on": lambda: here().context.viewer.advance(1),
        "step_back": lambda: here().context.viewer.advance(-1),
        "to_start": lambda: here().timeline.to_start(),
        "to_end": lambda: here().timeline.to_end(),
        "sim_run": lambda: here().simulation.toggle(),
        "sim_step": lambda: here().simulation.one_step(),
        "sim_reset": lambda: here().simulation.to_start(),
        "sim_record": lambda: here().simulation.record_or_stop(),
        "help": window.show_help,
        "about": window.about,
    }
