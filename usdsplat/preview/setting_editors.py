"""Editors of render settings as viewports offer them: OCIO names as menus, and a colour mode that
follows them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from usdsplat.images.view_names import view_names
from usdsplat.preview.knob_model import NOT_IN_VIEWPORTS, Editor, editors_of, with_value
from usdsplat.render.settings import RenderSettings

UNNAMED = {
    "ocio_display": "the config's first",
    "ocio_view": "plain sRGB, or the display's first",
    "ocio_look": "those of the view",
}
"""OCIO setting -> what it is without a name."""


OTHERWISE: dict[str, dict[str, Any]] = {
    "splat_budget": {"zero_label": "all"},
    "sh_degree": {"label": "SH degree up to"},  # a capture may have fewer
}
"""Setting -> fields of its editor."""


def setting_editors(settings: RenderSettings) -> tuple[Editor, ...]:
    """Return the editors of the settings that viewports offer; a menu's None stands for ""."""
    names = view_names(settings.ocio_config, settings.ocio_display)
    offered = {
        "ocio_display": names.displays,
        "ocio_view": names.views,
        "ocio_look": names.looks,
    }
    return tuple(
        _menu(editor, offered[editor.name])
        if offered.get(editor.name)
        else replace(editor, **OTHERWISE.get(editor.name, {}))
        for editor in editors_of(settings)
        if editor.name not in NOT_IN_VIEWPORTS
    )


def with_setting(settings: RenderSettings, name: str, value: Any) -> RenderSettings:
    """Return settings with another value.

    A view is not seen in the colour mode that viewports have by themselves: the mode becomes
    "scene" with the first OCIO name, and "auto" again without any.

    Raises:
        UsageError: If the setting cannot have this value.
    """
    if name not in UNNAMED:
        return with_value(settings, name, value)
    before = _has_view(settings)
    changed = with_value(settings, name, value or "")
    if _has_view(changed) and not before and changed.color_mode == "auto":
        return replace(changed, color_mode="scene")
    if before and not _has_view(changed) and changed.color_mode == "scene":
        return replace(changed, color_mode="auto")
    return changed


def _menu(editor: Editor, names: tuple[str, ...]) -> Editor:
    """Return an editor of a text as a menu, which offers its value too, if it is none of these."""
    value = editor.value or None
    others = () if value is None or value in names else (value,)
    return replace(
        editor,
        kind="choice",
        value=value,
        default=None,
        choices=(*names, *others),
        none_label=UNNAMED[editor.name],
    )


def _has_view(settings: RenderSettings) -> bool:
    return any(getattr(settings, name) for name in UNNAMED)
