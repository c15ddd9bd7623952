"""Tests of what a page may ask for and hold at most, through a socket without a browser."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from tests.preview.web.wire import PATIENCE, Host
from usdsplat.preview.web.commands import MOST_BOOKMARKS
from usdsplat.preview.web.link import MOST_UNDER_WAY
from usdsplat.preview.web.pages import MOST_WAITING
from usdsplat.preview.web.questions import MOST_ROWS
from usdsplat.preview.web.server import MOST_PAGES
from usdsplat.preview.web.session_proxy import MOST


def test_a_page_that_acknowledges_nothing_gets_few_frames(host: Host) -> None:
    """Oracle: link.py's limit; it still gets news, and the last frame once it answers."""
    with host.page() as page:
        while page.next()[0] != "frame":
            pass
        for right in range(3 * MOST_UNDER_WAY):
            page.say("orbit", right=0.01 * right)
        page.say("end_move")
        page.say("use_camera", path="/none")
        while page.next()[0] != "problem":
            pass
        assert len(page.frames) <= MOST_UNDER_WAY
        page.say("acknowledge", message=page.frames[0]["message"] + 1000)
        for each in tuple(page.frames):
            page.say("acknowledge", message=each["message"])
        while page.final()["number"] != len(host.document.states):
            pass


def test_a_message_that_is_too_long_ends_the_connection(host: Host) -> None:
    """Oracle: RFC 6455, close code 1009; the next page is served."""
    with host.page() as page:
        page.say("set_aov", name="x" * 100_000)
        with pytest.raises(ConnectionClosed) as caught:
            page.hear("never")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1009
    with host.page() as page:
        page.final()


def test_a_flood_of_moves_becomes_few_pictures(host: Host) -> None:
    """Oracle: the latest wins: nothing is lost of the last one, and few of the others are drawn."""
    with host.page() as page:
        page.final()
        before = len(host.document.states)
        for number in range(5000):
            page.say("set_time", time=1 + number % 9, is_scrubbing=True)
        page.say("set_time", time=7.5)
        while page.final()["time"] != 7.5:
            pass
        assert len(page.frames) < 2500 and len(host.document.states) - before < 5000


def test_a_flood_of_questions_is_bounded(host: Host) -> None:
    """Oracle: as many as may wait; the others are refused in a sentence, and it goes on after."""
    with host.page() as page:
        page.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        for _ in range(3 * MOST):
            page.say("frame")
        assert "fewer at a time" in page.hear("problem")
        assert len(host.session._tasks) <= MOST
        host.document.may_go_on.set()
        page.say("set_time", time=9)
        while page.final()["time"] != 9:
            pass


def test_questions_of_a_page_that_watches_stop_no_action_of_the_driver(host: Host) -> None:
    """Oracle: each page's own count; the driver's pick is answered, and so is every question of
    the other, of which too many get an empty answer."""
    with host.page(name="first") as first, host.page(name="second") as second:
        first.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        for number in range(2 * MOST):
            second.say("list_prims", path=f"/P{number}")
        assert "fewer at a time" in second.hear("problem")
        second.say("probe", x=1, y=1)
        assert second.hear("probed") is None
        first.say("pick", x=1, y=1)
        first.say("add_bookmark", name="here")
        while first.hear("state")["bookmarks"] != ["here"]:
            pass
        host.document.may_go_on.set()
        assert first.hear("picked") is None
        assert "problem" not in {kind for kind, _ in first.heard}
        second.say("list_prims", path="/")
        while second.hear("prims")["path"] != "/":
            pass


def test_of_questions_about_one_thing_the_last_is_answered(host: Host) -> None:
    """Oracle: the first is under way, the last one waits, and no other is asked at all."""
    with host.page() as page:
        page.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        for x in range(500):
            page.say("pick", x=x / 10, y=1)
        page.say("set_range", start=2, end=1)
        page.hear("problem")
        assert len(host.session._tasks) <= 2
        host.document.may_go_on.set()
        page.hear("picked")
        page.hear("picked")


def test_many_children_come_in_pages(host: Host) -> None:
    """Oracle: the names, in stage order; the page asks from where the last answer ended."""
    with host.page() as page:
        page.final()
        names = [f"P{number}" for number in range(2 * MOST_ROWS + 5)]
        host.session.ask(
            lambda document: [document.stage.DefinePrim(f"/{name}", "Scope") for name in names]
        )
        found: list[str] = []
        has_more = True
        while has_more:
            page.say("list_prims", path="/", first=len(found))
            told = page.hear("prims")
            assert told["first"] == len(found) and len(told["rows"]) <= MOST_ROWS
            found += [each["name"] for each in told["rows"]]
            has_more = told["has_more"]
        assert found == names
        assert told["rows"][0]["type"] == "Scope" and not told["rows"][0]["has_children"]


def test_a_bookmark_is_replaced_however_many_there_are(host: Host) -> None:
    """Oracle: the limit is for further ones."""
    with host.page() as page:
        page.final()
        for number in range(MOST_BOOKMARKS):
            page.say("add_bookmark", name=f"{number}")
        page.say("add_bookmark", name=" 7 ")
        page.say("add_bookmark", name="more")
        assert f"at most {MOST_BOOKMARKS}" in page.hear("problem")
        page.say("set_time", time=9)
        while (told := page.hear("state"))["time"] != 9:
            pass
        assert told["bookmarks"][-1] == "7" and len(told["bookmarks"]) == MOST_BOOKMARKS
        assert [kind for kind, _ in page.heard].count("problem") == 1


def test_nothing_is_recorded_while_much_waits_for_pages(host: Host, monkeypatch: Any) -> None:
    """Oracle: the bytes of all pages together, whoever asked."""
    monkeypatch.setattr("usdsplat.preview.web.pages.Pages.waiting", MOST_WAITING + 1)
    with host.page() as page:
        page.final()
        page.say("record")
        assert f"files of {MOST_WAITING + 1} bytes" in page.hear("problem")


def test_so_many_pages_and_no_more(host: Host) -> None:
    """Oracle: RFC 6455's registry, 1013: try again later."""
    with ExitStack() as stack:
        for number in range(MOST_PAGES):
            page = stack.enter_context(host.page(name=str(number)))
            assert page.hear("seats")["you"] == number + 1
        more = stack.enter_context(host.page(hello=False))
        with pytest.raises(ConnectionClosed) as caught:
            more.hear("seats")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1013
