"""Name the AOVs of the light groups of a stage, and check what pictures with them can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from usdsplat.core.errors import UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.images.aovs import EVERY_LIGHT, LIGHT, is_light
from usdsplat.render.settings import RenderSettings


def with_groups(engine: Engine, names: Sequence[str], *, where: str) -> tuple[str, ...]:
    """Return the names of requested AOVs, those of all light groups in place of EVERY_LIGHT.

    Raises:
        UsageError: If the stage has no light of a group.
    """
    if not any(name in EVERY_LIGHT or name.startswith(LIGHT) for name in names):
        return tuple(names)
    known = engine.stage_info().lights
    found: list[str] = []
    for name in names:
        if name in EVERY_LIGHT:
            found.extend(each for each in known if each not in (*found, *names))
            continue
        if name.startswith(LIGHT) and name not in known:
            expected = f"a light group of the stage: {', '.join(known)}"
            raise UsageError(where, repr(name), expected)
        found.append(name)
    return tuple(found)


def settings_for(
    settings: RenderSettings, aovs: Sequence[str], *, where: str, is_baked: bool
) -> RenderSettings:
    """Return the settings of a picture with AOVs, which is blended linearly if light groups are
    among them.

    Args:
        settings: Settings whose colour mode is not auto.
        is_baked: Whether a view transform is applied to the picture.

    Raises:
        UsageError: If the colours of a picture with light groups are not linear.
    """
    parts = [name for name in aovs if is_light(name)]
    if not parts:
        return settings
    mode = "scene through a view" if is_baked else settings.color_mode
    if mode != "scene":
        found = f"{', '.join(parts)} in color mode {mode}"
        raise UsageError(where, found, "an EXR in color mode scene, in which light adds up")
    return replace(settings, blend_space="linear")
