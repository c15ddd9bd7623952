"""List the names that an OCIO config offers."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass

from usdsplat.core.readable import readable
from usdsplat.images.view import BUILT_IN


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewNames:
    """The names of a config, in its order."""

    displays: tuple[str, ...] = ()
    views: tuple[str, ...] = ()
    """Those of one display."""
    looks: tuple[str, ...] = ()


def view_names(config: str = "", display: str = "") -> ViewNames:
    """Return the names of a config; none if OCIO cannot read it.

    Args:
        config: A file or an ocio:// name; "" for that of the environment, or the built-in one.
        display: The display whose views are listed; "" for the config's first.
    """
    return _read(readable(config or os.environ.get("OCIO") or BUILT_IN), display)


@functools.lru_cache(maxsize=64)
def _read(config: str, display: str) -> ViewNames:
    import OpenImageIO as oiio

    known = oiio.ColorConfig(config)
    if known.geterror() or oiio.geterror():
        return ViewNames()
    displays = tuple(known.getDisplayNames())
    chosen = display if display in displays else next(iter(displays), "")
    return ViewNames(
        displays=displays,
        views=tuple(known.getViewNames(chosen)),
        looks=tuple(known.getLookNames()),
    )
