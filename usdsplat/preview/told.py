"""What is said beside a picture: what the stage asks for and does not get."""

from __future__ import annotations

from usdsplat.preview.scenes import Scene

NO_LIGHTS = "No lights on this stage: splats look as captured"
ALONE = "No other prim shadows this capture: it looks as captured unless Self shadows is on"


def told(scenes: tuple[Scene, ...]) -> tuple[str, ...]:
    """Return the warnings and errors about a picture, as sentences: findings on the stage, problems
    of the GPU, and lighting modes that change nothing. Notes are left out: they ask for no action,
    and would hide sentences that do."""
    engine = scenes[0].engine
    said = [found.told for found in engine.findings if found.severity != "note"]
    if engine.remark:
        said.insert(0, engine.remark)
    wants = any(each.look.settings.lighting != "captured" for each in scenes)
    if wants and not engine.render_scene.named_lights:
        said.append(NO_LIGHTS)
    elif any(_is_alone(each) for each in scenes):
        said.append(ALONE)
    return tuple(said)


def _is_alone(scene: Scene) -> bool:
    """Return whether shadows are asked for that nothing casts: a capture that shows those of its
    own day gets shadows of other captures and meshes, unless it shadows itself."""
    settings, found = scene.look.settings, scene.engine.render_scene
    if settings.lighting != "shadowed" or settings.self_shadows or found.drawn_meshes():
        return False
    trees = [tree for _, tree in found.drawn_trees()]
    fields = [field for _, field, _ in found.drawn()]
    captures = fields + [tree for tree in trees for _ in tree.instances]
    return len(captures) == 1 and captures[0].spec.lighting == "auto"
