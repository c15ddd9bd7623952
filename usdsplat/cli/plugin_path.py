"""Print the folders that usdview and other USD applications need in PXR_PLUGINPATH_NAME.

examples:
  usdsplat plugin-path
      the folders in the format of the variable
  usdsplat plugin-path --export
      a line for a shell: eval "$(usdsplat plugin-path --export)"; usdview shot.usd
  usdsplat plugin-path --validators
      with the folder of the checks that other applications run through UsdValidation

notes:
  The first folder registers usdsplat's schemas in every USD application that starts with the
  variable. It contains no code. The second adds the menu "usdsplat" to usdview, which must be built
  with PySide6, and whose Python must have usdsplat, but no second USD: docs/view.md, "In usdview",
  says how. The third, of --validators, is only for applications in whose Python usdsplat is
  installed: elsewhere, USD fails to load its validators.
"""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.core.errors import BackendError

VARIABLE = "PXR_PLUGINPATH_NAME"

USES_USD = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat plugin-path`."""

    export: Annotated[bool, option()] = False
    """print a shell line that prepends the folders to the variable"""
    validators: Annotated[bool, option()] = False
    """add the folder of the UsdValidation checks; needs usdsplat in the application's Python, and
    USD 26.5 or newer"""
    json: Annotated[bool, option(excludes="--export")] = False
    """print one JSON object with the name of the variable and the folders"""
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, _: Reporter) -> int:
    """Print the folders, or the shell line."""
    from usdsplat.preview import usdview
    from usdsplat.schema.registration import plugin_folder, takes_validators, validators_folder

    folders = [plugin_folder(), Path(usdview.__file__).parent]
    if options.validators:
        if not takes_validators():
            raise BackendError("--validators", "a USD that takes none from Python", "26.5 or newer")
        folders.append(validators_folder())
    value = os.pathsep.join(map(str, folders))
    if options.json:
        console.print_json({"variable": VARIABLE, "folders": list(map(str, folders))})
        return 0
    console.say_path(_line(value) if options.export else value)
    return 0


def _line(folders: str) -> str:
    """Return the line for this system's shell that prepends `folders` to the variable."""
    if os.name == "nt":
        return f"set {VARIABLE}={folders};%{VARIABLE}%"
    return f'export {VARIABLE}={shlex.quote(folders)}"${{{VARIABLE}:+:${VARIABLE}}}"'
