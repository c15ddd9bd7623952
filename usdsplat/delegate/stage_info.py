"""Values of a stage that headers of pictures contain."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StageInfo:
    """Rates, unit, files and drawable prims of a stage."""

    frames_per_second: float
    """Rate of playback."""
    time_codes_per_second: float
    start: float
    """Time code of the first frame; 0 for a stage without a range."""
    meters_per_unit: float
    files: tuple[str, ...]
    """Absolute paths of the files of all used layers, sorted; empty if a layer exists only in
    memory or has unsaved edits. The session layer does not count."""
    clips: tuple[str, ...]
    """Absolute paths of the files of value clips that exist, sorted."""
    prims: tuple[str, ...]
    """Paths of all prims that can be drawn, hidden ones too, sorted. They do not depend on time,
    visibility and purposes: an index in them identifies a prim over a sequence, and between
    runs."""
    lights: tuple[str, ...]
    """AOVs of the light groups of the lights that shine at any time, see `images.aovs`."""
    assets: tuple[str, ...]
    """Paths of the assets of these prims, see `InstanceSpec.asset`, sorted."""
