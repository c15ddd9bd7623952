"""Tests of messages to and from pages, through a socket without a browser."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.preview.stage_model.stages import rich
from tests.preview.web.wire import PATIENCE, Host, Page
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.parameters import editors
from usdsplat.preview.web.server import MOST_PAGES, serve
from usdsplat.preview.web.session_proxy import MOST
from usdsplat.sim.stage.authoring import author


def test_a_page_is_told_everything_and_shown_a_picture(host: Host) -> None:
    """Oracle: what the fake document says of itself."""
    with host.page() as page:
        header = page.final()
        while header["viewport"] != [64, 48]:
            header = page.final()
        told = dict(page.heard)
        assert told["opened"]["cameras"] == ["/A", "/B"] and told["state"]["end"] == 10.0
        assert {each["name"] for each in told["opened"]["aovs"]} >= {"color", "Z", "N"}
        assert {each["name"] for each in told["settings"]["display"]} >= {"exposure", "gamma"}
        names = {each["name"] for each in told["settings"]["render"]}
        assert "sh_degree" in names and not names & {"multipart", "node_wait"}
        assert (header["splats"], header["total"]) == (5, 7)


def test_the_next_frame_waits_for_an_acknowledgement(host: Host) -> None:
    """Oracle: a window of one; a page that does not answer gets news, but no second frame."""
    with host.page() as page:
        while page.next()[0] != "frame":
            pass
        for right in range(20):
            page.say("orbit", right=0.01 * right)
        page.say("end_move")
        page.say("use_camera", path="/none")
        while page.next()[0] != "problem":
            pass
        assert len(page.frames) == 1
        page.say("acknowledge", number=page.frames[0]["number"] + 1000)
        page.say("acknowledge", number=page.frames[0]["number"])
        while page.final()["number"] != len(host.document.states):
            pass


def test_what_a_page_does_is_seen(host: Host) -> None:
    """Oracle: the state that the document was asked to draw."""
    with host.page() as page:
        page.final()
        page.say("orbit", right=0.2)
        page.say("end_move")
        page.say("use_camera", path="/B")
        page.say("set_time", time=4)
        page.say("set_aov", name="N")
        page.say("set_setting", name="sh_degree", value=1)
        page.say("set_display", name="exposure", value=-2)
        page.say("resize", width=80, height=60)
        while page.final()["viewport"] != [80, 60]:
            pass
        state = host.document.states[-1]
        assert (state.camera, state.time, state.look.aov) == ("/B", 4.0, "N")
        assert (state.look.settings.sh_degree, state.display.exposure) == (1, -2.0)
        assert state.size == (80, 60) and not state.is_moving


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ("nonsense", "expected JSON"),
        ('{"type": "delete"}', "expected one of hello"),
        ('{"type": "orbit", "right": "far"}', "message orbit right: found 'far'"),
        (b"\x00\xff", "expected JSON as text"),
        ('{"type": "set_aov", "name": "beauty"}', "expected one of color"),
        ('{"type": "set_setting", "name": "sh_degree", "value": 9}', "0 to 4"),
        ('{"type": "set_setting", "name": "__class__", "value": 9}', "__class__"),
        ('{"type": "set_setting", "name": "ocio_config", "value": "/etc/passwd"}', "ocio:// name"),
        ('{"type": "set_display", "name": "gamma", "value": [[{}]]}', "gamma"),
        ('{"type": "set_range", "start": 5, "end": 1}', "range: found 5 to 1"),
        ('{"type": "simulate", "action": "run"}', "simulation: found none on the stage"),
        ('{"type": "set_aov", "name": "Z"}', "/World: found no depth"),
    ],
)
def test_a_wrong_message_is_one_sentence_and_the_page_goes_on(
    host: Host, data: str | bytes, sentence: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Oracle: *where: found X, expected Y*, no traceback, and the next message is answered."""
    with caplog.at_level(logging.WARNING), host.page() as page:
        page.hear("opened")
        page.wire.send(data)
        assert sentence in page.hear("problem")
        page.say("set_aov", name="N")
        page.say("set_time", time=3)
        while page.hear("state")["time"] != 3:
            pass
    assert not caplog.records


def test_nothing_is_done_before_hello(host: Host) -> None:
    """Oracle: the protocol's first message."""
    with host.page(hello=False) as page:
        page.say("set_aov", name="N")
        assert "hello first" in page.hear("problem")
        assert not page.frames


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


def test_one_page_has_the_view_and_another_may_take_it(host: Host) -> None:
    """Oracle: pages.py says who has it."""
    with host.page(name="first") as first, host.page(name="second") as second:
        first.final()
        second.hear("in_use")
        second.say("set_aov", name="N")
        second.hear("in_use")
        second.say("take_over", width=96, height=64)
        first.hear("in_use")
        while second.final()["viewport"] != [96, 64]:
            pass
        assert host.document.states[-1].look.aov == "color"
        with host.page(name="second") as again:
            again.final()
            second.hear("in_use")


def test_the_view_is_free_when_its_page_goes(host: Host) -> None:
    """Oracle: playing stops when nobody looks; who waits is told, and who comes next has it."""
    with host.page(name="other", hello=False) as other:
        with host.page(name="first") as page:
            page.final()
            page.say("play", is_playing=True)
            while not page.hear("state")["is_playing"]:
                pass
            other.say("hello", page="other", width=64, height=48)
            other.hear("in_use")
        other.hear("free")
        other.say("take_over", width=64, height=48)
        assert other.hear("state")["is_playing"] is False


def test_so_many_pages_and_no_more(host: Host) -> None:
    """Oracle: RFC 6455's registry, 1013: try again later."""
    with ExitStack() as stack:
        for number in range(MOST_PAGES):
            page = stack.enter_context(host.page(name=str(number)))
            page.hear("in_use" if number else "welcome")
        more = stack.enter_context(host.page(hello=False))
        with pytest.raises(ConnectionClosed) as caught:
            more.hear("in_use")
        assert caught.value.rcvd is not None and caught.value.rcvd.code == 1013


def test_what_was_opened_before_the_server_came_is_told() -> None:
    """Oracle: the fake document's name, however long it has been open."""
    host = Host()
    try:
        is_open = threading.Event()
        host.session.ask(lambda document: is_open.set())
        assert is_open.wait(PATIENCE)
        late = serve(host.session)
        try:
            with connect(
                late.url.replace("http", "ws") + "socket", origin=late.url.rsplit("/", 2)[0]
            ) as wire:
                page = Page(wire)
                page.say("hello", page="p", width=64, height=48)
                assert page.hear("opened")["name"] == "fake.usda"
        finally:
            late.close()
    finally:
        host.close()


def test_a_page_begins_with_the_camera_and_time_that_were_asked_for() -> None:
    """Oracle: what the first page's pictures were drawn by."""
    host = Host(camera="/B", time=4.0)
    try:
        with host.page() as page:
            page.final()
        state = host.document.states[-1]
        assert (state.camera, state.time) == ("/B", 4.0)
    finally:
        host.close()


def test_an_edit_of_an_animated_parameter_keeps_its_other_samples(host: Host) -> None:
    """Oracle: the samples on the stage, of the time that the page shows and the authored ones."""
    stage = rich()
    for time, value in ((1, 0.04), (9, 0.06)):
        author(stage.GetPrimAtPath("/World/Sim"), {"rd:feed": value}, time=time)
    with host.page() as page:
        page.final()
        host.document.stage, host.document.edits = stage, Edits(stage)
        page.say("set_time", time=5)
        page.say("set_parameter", path="/World/Sim", name="rd:feed", value=0.1)
        page.say("undo")  # which is told after the edit before it
        while "said" not in dict(page.heard):
            page.next()
        host.document.edits.redo()
        (found,) = [each for each in editors(stage, time=9.0) if each.path == "/World/Sim"]
        assert {each.name: each.value for each in found.editors}["rd:feed"] == pytest.approx(0.06)
        attribute = stage.GetAttributeAtPath("/World/Sim.splatSim:rd:feed")
        assert attribute.GetTimeSamples() == [1.0, 5.0, 9.0]
        host.document.edits.close()
