"""Tests of editors of render settings: menus of OCIO names, and the colour mode that follows."""

from __future__ import annotations

import OpenImageIO as oiio
import pytest

from usdsplat.core.errors import UsageError
from usdsplat.preview.knob_model import NOT_IN_VIEWPORTS, editors_of
from usdsplat.preview.setting_editors import setting_editors, with_setting
from usdsplat.render.settings import RenderSettings

CONFIG = "ocio://studio-config-latest"


def by_name(settings):
    return {editor.name: editor for editor in setting_editors(settings)}


def test_ocio_names_are_menus_of_the_config():
    """Oracle: OpenImageIO's own reading of the config."""
    known = oiio.ColorConfig(CONFIG)
    display = known.getDisplayNames()[1]
    found = by_name(RenderSettings(ocio_config=CONFIG, ocio_display=display))
    assert found["ocio_display"].choices == tuple(known.getDisplayNames())
    assert found["ocio_view"].choices == tuple(known.getViewNames(display))
    assert found["ocio_look"].choices == tuple(known.getLookNames())
    assert (found["ocio_display"].value, found["ocio_view"].value) == (display, None)
    assert found["ocio_config"].kind == "text"


def test_other_editors_stay_as_they_are():
    """Oracle: the model of all knobs."""
    names = [e.name for e in editors_of(RenderSettings()) if e.name not in NOT_IN_VIEWPORTS]
    assert list(by_name(RenderSettings())) == names
    assert with_setting(RenderSettings(), "sh_degree", 2).sh_degree == 2


def test_a_name_that_is_in_no_menu_is_kept():
    """Oracle: looks may be several, separated by commas."""
    editor = by_name(RenderSettings(ocio_config=CONFIG, ocio_look="one, two"))["ocio_look"]
    assert editor.value == "one, two" and editor.value in editor.choices


def test_names_are_texts_where_the_config_cannot_be_read():
    """Oracle: nothing to choose from."""
    found = by_name(RenderSettings(ocio_config="/nowhere/config.ocio"))
    assert {found[f"ocio_{name}"].kind for name in ("display", "view", "look")} == {"text"}


@pytest.mark.parametrize("name", ["ocio_display", "ocio_view", "ocio_look"])
def test_the_colour_mode_follows_the_view(name):
    """Oracle: written out: a view is not seen in the mode display."""
    settings = with_setting(RenderSettings(), name, "x")
    assert (getattr(settings, name), settings.color_mode) == ("x", "scene")
    assert with_setting(settings, name, None) == RenderSettings()
    chosen = RenderSettings(color_mode="inverseView")
    assert with_setting(chosen, name, "x").color_mode == "inverseView"
    with pytest.raises(UsageError, match=name):
        with_setting(settings, name, 3.5)
