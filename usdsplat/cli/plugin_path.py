"""Print what usdview and other hosts need on PXR_PLUGINPATH_NAME.

examples:
  usdsplat plugin-path
      the folders, as the variable takes them
  usdsplat plugin-path --export
      lines for a shell: eval "$(usdsplat plugin-path --export)"; usdview shot.usd

notes:
  The first folder makes our schemas known to every USD application that starts with the variable.
  The second adds the menu "usdsplat" to usdview. For that usdsplat must be installed in the Python
  that usdview runs in, with its extra [view], and usdview must have been built with PySide6.
"""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usdsplat.cli.arguments import option

VARIABLE = "PXR_PLUGINPATH_NAME"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat plugin-path`."""

    export: Annotated[bool, option()] = False
    """print the line that puts them before what the variable holds"""


def run(options: Options) -> int:
    """Print the folders, or the line."""
    from usdsplat.preview import usdview
    from usdsplat.schema.registration import plugin_folder

    folders = os.pathsep.join(map(str, (plugin_folder(), Path(usdview.__file__).parent)))
    print(_line(folders) if options.export else folders)
    return 0


def _line(folders: str) -> str:
    """What this system's shell sets the variable by; what is there already stays, behind ours."""
    if os.name == "nt":
        return f"set {VARIABLE}={folders};%{VARIABLE}%"
    return f'export {VARIABLE}={shlex.quote(folders)}"${{{VARIABLE}:+:${VARIABLE}}}"'
