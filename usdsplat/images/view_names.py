"""List the names that an OCIO config offers."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from usdsplat.core.readable import readable
from usdsplat.images.view import config_in_effect


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
    try:
        return _read(readable(config_in_effect(config)), display)
    except OSError:
        return ViewNames()


@functools.lru_cache(maxsize=64)
def _read(config: str, display: str) -> ViewNames:
    """Read the names; failures, which raise an OSError, are not cached."""
    import OpenImageIO as oiio

    oiio.geterror()  # an earlier one, of something else
    known = oiio.ColorConfig(config)
    if known.geterror() or oiio.geterror():
        raise OSError(config)
    displays = tuple(known.getDisplayNames())
    chosen = display if display in displays else next(iter(displays), "")
    return ViewNames(
        displays=displays,
        views=tuple(known.getViewNames(chosen)),
        looks=tuple(known.getLookNames()),
    )
