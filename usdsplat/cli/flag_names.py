"""How options are spelled on the command line. It loads nothing, so errors can use it at once."""

from __future__ import annotations

import re

SPELLINGS = {
    "ocio_config": "config",
    "ocio_display": "display",
    "ocio_view": "view",
    "ocio_look": "look",
    "prim_path": "prim",
}
"""Name in the library -> option, where it is another word."""

FLAGS = (
    "aovs",
    "axes",
    "blend-space",
    "camera",
    "color-mode",
    "config",
    "crop-box",
    "crop-sphere",
    "decimate",
    "deep-error",
    "depth-of-field",
    "device",
    "display",
    "drop-nan",
    "drop-outliers",
    "filter-width",
    "frame",
    "frames",
    "inverse-max",
    "look",
    "max-opacity",
    "max-size",
    "meters-per-unit",
    "min-opacity",
    "min-size",
    "morton",
    "motion-blur",
    "multipart",
    "pixel-filter",
    "prim",
    "purposes",
    "rasterize-mode",
    "refinement",
    "resolution",
    "rotate",
    "samples",
    "scale",
    "settings",
    "sh-degree",
    "sorting",
    "split",
    "threads",
    "translate",
    "up-axis",
    "view",
    "working-space",
)
"""Options whose values the library checks, and names in its own words."""


_OWNER = re.compile("^(?:render (?:settings )?|edit )")
"""What errors name before the option."""


def spelled(name: str) -> str:
    """A name of the library's as an option, without dashes in front."""
    return SPELLINGS.get(name, name).replace("_", "-")


def as_typed(where: str) -> str:
    """An option as it is spelled on the command line, if that is what a usage error is about."""
    name = spelled(_OWNER.sub("", where, count=1))
    return f"--{name}" if name in FLAGS else where
