"""Remember how long it takes to compute the light of a scene, to know whether pictures of a
movement can wait for it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from usdsplat.preview.scenes import Scene
from usdsplat.render.frame_stats import FrameStats

QUICK = 60.0
"""Time that light may take to be computed in a movement, too [ms]."""


class LightTimes:
    """The times that light took, by what they depend on: kinds of lights, settings and splats."""

    def __init__(self) -> None:
        self._times: dict[tuple[Any, ...], float] = {}

    def is_quick(self, scene: Scene) -> bool:
        """Return whether the light of a scene is known to take little time, or it has none."""
        lights = scene.engine.render_scene.named_lights
        return not lights or self._times.get(_key(scene), math.inf) <= QUICK

    def note(self, scenes: tuple[Scene, ...], new: Iterable[FrameStats]) -> None:
        """Note how long light took that was computed for a picture with one side."""
        if len(scenes) == 1:
            for each in new:
                if each.light_steps:
                    self._times[_key(scenes[0])] = each.wall_ms["light splats"]


def _key(scene: Scene) -> tuple[Any, ...]:
    how, lights = scene.look.settings, scene.engine.render_scene.named_lights.values()
    return (
        *(how.lighting, how.self_shadows, how.shadow_resolution, how.light_samples),
        *(how.dome_samples, scene.look.aov == "shadow", scene.splats),
        tuple(sorted(light.kind for light in lights)),
    )
