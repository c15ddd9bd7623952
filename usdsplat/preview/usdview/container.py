"""The plug-in that usdview loads: a menu. Everything else is imported when a command is chosen.

usdview calls the two methods below at its start, so they must be fast. They must not fail either,
with any version of Qt and with missing packages.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from pxr import Tf
from pxr.Usdviewq.plugin import PluginContainer

from usdsplat.core.errors import UsdSplatError

MENU = "usdsplat"
COMMANDS = {
    "viewport": ("Splat Viewport", "The stage with its splats, drawn by usdsplat"),
    "simulation": ("Simulation", "Run the simulation of the stage and set its parameters"),
    "settings": ("Render Settings", "How splats are rendered and displayed"),
    "probe": ("Probe", "The values of pixels and picked splats"),
    "camera": ("Follow usdview's Camera", "Look through usdview's current camera"),
}
"""Name -> menu text and tool tip."""


class UsdSplatContainer(PluginContainer):
    """Registers our commands with usdview."""

    def registerPlugins(self, plugRegistry: Any, usdviewApi: Any) -> None:
        """Register every command with usdview."""
        self._commands = [
            plugRegistry.registerCommandPlugin(
                f"UsdSplatContainer.{name}", title, _command(name), text
            )
            for name, (title, text) in COMMANDS.items()
        ]

    def configureView(self, plugRegistry: Any, plugUIBuilder: Any) -> None:
        """Add every command to our menu."""
        menu = plugUIBuilder.findOrCreateMenu(MENU)
        for command in self._commands:
            menu.addItem(command)


def _command(name: str) -> Callable[[Any], None]:
    """Return the function that usdview calls when the command is chosen."""

    def run(usdviewApi: Any) -> None:
        from usdsplat.preview.usdview.requirements import check

        try:
            check(usdviewApi.qMainWindow)
            from usdsplat.preview.usdview.host import Host

            Host.of(usdviewApi).show(name)
        except UsdSplatError as error:
            usdviewApi.PrintStatus(f"usdsplat: {error}")
            print(f"usdsplat: {error}", file=sys.stderr)

    return run


Tf.Type.Define(UsdSplatContainer)
