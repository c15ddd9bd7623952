"""Tests of the text of pages."""

from __future__ import annotations

import json

import pytest

from tests.products.page.pages import Parsed
from usdsplat.products.page import document
from usdsplat.products.page.document import VIEWER, Document, for_script

HOSTILE = '</title></script><script>alert(1)</script><img src=x onerror="alert(2)">&amp;\u2028\\'


def text_of(capture: bytes = b"", **values) -> str:
    settings = {"background": {"color": [0, 0.5, 1]}, "animTracks": [{"name": HOSTILE}]}
    made = {"title": "shot", "settings": settings, "ups": [0.0, 1.0, 0.0], "aspect": 1.5}
    page = Document(**{**made, "antialiased": False, "capture": "scene.sog", **values})
    return b"".join(page.parts(memoryview(capture))).decode()


def test_hostile_names_are_text():
    """Oracle: Python's parser of HTML: the title as it is, and the same elements as for "shot"."""
    page, plain = Parsed(text_of(title=HOSTILE)), Parsed(text_of())
    assert page.title == HOSTILE
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in plain.tags]
    assert "img" not in [tag for tag, _ in page.tags]
    assert page.data["settings"]["animTracks"][0]["name"] == HOSTILE


@pytest.mark.parametrize("value", [HOSTILE, "<!-- <script", {"</script>": ["]]>"]}])
def test_data_does_not_end_its_element(value):
    """Oracle: json, and the character that begins all markup."""
    assert "<" not in for_script(value)
    assert json.loads(for_script(value)) == value


def test_the_capture_is_in_pieces(monkeypatch):
    """Oracle: its bytes, of a length that is no multiple of a piece."""
    monkeypatch.setattr(document, "CHUNK", 30)
    data = bytes(range(200))
    page = Parsed(text_of(data))
    assert page.capture == data
    assert sum(each.get("class") == "capture" for each, _ in page.scripts) == 7


def test_the_viewer_is_in_the_page_whole():
    """Oracle: its files."""
    text = text_of()
    for name in ("index.js", "index.css"):
        assert (VIEWER / name).read_text(encoding="utf-8") in text
    assert (VIEWER / "LICENSE").read_text().splitlines()[2] in text  # the owner


def test_the_viewer_has_no_markup_that_ends_its_element():
    """Oracle: what the parser of a browser acts on inside script and style."""
    script = (VIEWER / "index.js").read_text(encoding="utf-8").lower()
    assert not any(each in script for each in ("</script", "<script", "<!--"))
    assert "</style" not in (VIEWER / "index.css").read_text(encoding="utf-8").lower()


def test_a_page_of_a_folder_names_what_is_beside_it():
    """Oracle: the parser; the viewer is not inside."""
    text = text_of(url="scene.sog")
    page = Parsed(text)
    assert ("link", {"rel": "stylesheet", "href": "viewer/index.css"}) in page.tags
    assert 'import("./viewer/index.js")' in text
    assert (page.data["url"], len(text) < 30_000) == ("scene.sog", True)


def test_the_page_asks_no_other_host():
    """Oracle: no element has an address with a host."""
    tags = Parsed(text_of(b"abc")).tags
    named = [value for _, values in tags for key, value in values.items() if key in ("src", "href")]
    assert named == ["data:,"]
