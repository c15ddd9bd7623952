"""Make our schemas known to USD, as early as importing `usdsplat.schema`.

USD reads schema plug-ins once, when its schema registry is built: at the first prim of the process.
A plug-in that comes later is ignored without an error, so in a host that has opened a stage before
(usdview, Houdini, a notebook) our type stays unknown. Stock prims do not need it; whoever does
calls `require` and gets one sentence with the cure.
"""

from __future__ import annotations

from pathlib import Path

from pxr import Plug, Usd

from usdsplat.core.errors import SchemaUnavailableError
from usdsplat.schema.tokens import PACKED_TYPE

PLUGIN_NAME = "usdsplat"


def plugin_folder() -> Path:
    """The folder with plugInfo.json: inside the package when installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "plugInfo"
    return installed if installed.is_dir() else package.parent / "plugInfo"


def register() -> None:
    """Tell USD's plug-in registry about our folder, unless the environment already did.

    Never raises and never builds the schema registry, so that others can still register theirs.
    """
    registry = Plug.Registry()
    if not registry.GetPluginWithName(PLUGIN_NAME):
        registry.RegisterPlugins(str(plugin_folder()))


def is_available() -> bool:
    """Whether USD knows our types. Builds the schema registry if nobody has yet."""
    return Usd.SchemaRegistry().FindConcretePrimDefinition(PACKED_TYPE) is not None


def require(where: str) -> None:
    """Refuse to go on without our types.

    Args:
        where: What needs them, such as a prim path.

    Raises:
        SchemaUnavailableError: With the environment variable that cures it.
    """
    if not is_available():
        raise SchemaUnavailableError(
            where,
            f"no {PACKED_TYPE} in USD's schema registry, which was built before usdsplat was "
            "imported",
            f"PXR_PLUGINPATH_NAME={plugin_folder()} in the environment of the process",
        )
