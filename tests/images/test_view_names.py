"""Tests of the names that an OCIO config offers."""

from __future__ import annotations

import OpenImageIO as oiio

from tests.images.test_view import CONFIG
from usdsplat.images.view_names import view_names


def test_names_are_those_of_the_config():
    """Oracle: OpenImageIO's own reading of it."""
    known = oiio.ColorConfig("ocio://cg-config-latest")
    found = view_names("ocio://cg-config-latest")
    assert found.displays == tuple(known.getDisplayNames())
    assert found.views == tuple(known.getViewNames(found.displays[0]))
    assert found.looks == tuple(known.getLookNames())
    other = view_names("ocio://cg-config-latest", found.displays[-1])
    assert other.views == tuple(known.getViewNames(found.displays[-1]))


def test_an_earlier_error_of_something_else_hides_no_names(tmp_path):
    """Oracle: names that are there without it; a config that appears later is read."""
    assert oiio.ImageInput.open(str(tmp_path / "no.exr")) is None  # leaves an error pending
    assert view_names("ocio://default").displays
    assert view_names(str(tmp_path / "config.ocio")).displays == ()
    oiio.ColorConfig("ocio://default")
    (tmp_path / "config.ocio").write_text(CONFIG)
    assert view_names(str(tmp_path / "config.ocio")).displays == ("Monitor",)
