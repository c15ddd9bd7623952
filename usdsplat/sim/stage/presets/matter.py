"""What presets author for captures that hold together: a material, and gravity where it falls."""

from __future__ import annotations

from typing import Any

from usdsplat.sim.materials import MATERIALS
from usdsplat.sim.stage.presets.preset import PresetOption
from usdsplat.sim.stage.presets.scene import Scene

FALL = 4.0
"""Gravity, in sizes of the capture per s^2: of something about 2.5 m large."""


def material_option(default: str | None) -> PresetOption:
    """Return the option of a preset that takes a material."""
    return PresetOption(
        name="material",
        text="what the capture is made of",
        choices=tuple(MATERIALS),
        default=default,
    )


def matter(scene: Scene, material: str) -> dict[str, Any]:
    """Return parameters with which a capture is made of a material."""
    falls = MATERIALS[material].get("gravity", 0.0) > 0
    found: dict[str, Any] = {"matter:enabled": True, "matter:material": material}
    if falls:
        found["particles:gravity"] = scene.world(0.0, -FALL * scene.size, 0.0)
        found["matter:ground"] = not MATERIALS[material].get("hang", False)
    return found
