"""How options are spelled on the command line. It loads nothing, so errors can use it at once."""

from __future__ import annotations

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
    "blend-space",
    "camera",
    "color-mode",
    "config",
    "deep-error",
    "depth-of-field",
    "device",
    "display",
    "filter-width",
    "frame",
    "frames",
    "inverse-max",
    "look",
    "meters-per-unit",
    "motion-blur",
    "multipart",
    "pixel-filter",
    "prim",
    "purposes",
    "rasterize-mode",
    "refinement",
    "resolution",
    "samples",
    "settings",
    "sh-degree",
    "sorting",
    "threads",
    "up-axis",
    "view",
    "working-space",
)
"""Options whose values the library checks, and names in its own words."""


def spelled(name: str) -> str:
    """A name of the library's as an option, without dashes in front."""
    return SPELLINGS.get(name, name).replace("_", "-")


def as_typed(where: str) -> str:
    """An option as it is spelled on the command line, if that is what a usage error is about."""
    name = spelled(where.removeprefix("render settings ").removeprefix("render "))
    return f"--{name}" if name in FLAGS else where
