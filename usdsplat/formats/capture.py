"""The result of reading a capture file: splats and metadata."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from usdsplat.core.cloud import SplatCloud

UNKNOWN_AXES = "the file does not say where its axes point: 'rdf' is assumed, else try 'rub'"
"""Note of readers whose format does not state the axes."""

FrameSource = Literal["given", "file", "evidence", "assumed"]
"""Source of a capture's axes: the caller, the file or its format, the splats, or custom."""
UnitSource = Literal["given", "file", "assumed"]
"""Source of a capture's unit: the caller, the file or its format, or an assumption."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Capture:
    """A capture file in memory."""

    cloud: SplatCloud
    """The splats, decoded, in the file's own axes and order."""
    format: str
    """Format and version for display: "PLY", "SPZ 2"."""
    files: tuple[Path, ...]
    """Files that were read: one, or `meta.json` of an unpacked SOG and the files it names."""
    frame: str
    """Directions of x, y and z (`core.axes`): as the file states, or else as is customary for its
    format."""
    frame_source: FrameSource = "file"
    """Source of `frame`; readers set "file" or "assumed"."""
    frame_score: float | None = None
    """Score of the evidence for `frame`, if that is its source: 0 is none, above 0.7 is clear."""
    meters_per_unit: float | None = None
    """Metres per unit of length; None if neither the file nor its format states it."""
    unit_source: UnitSource = "file"
    """Source of `meters_per_unit`, if it has a value."""
    antialiased: bool = False
    """Whether the capture was trained with the antialiased (mip) projection."""
    color_space: str = "srgb_rec709_scene"
    """Colour space of the radiance, a token of USD's ColorSpaceAPI."""
    error_bounds: Mapping[str, str] = field(default_factory=dict)
    """Maximum error of the encoding, by field of the cloud; fields that are not listed were stored
    as floats."""
    notes: tuple[str, ...] = ()
    """Findings about the file that a user should know, one sentence each."""

    @property
    def states_frame(self) -> bool:
        """Whether the file or its format states the directions of the axes."""
        return self.frame_source == "file"
