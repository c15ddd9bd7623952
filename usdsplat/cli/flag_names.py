"""How options are spelled on the command line. It loads nothing, so errors can use it at once."""

from __future__ import annotations

import re
from collections.abc import Collection

SPELLINGS = {
    "ocio_config": "config",
    "ocio_display": "display",
    "ocio_view": "view",
    "ocio_look": "look",
    "prim_path": "prim",
}
"""Name in the library -> option, where it is another word."""

_OWNER = re.compile("^(?:render (?:settings )?|edit )")
"""What errors name before the option."""


def spelled(name: str) -> str:
    """A name of the library's as an option, without dashes in front."""
    return SPELLINGS.get(name, name).replace("_", "-")


def as_typed(where: str, flags: Collection[str]) -> str:
    """Return what a usage error is about as it is typed, if that is one of `flags`."""
    name = spelled(_OWNER.sub("", where, count=1))
    return f"--{name}" if name in flags else where
