"""Print the folders that usdview and other USD applications need in PXR_PLUGINPATH_NAME.

examples:
  usdsplat plugin-path
      the folders in the format of the variable
  usdsplat plugin-path --export
      a line for a shell: eval "$(usdsplat plugin-path --export)"; usdview shot.usd

notes:
  The first folder registers usdsplat's schemas in every USD application that starts with the
  variable. The second adds the menu "usdsplat" to usdview. For the menu, usdsplat with its extra
  [view] must be installed in usdview's Python, and usdview must be built with PySide6.
"""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option

VARIABLE = "PXR_PLUGINPATH_NAME"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat plugin-path`."""

    export: Annotated[bool, option()] = False
    """print a shell line that prepends the folders to the variable"""


def run(options: Options) -> int:
    """Print the folders, or the shell line."""
    from usdsplat.preview import usdview
    from usdsplat.schema.registration import plugin_folder

    folders = os.pathsep.join(map(str, (plugin_folder(), Path(usdview.__file__).parent)))
    console.say_path(_line(folders) if options.export else folders)
    return 0


def _line(folders: str) -> str:
    """Return the line for this system's shell that prepends `folders` to the variable."""
    if os.name == "nt":
        return f"set {VARIABLE}={folders};%{VARIABLE}%"
    return f'export {VARIABLE}={shlex.quote(folders)}"${{{VARIABLE}:+:${VARIABLE}}}"'
