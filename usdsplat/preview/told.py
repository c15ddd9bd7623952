"""What is said beside a picture: what the stage asks for and does not get."""

from __future__ import annotations

from usdsplat.preview.scenes import Scene

NO_LIGHTS = "No lights on this stage: splats look as captured"


def told(scenes: tuple[Scene, ...]) -> tuple[str, ...]:
    """Return findings on the stage, a problem of a GPU, and lights that are missing, as
    sentences."""
    engine = scenes[0].engine
    said = [found.told for found in engine.findings]
    if engine.remark:
        said.insert(0, engine.remark)
    wants = any(each.look.settings.lighting != "captured" for each in scenes)
    if wants and not engine.render_scene.named_lights:
        said.append(NO_LIGHTS)
    return tuple(said)
