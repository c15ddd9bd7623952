"""Tests of the page's panels in a headless browser: what the window has, too."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.delegate.stages import add_camera, two_fields
from tests.preview.web.seats import Seat, animated
from usdsplat.preview.document import Document
from usdsplat.preview.histogram import histogram
from usdsplat.preview.probe import probe
from usdsplat.preview.saving import save_view
from usdsplat.preview.web.questions import MOST_ROWS

LAST = 3.0
"""Frames of the stage's range."""


@pytest.fixture(scope="module")
def seat(browser: Any) -> Iterator[Seat]:
    """Before two clouds, one of which moves, and a camera; every panel is open."""
    stage = animated(two_fields(), "/World/B", end=LAST)
    add_camera(stage)
    seat = Seat(browser, lambda publish: Document(stage, publish=publish))
    seat.rested()
    seat.page.evaluate(
        """() => document.querySelectorAll("#panels > details").forEach((each) => {
          each.open = true;
        })"""
    )
    yield seat
    seat.close()


@pytest.fixture(autouse=True)
def no_complaints(seat: Seat) -> Iterator[None]:
    """Oracle: the console of a page that is well says nothing."""
    yield
    assert seat.errors == []


def answer(seat: Seat, task: Any) -> Any:
    """What a task on the document returns."""
    found: list[Any] = []
    seat.ask(lambda document: found.append(task(document)))
    return found[0]


def colourful(seat: Seat) -> tuple[int, int]:
    """A pixel of the picture where there is a splat."""
    rows, columns = np.nonzero(np.ptp(seat.canvas()[1].astype(int), axis=2) > 60)
    return int(columns[len(columns) // 2]), int(rows[len(rows) // 2])


def opened(file: Any) -> Any:
    """An image file, by Pillow."""
    from PIL import Image

    return Image.open(file)


def names(seat: Seat) -> list[str]:
    """The prims in the tree, from the top."""
    found: list[str] = seat.page.locator("#prims .prim-name").all_inner_texts()
    return found


def test_prims_are_unfolded_searched_and_selected(seat: Seat) -> None:
    """Oracle: the stage's own hierarchy, and the state's selection."""
    page = seat.page
    page.get_by_role("button", name="Children of World").click()
    page.get_by_role("button", name="B", exact=True).wait_for()
    expected = answer(
        seat, lambda document: [each.GetName() for each in document.stage.TraverseAll()]
    )
    assert [each for each in names(seat) if each in ("World", "A", "B")] == [
        each for each in expected if each in ("World", "A", "B")
    ]
    page.get_by_role("button", name="B", exact=True).click()
    page.locator('#prims .prim-name[aria-pressed="true"]').wait_for()
    assert seat.session._state.selected == ("/World/B",)
    page.get_by_label("Search prims").fill("/World/*")
    page.get_by_role("button", name="/World/A", exact=True).wait_for()
    assert set(names(seat)) == {"/World/A", "/World/B"}
    page.get_by_label("Search prims").fill("nothing of that name")
    page.get_by_text("Nothing matches.").wait_for()
    page.get_by_label("Search prims").fill("")
    page.get_by_role("button", name="Children of World").wait_for()
    seat.rested()


def test_a_prim_is_hidden_and_the_hiding_undone(seat: Seat) -> None:
    """Oracle: the computed visibility, and the first picture again, bit for bit."""
    page = seat.page
    before = seat.canvas()[1]
    number = seat.rested()
    page.get_by_role("button", name="Children of World").click()
    page.get_by_role("button", name="Hide B", exact=True).click()
    page.get_by_role("button", name="Show B", exact=True).wait_for()
    attribute = "/World/B.visibility"
    value = answer(seat, lambda document: document.stage.GetAttributeAtPath(attribute).Get())
    assert value == "invisible"
    number = seat.rested(number)
    assert not np.array_equal(seat.canvas()[1], before)
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("button", name="Hide B", exact=True).wait_for()
    seat.rested(number)
    assert np.array_equal(seat.canvas()[1], before)


def test_what_more_has_loaded_stays_after_a_change(seat: Seat) -> None:
    """Oracle: the names in stage order; prims that are gone are gone from the list."""
    page, count = seat.page, MOST_ROWS + 5
    many = [f"/Many/P{number}" for number in range(count)]
    answer(seat, lambda document: [document.stage.DefinePrim(each) for each in many])
    page.get_by_role("button", name="Children of Many").click()
    page.get_by_role("button", name="More…").click()
    last = page.get_by_role("button", name=f"P{count - 1}", exact=True)
    last.wait_for()
    answer(seat, lambda document: document.stage.DefinePrim("/Many/Last", "Scope"))
    page.get_by_role("button", name="Last", exact=True).wait_for()
    expected = [each.rpartition("/")[2] for each in (*many, "/Many/Last")]
    assert [each for each in names(seat) if each in expected] == expected
    answer(seat, lambda document: [document.stage.RemovePrim(each) for each in many[3:]])
    last.wait_for(state="detached")
    expected = [*expected[:3], "Last"]
    page.wait_for_function("() => document.querySelector('.more-prims') === null")
    assert [each for each in names(seat) if each.startswith(("P", "Last"))] == expected
    answer(seat, lambda document: document.stage.RemovePrim("/Many"))
    page.get_by_role("button", name="Children of Many").wait_for(state="detached")
    seat.rested()


def test_a_wipe_compares_two_aovs(seat: Seat) -> None:
    """Oracle: the state; left of the wipe the first picture, right of it that of the AOV alone."""
    page = seat.page
    number, color = seat.rested(), seat.canvas()[1]
    page.get_by_label("AOV").select_option("N")
    number = seat.rested(number, accept=lambda picture: picture.state.look.aov == "N")
    normals = seat.canvas()[1]
    page.get_by_label("AOV").select_option("color")
    number = seat.rested(number, accept=lambda picture: picture.state.look.aov == "color")
    page.get_by_label("B shows").select_option("N")
    page.get_by_label("A | B with a wipe").check()
    number = seat.rested(number, accept=lambda picture: picture.state.other is not None)
    pixels, half = seat.canvas()[1], color.shape[1] // 2
    assert np.array_equal(pixels[:, : half - 2], color[:, : half - 2])
    assert np.array_equal(pixels[:, half + 2 :], normals[:, half + 2 :])
    wipe = page.locator("#wipe").bounding_box()
    x, y = wipe["x"] + wipe["width"] / 2, wipe["y"] + 300
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 100, y, steps=4)
    page.mouse.up()
    seat.rested(number, accept=lambda picture: picture.state.wipe < 0.45)
    width = page.locator("#viewport").bounding_box()["width"]
    assert seat.session._state.wipe == pytest.approx(0.5 - 100 / width, abs=2 / width)
    page.get_by_label("frame of B").fill("2")
    page.get_by_label("frame of B").press("Tab")
    page.get_by_text("B · N · frame 2").wait_for()
    assert seat.session._state.other.time == 2.0
    page.get_by_label("A | B with a wipe").uncheck()
    page.locator("#wipe").wait_for(state="hidden")
    seat.rested(number, accept=lambda picture: picture.state.other is None)


def test_views_are_bookmarked_restored_and_removed(seat: Seat) -> None:
    """Oracle: the state's camera, by name."""
    page = seat.page
    page.get_by_label("Name of this view").fill("all of it")
    page.get_by_role("button", name="Add").click()
    page.get_by_role("button", name="all of it", exact=True).wait_for()
    number = seat.rested()
    camera = seat.picture(number).camera
    page.mouse.move(300, 300)
    page.mouse.wheel(0, -300)
    number = seat.rested(number, accept=lambda picture: picture.camera != camera)
    page.get_by_role("button", name="all of it", exact=True).click()
    number = seat.rested(number)
    np.testing.assert_allclose(
        seat.picture(number).camera.world_to_camera, camera.world_to_camera, atol=1e-9
    )
    page.get_by_role("button", name="Remove all of it").click()
    page.get_by_role("button", name="all of it", exact=True).wait_for(state="detached")


def test_the_probe_follows_the_pointer(seat: Seat) -> None:
    """Oracle: `probe` of the same pixel."""
    seat.rested()
    x, y = colourful(seat)
    box = seat.page.locator("#picture").bounding_box()
    seat.page.mouse.move(box["x"] + x + 0.5, box["y"] + y + 0.5)
    seat.page.locator("#probed").get_by_text(f"{x}, {y}", exact=True).wait_for()
    expected = answer(seat, lambda document: probe(document, x, y))
    assert expected.path in seat.page.locator("#probed").inner_text()
    colour = seat.page.locator("#swatch").evaluate("each => getComputedStyle(each).backgroundColor")
    assert colour == "rgb({}, {}, {})".format(*(round(255 * each) for each in expected.shown))


def test_the_probe_and_the_wipe_of_a_page_of_another_shape_follow_the_picture(seat: Seat) -> None:
    """Oracle: CSS's object-fit: contain; `probe` of the pixel of the driver's viewport."""
    number = seat.rested()
    x, y = colourful(seat)
    height, width = seat.canvas()[1].shape[:2]
    second = seat.sit(prepare=lambda page: page.set_viewport_size({"width": 1000, "height": 500}))
    try:
        second.locator("#probe-panel").evaluate("each => { each.open = true; }")
        second.wait_for_function(
            f"() => document.getElementById('picture').width === {width}"
            " && document.getElementById('picture').dataset.final === 'true'"
        )
        box = second.locator("#viewport").bounding_box()
        factor = box["height"] / height
        bar = (box["width"] - factor * width) / 2
        assert bar > 50
        second.mouse.move(
            box["x"] + bar + factor * (x + 0.5), box["y"] + factor * (y + 0.5), steps=2
        )
        second.locator("#probed").get_by_text(f"{x}, {y}", exact=True).wait_for()
        expected = answer(seat, lambda document: probe(document, x, y))
        assert expected.path in second.locator("#probed").inner_text()
        seat.page.get_by_label("A | B with a wipe").check()
        second.wait_for_function("() => !document.getElementById('wipe').hidden")
        left = second.locator("#wipe").evaluate("each => parseFloat(each.style.left)")
        assert left == pytest.approx(bar + seat.session._state.wipe * factor * width, abs=1.0)
    finally:
        second.close()
    seat.page.get_by_label("A | B with a wipe").uncheck()
    seat.rested(number, accept=lambda picture: picture.state.other is None)


def test_the_histogram_is_that_of_the_picture(seat: Seat) -> None:
    """Oracle: the number of its pixels, and that something is drawn in each channel's colour."""
    seat.rested()
    counts = answer(seat, histogram)
    seat.page.wait_for_function(
        f"() => document.getElementById('histogram').dataset.pixels === '{counts.pixels}'"
    )
    most = seat.page.evaluate(
        """() => {
          const canvas = document.getElementById("histogram");
          const context = canvas.getContext("2d");
          const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
          const isBright = (channel) => (value, at) => at % 4 === channel && value > 90;
          return [0, 1, 2].map((channel) => data.filter(isBright(channel)).length);
        }"""
    )
    assert min(most) > 20


def test_a_screenshot_is_that_of_the_window(seat: Seat, tmp_path: Path) -> None:
    """Oracle: `save_view` of the same state, pixel for pixel."""
    seat.rested()
    with seat.page.expect_download() as download:
        seat.page.get_by_role("button", name="Screenshot").click()
    assert download.value.suggested_filename == "screenshot.png"
    state = seat.session._state
    answer(seat, lambda document: save_view(document, state, tmp_path / "expected.png"))
    found, expected = opened(download.value.path()), opened(tmp_path / "expected.png")
    assert np.array_equal(np.asarray(found), np.asarray(expected))
    assert found.size == state.size and found.text == expected.text


def test_a_recording_has_every_frame(seat: Seat, tmp_path: Path, monkeypatch: Any) -> None:
    """Oracle: `save_view` at each time; without ffmpeg the pictures come in a zip."""
    monkeypatch.setattr("usdsplat.preview.web.recording.shutil.which", lambda name: None)
    seat.rested()
    with seat.page.expect_download() as download:
        seat.page.get_by_role("button", name="Record").click()
    archive = zipfile.ZipFile(download.value.path())
    assert archive.namelist() == ["frame.0001.png", "frame.0002.png", "frame.0003.png"]
    pictures = [np.asarray(opened(io.BytesIO(archive.read(each)))) for each in archive.namelist()]
    state = seat.session._state
    answer(seat, lambda document: save_view(document, state, tmp_path / "first.png"))
    assert np.array_equal(pictures[0], np.asarray(opened(tmp_path / "first.png")))
    assert not np.array_equal(pictures[0], pictures[2])
    seat.page.get_by_role("button", name="Record").wait_for()


def test_the_help_lists_every_key_and_gesture(seat: Seat) -> None:
    """Oracle: a row of each kind, with a mouse; while it is open, keys do nothing else."""
    page = seat.page
    page.locator("#picture").focus()
    page.keyboard.press("F1")
    dialog = page.get_by_role("dialog", name="Keys and gestures")
    dialog.wait_for()
    text = dialog.inner_text()
    for words in ("Shift-drag", "Double click", "Shift-F", "bookmark this view", "next AOV"):
        assert words in text
    state = seat.session._state
    page.keyboard.press("BracketRight")
    page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    assert seat.session._state == state
    page.get_by_role("button", name="Help").click()
    dialog.get_by_role("button", name="Close").click()
    dialog.wait_for(state="hidden")


def test_keys_step_through_aovs_and_compare(seat: Seat) -> None:
    """Oracle: the state."""
    page = seat.page
    number = seat.rested()
    page.locator("#picture").focus()
    page.keyboard.press("BracketRight")
    number = seat.rested(number, accept=lambda picture: picture.state.look.aov != "color")
    page.keyboard.press("BracketLeft")
    number = seat.rested(number, accept=lambda picture: picture.state.look.aov == "color")
    page.keyboard.press("Shift+KeyC")
    number = seat.rested(number, accept=lambda picture: picture.state.other is not None)
    page.keyboard.press("Shift+KeyC")
    seat.rested(number, accept=lambda picture: picture.state.other is None)


def test_what_a_person_sees(seat: Seat, tmp_path: Path) -> None:
    """Oracle: every control has a name that a screen reader can say, and the shot is a picture."""
    unnamed = seat.page.evaluate(
        """() => [...document.querySelectorAll("button, input, select")].filter(
          (each) => each.checkVisibility() && !each.labels?.length && !each.ariaLabel
            && !each.textContent.trim()).map((each) => each.outerHTML)"""
    )
    assert unnamed == []
    seat.page.get_by_label("A | B with a wipe").check()
    seat.page.locator("#wipe").wait_for()
    seat.rested()
    seat.page.evaluate("() => { document.getElementById('panels').scrollTop = 0; }")
    seat.shoot(tmp_path / "panels.png")
    seat.page.get_by_role("button", name="Help").click()
    seat.shoot(tmp_path / "help.png")
    seat.page.keyboard.press("Escape")
    seat.page.get_by_label("A | B with a wipe").uncheck()
    seat.page.locator("#wipe").wait_for(state="hidden")
    assert (tmp_path / "panels.png").stat().st_size > 10_000
