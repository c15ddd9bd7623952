"""Tests of the page on a phone: touch by the browser's own events, and a small screen."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.delegate.stages import two_fields
from tests.preview.web.seats import Seat, animated
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document

PHONE = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "is_mobile": True,
    "has_touch": True,
}
MIDDLE = (195.0, 400.0)
Finger = tuple[float, float]


@pytest.fixture(scope="module")
def seat(browser: Any) -> Iterator[Seat]:
    """Before two clouds, one of which moves."""
    stage = animated(two_fields(), "/World/B")
    seat = Seat(browser, lambda publish: Document(stage, publish=publish), **PHONE)
    seat.rested()
    yield seat
    seat.close()


@pytest.fixture(autouse=True)
def no_complaints(seat: Seat) -> Iterator[None]:
    """Oracle: the console of a page that is well says nothing."""
    yield
    assert seat.errors == []


def touch(
    seat: Seat, *paths: tuple[Finger, Finger], steps: int = 8, at: float | None = None
) -> None:
    """Move fingers, each from a place to another, and lift them together.

    Args:
        at: When the events say that they happened [s since 1970]; None for now.
    """
    when = {} if at is None else {"timestamp": at}
    wire = seat.context.new_cdp_session(seat.page)

    def say(kind: str, part: float | None) -> None:
        points = [
            {"id": index, "x": a[0] + part * (b[0] - a[0]), "y": a[1] + part * (b[1] - a[1])}
            for index, (a, b) in enumerate(paths)
            if part is not None
        ]
        wire.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points, **when})

    say("touchStart", 0.0)
    for step in range(1, steps + 1 if paths[0][0] != paths[0][1] else 1):
        say("touchMove", step / steps)
    say("touchEnd", None)
    wire.detach()


def show_panels(seat: Seat, is_shown: bool) -> None:
    """Open or close the panels, and wait for the picture of the new size."""
    panels = seat.page.locator("#panels")
    if panels.is_visible() != is_shown:
        seat.page.get_by_role("button", name="Panels").tap()
    panels.wait_for(state="visible" if is_shown else "hidden")
    ratio = PHONE["device_scale_factor"]
    height = ratio * seat.page.evaluate("() => document.getElementById('viewport').clientHeight")
    seat.rested(accept=lambda picture: abs(picture.state.size[1] - height) < 2)


def own_camera(seat: Seat) -> FreeCamera:
    """Turn the camera a little; return it, which is now the user's."""
    before = seat.session._state.camera
    touch(seat, (MIDDLE, (MIDDLE[0] + 3, MIDDLE[1] + 30)))
    return moved(seat, before)


def moved(seat: Seat, before: Any) -> FreeCamera:
    """The camera of the final picture after a move from another one."""
    number = seat.rested(accept=lambda picture: picture.state.camera != before)
    camera = seat.picture(number).state.camera
    assert isinstance(camera, FreeCamera)
    return camera


def test_the_picture_comes_first_on_a_small_screen(seat: Seat) -> None:
    """Oracle: the panels are closed and come with their button; the picture has four fifths of
    the height."""
    page = seat.page
    assert not page.locator("#panels").is_visible()
    height = page.locator("#picture").bounding_box()["height"]
    assert height > 0.8 * PHONE["viewport"]["height"]
    show_panels(seat, True)
    page.get_by_label("AOV").wait_for()
    assert page.locator("#picture").bounding_box()["height"] > 0.3 * height
    show_panels(seat, False)


def test_nothing_is_wider_than_the_screen(seat: Seat) -> None:
    """Oracle: the boxes of what is visible, with the panels and without."""
    for is_shown in (False, True):
        show_panels(seat, is_shown)
        wide = seat.page.evaluate(
            """() => [...document.querySelectorAll("header *, footer *, aside *")]
              .filter((each) => each.checkVisibility() && each.tagName !== "OPTION")
              .filter((each) => each.getBoundingClientRect().right > innerWidth + 0.5)
              .map((each) => each.outerHTML.slice(0, 80))"""
        )
        assert wide == []
    show_panels(seat, False)


def test_targets_are_large_enough_for_a_finger(seat: Seat) -> None:
    """Oracle: 40 pixels of height and width, of a control or of the label around it."""
    show_panels(seat, True)
    seat.page.evaluate(
        "() => document.querySelectorAll('details').forEach((each) => { each.open = true; })"
    )
    small = seat.page.evaluate(
        """() => [...document.querySelectorAll("button, select, input, summary")]
          .filter((each) => each.checkVisibility())
          .map((each) => [each, (each.closest("label") ?? each).getBoundingClientRect()])
          .filter(([each, box]) => box.width < 40 || box.height < 39.5)
          .map(([each, box]) => `${each.outerHTML.slice(0, 90)} ${box.width} ${box.height}`)"""
    )
    show_panels(seat, False)
    assert small == []


def test_one_finger_orbits(seat: Seat) -> None:
    """Oracle: the distance and the target stay."""
    before = own_camera(seat)
    touch(seat, (MIDDLE, (MIDDLE[0] + 90, MIDDLE[1] + 20)))
    after = moved(seat, before)
    np.testing.assert_allclose(after.target, before.target, atol=1e-9)
    assert after.distance == pytest.approx(before.distance)


def test_two_fingers_pan(seat: Seat) -> None:
    """Oracle: eye and target move alike."""
    before = own_camera(seat)
    left, right = (120.0, 400.0), (270.0, 400.0)
    touch(seat, (left, (160.0, 450.0)), (right, (310.0, 450.0)))
    after = moved(seat, before)
    eye, target = np.subtract(after.eye, before.eye), np.subtract(after.target, before.target)
    assert np.linalg.norm(eye) > 0.01 * before.distance
    np.testing.assert_allclose(eye, target, atol=0.02 * before.distance)


def test_a_pinch_goes_nearer_by_the_ratio_of_the_distances(seat: Seat) -> None:
    """Oracle: twice as far apart is half the distance, which keeps what is under the fingers."""
    before = own_camera(seat)
    touch(seat, ((155.0, 400.0), (115.0, 400.0)), ((235.0, 400.0), (275.0, 400.0)), steps=10)
    after = moved(seat, before)
    assert after.distance == pytest.approx(before.distance / 2, rel=0.05)


def test_a_tap_picks_and_a_double_tap_frames(seat: Seat) -> None:
    """Oracle: the state's selection; the camera that the document's subject is framed with."""
    show_panels(seat, True)
    seat.page.locator("#camera").select_option(label="frame everything")
    show_panels(seat, False)
    number = seat.rested(accept=lambda picture: picture.state.camera is None)
    rows, columns = np.nonzero(np.ptp(seat.canvas()[1].astype(int), axis=2) > 60)
    box = seat.page.locator("#picture").bounding_box()
    place = box["x"] + columns[len(columns) // 2] / 2, box["y"] + rows[len(rows) // 2] / 2
    now = time.time()
    touch(seat, (place, place), at=now - 3.0)
    seat.page.wait_for_function("() => document.querySelector('#picked dl') !== null")
    (path,) = seat.session._state.selected
    number = seat.rested(number - 1)
    camera = seat.session._state.camera
    touch(seat, (place, place), at=now - 2.0)
    touch(seat, (place, place), at=now - 1.6)  # too late
    seat.ask(lambda document: None)
    assert seat.session._state.camera == camera
    touch(seat, (place, place), at=now - 1.4)
    subjects: list[Any] = []
    seat.ask(lambda document: subjects.append(document.subject((path,))))
    number = seat.rested(
        number,
        accept=lambda picture: not picture.state.is_moving and picture.state.camera is not None,
    )
    state = seat.picture(number).state
    expected = state.camera.framing(subjects[0], aspect=state.size[0] / state.size[1])
    np.testing.assert_allclose(state.camera.target, expected.target, atol=1e-6)


def test_buttons_stay_in_place_when_panels_are_shown(seat: Seat) -> None:
    """Oracle: the boxes of the buttons that are always there, with the panels and without; the
    timeline has two rows at most."""

    def boxes() -> list[dict[str, float]]:
        ids = ("frame", "help-shown", "panels-shown")
        return [seat.page.locator(f"#{each}").bounding_box() for each in ids]

    before = boxes()
    show_panels(seat, True)
    assert boxes() == before
    rows = seat.page.evaluate(
        """() => new Set([...document.querySelectorAll("footer > *")]
          .filter((each) => each.checkVisibility())
          .map((each) => {
            const box = each.getBoundingClientRect();
            return Math.round((box.top + box.bottom) / 2 / 20);
          })).size"""
    )
    show_panels(seat, False)
    assert rows <= 2


def test_a_tap_says_what_it_hit_and_opens_its_row(seat: Seat) -> None:
    """Oracle: the session's selection: its path in a message while the panels are closed, and its
    row in the tree, marked, once they are open."""
    page = seat.page
    seat.session.look(seat.session._state)
    rows, columns = np.nonzero(np.ptp(seat.canvas()[1].astype(int), axis=2) > 60)
    box = page.locator("#picture").bounding_box()
    place = box["x"] + columns[len(columns) // 2] / 2, box["y"] + rows[len(rows) // 2] / 2
    touch(seat, (place, place), at=time.time() - 20.0)
    page.wait_for_function("() => document.getElementById('busy').textContent.startsWith('/')")
    (path,) = seat.session._state.selected
    assert page.locator("#busy").inner_text() == path
    show_panels(seat, True)
    row = page.locator(f"#prims .prim-name[title='{path}']")
    row.wait_for(state="visible")
    assert row.get_attribute("aria-pressed") == "true"
    show_panels(seat, False)


def test_the_help_of_a_phone_has_no_keys(seat: Seat) -> None:
    """Oracle: by hand: what fingers do, and nothing that needs a keyboard or a mouse."""
    seat.page.locator("#help-shown").tap()
    told = seat.page.locator("#help table").inner_text()
    seat.page.locator("#help button").tap()
    assert "Pinch" in told and "Double tap" in told
    assert not any(word in told for word in ("Shift", "Ctrl", "W A S D", "Wheel", "Right drag"))


def test_a_phone_on_its_side_keeps_the_picture_large(seat: Seat) -> None:
    """Oracle: the picture's part of the height of a screen of 844 x 390, by hand: one row of
    buttons and the timeline."""
    try:
        seat.page.set_viewport_size({"width": 844, "height": 390})
        seat.page.wait_for_function("() => document.getElementById('viewport').clientHeight < 390")
        assert not seat.page.locator("#record").is_visible()
        assert seat.page.locator("#picture").bounding_box()["height"] > 0.7 * 390
    finally:
        seat.page.set_viewport_size(PHONE["viewport"])


def test_what_a_person_sees(seat: Seat, tmp_path: Path) -> None:
    """Oracle: the shots are pictures."""
    seat.shoot(tmp_path / "phone.png")
    show_panels(seat, True)
    seat.shoot(tmp_path / "panels.png")
    show_panels(seat, False)
    assert (tmp_path / "phone.png").stat().st_size > 10_000
