"""What a reader hands over: the splats, and what the file said or left unsaid about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from usdsplat.core.cloud import SplatCloud

UNKNOWN_AXES = "the file does not say where its axes point: 'rdf' is assumed, else try 'rub'"
"""A note of every reader whose files have no word on it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Capture:
    """A capture file in memory."""

    cloud: SplatCloud
    """The splats, every encoding undone, in the file's own frame and order."""
    format: str
    """Format and version, for people: "PLY", "SPZ 2"."""
    files: tuple[Path, ...]
    """What was read: one file, or those of an unpacked SOG that its `meta.json` names, and that."""
    frame: str
    """Where x, y and z point (`core.axes`): as the file says, else as files of its kind do."""
    antialiased: bool = False
    """Whether the capture was trained with the antialiased (mip) projection."""
    color_space: str = "srgb_rec709_scene"
    """Colour space of the radiance, a token of USD's ColorSpaceAPI."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Field of the cloud -> how far its values may be from those that were encoded; fields that are
    not listed were stored as floats."""
    notes: tuple[str, ...] = ()
    """What a careful reader would want to be told, a sentence each."""

    @property
    def states_frame(self) -> bool:
        """Whether the file, or what its format demands, says where its axes point."""
        return UNKNOWN_AXES not in self.notes
