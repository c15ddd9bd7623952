"""Tests of the web view in a headless browser, driven as by a user."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.delegate.stages import add_camera, two_fields
from tests.preview.web.seats import Seat, animated
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.picking import pick
from usdsplat.preview.values import Picture
from usdsplat.preview.web import server

MIDDLE = (340, 300)
"""Of the viewport, in the browser's window [CSS pixel]."""


@pytest.fixture(scope="module")
def seat(browser: Any) -> Iterator[Seat]:
    """Before two clouds, one of which moves, and a camera."""
    stage = animated(two_fields(), "/World/B")
    add_camera(stage)
    seat = Seat(browser, lambda publish: Document(stage, publish=publish))
    yield seat
    seat.close()


@pytest.fixture(autouse=True)
def no_complaints(seat: Seat) -> Iterator[None]:
    """Oracle: the console of a page that is well says nothing."""
    yield
    assert seat.errors == []


def drag(seat: Seat, by: tuple[int, int], *, button: str = "left", key: str = "") -> int:
    """Drag from the middle of the viewport; returns the number of the picture that is final."""
    before = seat.session._state.camera
    mouse = seat.page.mouse
    if key:
        seat.page.keyboard.down(key)
    mouse.move(*MIDDLE)
    mouse.down(button=button)
    mouse.move(MIDDLE[0] + by[0], MIDDLE[1] + by[1], steps=6)
    mouse.up(button=button)
    if key:
        seat.page.keyboard.up(key)
    return seat.rested(accept=lambda picture: picture.state.camera != before)


def own_camera(seat: Seat) -> FreeCamera:
    """Turn the camera a little from the view of everything; return it, which is now the user's."""
    look_at_everything(seat)
    return seat.picture(drag(seat, (1, 5))).state.camera


def look_at_everything(seat: Seat) -> int:
    """Have nobody's camera; returns the number of the picture that is final."""
    seat.page.locator("#camera").select_option(label="frame everything")
    return seat.rested(accept=lambda picture: picture.state.camera is None)


def test_the_page_shows_the_session_s_picture(seat: Seat) -> None:
    """Oracle: the array that the session published, bit for bit, at the viewport's size."""
    seat.rested(accept=lambda picture: picture.state.size != (960, 720))
    number, pixels = seat.canvas()
    assert np.array_equal(pixels, seat.picture(number).image)
    assert seat.picture(number).state.size == tuple(
        seat.page.evaluate(
            "(({clientWidth, clientHeight}) => [clientWidth, clientHeight])"
            "(document.getElementById('viewport'))"
        )
    )
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
    seat.page.get_by_text("24 of 24 splats").wait_for(state="attached")


@pytest.mark.parametrize(
    ("button", "key"), [("left", ""), ("left", "Shift"), ("left", "Alt"), ("middle", "")]
)
def test_drags_move_the_camera(seat: Seat, button: str, key: str) -> None:
    """Oracle: an orbit keeps the distance and the target; a pan moves both alike."""
    before = own_camera(seat)
    number = drag(seat, (120, 30), button=button, key=key)
    after = seat.picture(number).state.camera
    assert after != before
    eye, target = np.subtract(after.eye, before.eye), np.subtract(after.target, before.target)
    if button == "middle" or key == "Shift":
        np.testing.assert_allclose(eye, target, atol=1e-9)
    else:
        np.testing.assert_allclose(target, 0, atol=1e-9)
        assert after.distance == pytest.approx(before.distance)
    number, pixels = seat.canvas()
    assert np.array_equal(pixels, seat.picture(number).image)


def test_the_right_button_looks_around(seat: Seat) -> None:
    """Oracle: the eye stays where it is."""
    before = own_camera(seat)
    after = seat.picture(drag(seat, (60, 10), button="right")).state.camera
    np.testing.assert_allclose(after.eye, before.eye, atol=1e-9)
    assert after.target != before.target


def test_the_wheel_goes_nearer_and_away(seat: Seat) -> None:
    """Oracle: the distance is multiplied, and by as much as it was divided."""
    first = own_camera(seat)
    seat.page.mouse.move(*MIDDLE)
    seat.page.mouse.wheel(0, -200)
    number = seat.rested(accept=lambda picture: picture.state.camera != first)
    near = seat.picture(number).state.camera
    assert near.distance < 0.9 * first.distance
    seat.page.mouse.wheel(0, 200)
    number = seat.rested(accept=lambda picture: picture.state.camera != near)
    far = seat.picture(number).state.camera
    assert far.distance == pytest.approx(first.distance)


def test_held_keys_fly(seat: Seat) -> None:
    """Oracle: forward is towards the target, and letting go stops."""
    first = own_camera(seat)
    before, _ = seat.canvas()
    seat.page.locator("#picture").focus()
    seat.page.keyboard.down("KeyW")
    seat.page.wait_for_function(
        f"() => Number(document.getElementById('picture').dataset.number) > {before + 2}"
    )
    seat.page.keyboard.up("KeyW")
    number = seat.rested(before)
    after = seat.picture(number).state.camera
    moved = np.subtract(after.eye, first.eye)
    ahead = np.subtract(first.target, first.eye)
    assert np.linalg.norm(moved) > 0
    np.testing.assert_allclose(np.cross(moved, ahead), 0, atol=1e-6)
    assert after.distance == pytest.approx(first.distance)


def test_f_frames_everything_again(seat: Seat) -> None:
    """Oracle: the camera from the same direction, by the subject of the document."""
    number, _ = seat.canvas()
    seat.page.locator("#picture").focus()
    seat.page.keyboard.press("Shift+KeyF")
    subjects: list[Any] = []
    seat.session.ask(lambda document: document.subject(), subjects.append)
    number = seat.rested(number, accept=lambda picture: not picture.state.is_moving)
    state = seat.picture(number).state
    expected = state.camera.framing(subjects[0], aspect=state.size[0] / state.size[1])
    np.testing.assert_allclose(state.camera.target, expected.target, atol=1e-6)
    np.testing.assert_allclose(state.camera.eye, expected.eye, atol=1e-6)


def test_a_camera_of_the_stage_is_looked_through(seat: Seat) -> None:
    """Oracle: the state has its path."""
    seat.page.locator("#camera").select_option("/Camera")
    number = seat.rested(accept=lambda picture: picture.state.camera == "/Camera")
    assert np.array_equal(seat.canvas()[1], seat.picture(number).image)


def test_the_timeline_scrubs_steps_and_plays(seat: Seat) -> None:
    """Oracle: the time of the picture on the page, and pictures that differ as the cloud moves."""
    look_at_everything(seat)
    number, first = seat.canvas()
    slider = seat.page.get_by_role("slider", name="Time", exact=True)
    slider.focus()
    slider.fill("7")
    number = seat.rested(number, accept=lambda picture: picture.state.time == 7.0)
    assert not np.array_equal(seat.canvas()[1], first)
    seat.page.get_by_role("button", name="One frame on").click()
    number = seat.rested(number, accept=lambda picture: picture.state.time == 8.0)
    seat.page.get_by_label("from").fill("3")
    seat.page.get_by_label("from").press("Enter")
    seat.page.get_by_role("button", name="First frame").click()
    number = seat.rested(number, accept=lambda picture: picture.state.time == 3.0)
    seat.page.get_by_role("button", name="Play").click()
    seat.page.wait_for_function("() => Number(document.getElementById('current').value) > 5")
    seat.page.get_by_role("button", name="Stop").click()
    seat.page.get_by_role("button", name="Play").wait_for()


def test_an_aov_is_chosen(seat: Seat) -> None:
    """Oracle: the picture's state, and another picture."""
    number, color = seat.canvas()
    seat.page.get_by_label("AOV").select_option("N")
    number = seat.rested(number, accept=lambda picture: picture.state.look.aov == "N")
    assert not np.array_equal(seat.canvas()[1], color)
    seat.page.get_by_label("AOV").select_option("color")
    seat.rested(number, accept=lambda picture: picture.state.look.aov == "color")


def test_a_click_picks_and_a_double_click_turns_about_it(seat: Seat) -> None:
    """Oracle: what `pick` says of a pixel that stands out from the background."""
    look_at_everything(seat)
    number, pixels = seat.canvas()
    height, width = pixels.shape[:2]
    rows, columns = np.nonzero(np.abs(pixels.astype(int) - pixels[0, 0]).sum(axis=2) > 250)
    middle = len(rows) // 2
    box = seat.page.locator("#viewport").bounding_box()
    x = box["x"] + (columns[middle] + 0.5) * box["width"] / width
    y = box["y"] + (rows[middle] + 0.5) * box["height"] / height
    found: list[Any] = []
    seat.session.ask(
        lambda document: pick(document, columns[middle] + 0.5, rows[middle] + 0.5), found.append
    )
    seat.page.mouse.click(x, y)
    seat.page.locator("#picked dt", has_text="opacity").wait_for()
    picked = found[0]
    told = seat.page.locator("#picked").inner_text()
    assert picked.path in told and f"{picked.splat.opacity:.6g}" in told
    assert seat.session._state.selected == (picked.path,)
    seat.page.mouse.dblclick(x, y)
    number = seat.rested(number, accept=lambda picture: _is_aimed(picture, picked.position))
    seat.page.mouse.click(box["x"] + 3, box["y"] + 3)
    seat.page.get_by_text("Nothing is there.").wait_for()


def _is_aimed(picture: Picture, position: tuple[float, ...]) -> bool:
    camera = picture.state.camera
    return isinstance(camera, FreeCamera) and np.allclose(camera.target, position, atol=1e-5)


def test_knobs_are_turned_and_turned_back(seat: Seat) -> None:
    """Oracle: exposure brightens what there is; its default makes the first picture again."""
    number, before = seat.canvas()
    knob = seat.page.get_by_role("spinbutton", name="Exposure")
    knob.fill("1.5")
    knob.press("Enter")
    number = seat.rested(number, accept=lambda picture: picture.state.display.exposure == 1.5)
    brighter = seat.canvas()[1]
    assert brighter.mean() > before.mean()
    seat.page.get_by_role("button", name="Exposure: back to the default").click()
    number = seat.rested(number, accept=lambda picture: picture.state.display.exposure == 0.0)
    assert np.array_equal(seat.canvas()[1], before)


def test_a_wrong_value_is_told_and_the_picture_stays(seat: Seat) -> None:
    """Oracle: the browser's own check of the knob's range."""
    seat.page.get_by_text("Render settings", exact=True).click()
    knob = seat.page.get_by_role("spinbutton", name="SH degree")
    knob.fill("9")
    knob.press("Enter")
    assert knob.evaluate("field => !field.checkValidity()")
    knob.fill("0")
    knob.press("Enter")
    number, _ = seat.canvas()
    seat.rested(number - 1, accept=lambda picture: picture.state.look.settings.sh_degree == 0)


def test_another_page_watches_takes_control_and_gives_it_back(seat: Seat) -> None:
    """Oracle: who drives has no button to take control; who watches sees the same picture, and its
    controls do nothing; closing the driver's page passes control on."""
    first = seat.page
    second = seat.sit()
    second.get_by_text("You watch as viewer 2; viewer 1 drives.").wait_for()
    first.get_by_text("another viewer watches").wait_for()
    assert second.locator("#timeline").evaluate("each => each.inert")
    before = look_at_everything(seat)
    number = drag(seat, (60, 20))
    assert number > before
    second.wait_for_function(
        f"() => document.getElementById('picture').dataset.number === '{number}'"
    )
    state = seat.session._state
    second.mouse.move(*MIDDLE)
    second.mouse.wheel(0, 200)
    second.locator("#seats.nudged").wait_for()
    assert seat.session._state == state
    second.get_by_role("button", name="Take control").click()
    second.get_by_text("You drive as viewer 2").wait_for()
    first.get_by_role("button", name="Take control").wait_for()
    assert not second.locator("#timeline").evaluate("each => each.inert")
    second.close()
    first.locator("#seats").wait_for(state="hidden")
    assert not first.locator("#timeline").evaluate("each => each.inert")


def test_a_page_too_many_says_so_until_another_one_is_closed(
    seat: Seat, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the sentence; then the page that is let in watches."""
    monkeypatch.setattr(server, "MOST_PAGES", 2)
    second = seat.sit()
    second.get_by_text("You watch as viewer").wait_for()
    third = seat.sit()
    third.get_by_text("As many pages as can watch are open.").wait_for()
    second.close()
    third.get_by_text("You watch as viewer").wait_for()
    assert third.locator("#connection").is_hidden()
    third.close()
    seat.page.locator("#seats").wait_for(state="hidden")


_WATCHED = """() => {
  window.sockets = [];
  window.held = null;
  window.WebSocket = class extends WebSocket {
    constructor(...given) {
      super(...given);
      sockets.push(this);
      Object.assign(this, { received: [], acknowledged: [] });
      this.addEventListener("message", ({ data }) => {
        if (typeof data === "string") return;
        const text = new Uint8Array(data, 4, new DataView(data).getUint32(0));
        this.received.push(JSON.parse(new TextDecoder().decode(text)).message);
      });
    }
    send(data) {
      const { type, message } = JSON.parse(data);
      if (type === "acknowledge") this.acknowledged.push(message);
      super.send(data);
    }
  };
  const decode = createImageBitmap;
  window.createImageBitmap = async (...given) => {
    if (window.held) await new Promise((resolve) => held.push(resolve));
    return decode(...given);
  };
}"""


def test_a_picture_is_acknowledged_on_the_connection_that_it_came_by(seat: Seat) -> None:
    """Oracle: each connection numbers its messages; a picture is decoded after its connection was
    lost and another one opened."""
    second = seat.sit(prepare=lambda page: page.add_init_script(f"({_WATCHED})()"))
    second.wait_for_function("() => document.getElementById('picture').dataset.final === 'true'")
    second.evaluate("() => { window.held = []; }")
    drag(seat, (20, 10))
    second.wait_for_function("() => held.length === 1")
    second.evaluate("() => sockets[0].close()")
    second.wait_for_function("() => sockets[1]?.received.length > 0")
    number, _ = seat.canvas()
    second.evaluate("() => { held.forEach((go) => go()); window.held = null; }")
    second.wait_for_function(
        "number => { const { dataset } = document.getElementById('picture');"
        " return dataset.number === String(number) && dataset.final === 'true'"
        " && sockets[1].acknowledged.length >= sockets[1].received.length; }",
        arg=number,
    )
    received, acknowledged = second.evaluate("() => [sockets[1].received, sockets[1].acknowledged]")
    second.close()
    assert sorted(acknowledged) == received  # parts before the last one are not decoded
    seat.page.locator("#seats").wait_for(state="hidden")


def test_the_page_comes_again_by_itself(seat: Seat) -> None:
    """Oracle: it says that the connection is lost, and then shows pictures of a new server."""
    number, _ = seat.canvas()
    seat.restart()
    seat.page.wait_for_function("() => document.body.dataset.connected === 'true'")
    seat.page.get_by_text("Connection lost").wait_for(state="hidden")
    seat.page.get_by_label("AOV").select_option("albedo")
    seat.rested(number, accept=lambda picture: picture.state.look.aov == "albedo")
    seat.errors[:] = [each for each in seat.errors if "WebSocket" not in each]


def test_the_layout_follows_the_window(seat: Seat) -> None:
    """Oracle: the picture has the viewport's size, without the panels and with them."""
    number, _ = seat.canvas()
    seat.page.get_by_role("button", name="Panels").click()
    wide = seat.rested(number, accept=lambda picture: picture.state.size[0] == 1000)
    seat.page.get_by_role("button", name="Panels").click()
    seat.rested(wide, accept=lambda picture: picture.state.size[0] < 1000)


def test_what_a_person_sees(seat: Seat, tmp_path: Path) -> None:
    """Oracle: every control has a name that a screen reader can say, and the shot is a picture."""
    unnamed = seat.page.evaluate(
        """() => [...document.querySelectorAll("button, input, select")].filter(
          (each) => each.checkVisibility() && !each.labels?.length && !each.ariaLabel
            && !each.textContent.trim()).map((each) => each.outerHTML)"""
    )
    assert unnamed == []
    seat.shoot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 10_000
