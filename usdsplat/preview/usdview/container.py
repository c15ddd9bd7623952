"""What usdview loads: a menu. Everything else waits until somebody chooses from it.

usdview calls the two methods below at its start, so nothing here may fail or take time, whatever
Qt it has and whatever is not installed.
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
    "simulation": ("Simulation", "Run the simulation of the stage, and turn its knobs"),
    "settings": ("Render Settings", "How splats are drawn and shown"),
    "probe": ("Probe", "The numbers of pixels and of what is picked"),
    "camera": ("Follow usdview's Camera", "Look through whatever camera usdview looks through"),
}
"""Name -> what the menu says, and what it says when somebody waits there."""


class UsdSplatContainer(PluginContainer):
    """Our commands, as usdview wants them."""

    def registerPlugins(self, plugRegistry: Any, usdviewApi: Any) -> None:
        """Tell usdview of every command."""
        self._commands = [
            plugRegistry.registerCommandPlugin(
                f"UsdSplatContainer.{name}", title, _command(name), text
            )
            for name, (title, text) in COMMANDS.items()
        ]

    def configureView(self, plugRegistry: Any, plugUIBuilder: Any) -> None:
        """Put every command into a menu of ours."""
        menu = plugUIBuilder.findOrCreateMenu(MENU)
        for command in self._commands:
            menu.addItem(command)


def _command(name: str) -> Callable[[Any], None]:
    """What usdview calls when the command is chosen."""

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
