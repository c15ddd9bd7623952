"""Convert names of the library to names of options.

The module imports nothing heavy, because error messages need it at once.
"""

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
"""Name in the library -> name of the option, if it differs."""

_OWNER = re.compile("^(?:render (?:settings )?|edit )")
"""Prefix of an option in errors of the library."""


def spelled(name: str) -> str:
    """Return the option for a name in the library, without leading dashes."""
    return SPELLINGS.get(name, name).replace("_", "-")


def as_typed(where: str, flags: Collection[str]) -> str:
    """Return the flag that an error is about if it is one of `flags`, otherwise `where`."""
    name = spelled(_OWNER.sub("", where, count=1))
    return f"--{name}" if name in flags else where
