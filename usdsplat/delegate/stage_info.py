"""Values of a stage that describe its pictures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StageInfo:
    """Rates, unit and files of a stage."""

    frames_per_second: float
    """Rate of playback."""
    time_codes_per_second: float
    meters_per_unit: float
    files: tuple[str, ...]
    """Absolute paths of the files of all used layers, sorted; empty if a layer exists only in
    memory or has unsaved edits. The session layer does not count."""
