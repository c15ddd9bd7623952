"""Register our schemas and our validators with USD.

USD reads schema plug-ins once, when it builds its schema registry at the first prim of the process.
A plug-in that is registered later is ignored without an error. In a host that has opened a stage
before (usdview, Houdini, a notebook), our packed type then stays unknown. Stock prims work without
it. Code that needs it calls `require`, which raises an error that names the fix.

The two plug-ins lie in two folders. The schemas need no code, so their folder may be on the
PXR_PLUGINPATH_NAME of every process. The validators import our package: where it is not installed,
USD fails to load all validators, not just ours, if their folder is on the path.
"""

from __future__ import annotations

from pathlib import Path

from pxr import Plug, Usd

from usdsplat.core.errors import SchemaUnavailableError
from usdsplat.schema.tokens import PACKED_TYPE

PLUGIN_NAME = "usdsplat"
VALIDATORS_NAME = "usdsplat.schema.validation.plugin"
VALIDATORS_SINCE = (0, 26, 5)
"""First version of USD that takes validators from Python."""


def plugin_folder() -> Path:
    """Return the folder of the schemas' plugInfo.json: in the package when installed, beside it
    in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "plugInfo"
    return installed if installed.is_dir() else package.parent / "plugInfo"


def validators_folder() -> Path:
    """Return the folder of the validators' plugInfo.json, which only a Python with our package
    may have on its path."""
    return Path(__file__).resolve().parent / "validation"


def takes_validators() -> bool:
    """Return whether this version of USD takes validators from Python."""
    return Usd.GetVersion() >= VALIDATORS_SINCE


def register() -> None:
    """Register our plug-ins with USD, unless PXR_PLUGINPATH_NAME already has.

    Never raises and never builds the schema registry, so that other plug-ins can still register.
    """
    registry = Plug.Registry()
    folders = {PLUGIN_NAME: plugin_folder()}
    if takes_validators():
        folders[VALIDATORS_NAME] = validators_folder()
    for name, folder in folders.items():
        if not registry.GetPluginWithName(name):
            registry.RegisterPlugins(str(folder))


def is_available() -> bool:
    """Return whether USD has our types. This builds its schema registry if it does not exist."""
    return Usd.SchemaRegistry().FindConcretePrimDefinition(PACKED_TYPE) is not None


def require(where: str) -> None:
    """Raise an error if USD does not know our types.

    Args:
        where: The object that needs them, such as a prim path.

    Raises:
        SchemaUnavailableError: Names the environment variable to set.
    """
    if not is_available():
        raise SchemaUnavailableError(
            where,
            f"no {PACKED_TYPE} in USD's schema registry, which was built before usdsplat was "
            "imported",
            f"PXR_PLUGINPATH_NAME={plugin_folder()} in the environment of the process",
        )
