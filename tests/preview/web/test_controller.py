"""Tests of messages to and from pages, through a socket without a browser."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack

import pytest
from websockets.sync.client import connect

from tests.preview.stage_model.stages import rich
from tests.preview.web.wire import PATIENCE, Host, Page
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.parameters import editors
from usdsplat.preview.values import StageChanged
from usdsplat.preview.web.server import serve
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
        ('{"type": "set_other", "aov": "beauty"}', "expected one of color"),
        ('{"type": "set_wipe", "part": 1.5}', "0 to 1"),
        ('{"type": "list_prims", "path": "../x"}', "../x"),
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


def test_only_changes_that_a_list_of_prims_shows_are_told(host: Host) -> None:
    """Oracle: what `StageChanged` says; a slider changes values many times a second."""
    with host.page() as page:
        page.final()
        for structure, visibility, time in ((False, False, 2), (True, False, 3), (False, True, 4)):
            change = StageChanged(structure=structure, visibility=visibility)
            host.session.ask(lambda document, change=change: document.publish(change))
            page.say("set_time", time=time)
            page.heard.clear()
            while page.final()["time"] != time:
                pass
            told = [kind for kind, _ in page.heard if kind == "stage_changed"]
            assert len(told) == (structure or visibility)


def test_one_page_drives_and_another_watches_until_it_takes_control(host: Host) -> None:
    """Oracle: pages.py says who drives; both get every final picture, of the driver's size."""
    with host.page(name="first") as first, host.page(name="second", size=(96, 64)) as second:
        assert first.hear("seats") == {"you": 1, "driver": 1, "pages": 1}
        assert second.hear("seats") == {"you": 2, "driver": 1, "pages": 2}
        first.say("set_time", time=4)
        for page in (first, second):
            while (header := page.final())["time"] != 4:
                pass
            assert header["viewport"] == [64, 48]
        second.say("set_aov", name="N")
        second.hear("watching")
        second.say("take_over", width=96, height=64)
        assert second.hear("seats") == {"you": 2, "driver": 2, "pages": 2}
        for page in (first, second):
            while page.final()["viewport"] != [96, 64]:
                pass
        assert host.document.states[-1].look.aov == "color"
        first.say("set_aov", name="N")
        first.hear("watching")


def test_a_page_that_watches_may_look_and_change_nothing(host: Host) -> None:
    """Oracle: answers to questions come to the one that asked; all else is refused."""
    with host.page(name="first") as first, host.page(name="second") as second:
        first.final()
        second.say("list_prims", path="/")
        assert second.hear("prims") == {"path": "/", "first": 0, "rows": [], "has_more": False}
        second.say("search_prims", text="x")
        assert second.hear("found") == {"text": "x", "paths": []}
        second.say("probe", x=1, y=1)
        assert second.hear("probed") is None
        second.say("list_prims", path="/nowhere")
        assert "/nowhere" in second.hear("problem")
        for kind, members in (
            ("set_visible", {"path": "/A", "is_visible": False}),
            ("record", {}),
            ("add_bookmark", {}),
            ("set_other", {"aov": "N"}),
            ("select", {"path": "/A"}),
        ):
            second.say(kind, **members)
            second.hear("watching")
        first.say("set_time", time=2)
        while first.final()["time"] != 2:
            pass
        state = host.document.states[-1]
        assert state.other is None and state.selected == ()
        assert first.last("state")["bookmarks"] == []


def test_one_recording_runs_at_a_time_and_ends_with_its_page(host: Host) -> None:
    """Oracle: the fake document's ten frames; another page is told whose recording runs."""
    with host.page(name="first") as first, host.page(name="second") as second:
        first.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        first.say("record")
        assert first.hear("recording") == "0 of 10"
        first.say("record")
        assert "one of viewer 1" in first.hear("problem")
        second.say("take_over", width=64, height=48)
        second.say("end_record")
        second.say("record")
        assert "one of viewer 1" in second.hear("problem")
        first.say("end_record")
        host.document.may_go_on.set()
        assert first.hear("recording") == ""


def test_only_a_prim_of_the_stage_is_selected(host: Host) -> None:
    """Oracle: the state that the document was asked to draw; a sentence about any other text."""
    with host.page() as page:
        page.final()
        host.session.ask(lambda document: document.stage.DefinePrim("/A/B"))
        page.say("select", path="/A/B")
        while page.hear("state")["selected"] != ["/A/B"]:
            pass
        for path in ("/A/C", "<script>", "/A/B.visibility", ""):
            page.say("select", path=path)
            assert "expected a prim of the stage" in page.hear("problem")
        assert page.last("state")["selected"] == ["/A/B"]
        page.say("select", path=None)
        while page.hear("state")["selected"] != []:
            pass


def test_a_page_that_comes_again_has_no_recording(host: Host) -> None:
    """Oracle: the connection that asked for it is gone; while it lasts, a page has its progress."""
    with host.page(name="first") as first:
        first.final()
        host.session.ask(lambda document: host.document.may_go_on.wait(PATIENCE))
        first.say("record")
        assert first.hear("recording") == "0 of 10"
        first.say("hello", page="first", width=64, height=48)
        assert first.hear("recording") == "0 of 10"
    with host.page(name="first") as again:
        assert again.hear("recording") == ""
        host.document.may_go_on.set()


def test_comparisons_and_bookmarks_are_kept(host: Host) -> None:
    """Oracle: the state that the document was asked to draw, and that the page is told."""
    with host.page() as page:
        page.final()
        page.say("set_setting", name="sh_degree", value=1)
        page.say("set_other", aov="N", time=3)
        page.say("set_setting", name="sh_degree", value=2)
        page.say("set_other", aov="albedo")
        page.say("set_wipe", part=0.25)
        page.say("add_bookmark", name="here")
        page.say("use_camera", path="/B")
        page.say("add_bookmark")
        while page.hear("state")["bookmarks"] != ["here", "View 1"]:
            pass
        page.say("restore_bookmark", name="here")
        page.say("remove_bookmark", name="View 1")
        while page.hear("state")["bookmarks"] != ["here"]:
            pass
        page.say("set_time", time=9)
        while page.final()["time"] != 9:
            pass
        state = host.document.states[-1]
        assert state.wipe == 0.25 and state.camera != "/B"
        assert (state.other.aov, state.other.time) == ("albedo", None)
        assert (state.look.settings.sh_degree, state.other.settings.sh_degree) == (2, 1)
        page.say("set_other", aov=None)
        while page.hear("state")["other"] is not None:
            pass


def test_a_page_that_comes_again_drives_again(host: Host) -> None:
    """Oracle: its name; the lost connection, which the server may still take for open, watches."""
    with host.page(name="first") as first:
        first.final()
        with host.page(name="first") as again:
            assert again.hear("seats") == {"you": 2, "driver": 2, "pages": 2}


def test_who_has_watched_the_longest_drives_when_the_driver_goes(host: Host) -> None:
    """Oracle: the order of hellos; the picture gets the size of the new driver's viewport."""
    with ExitStack() as stack:
        with host.page(name="first") as first:
            first.final()
            second = stack.enter_context(host.page(name="second", size=(80, 60)))
            second.hear("seats")
            third = stack.enter_context(host.page(name="third", size=(96, 64)))
            third.hear("seats")
            second.say("resize", width=88, height=60)
            second.say("set_aov", name="N")
            second.hear("watching")
        while second.hear("seats")["driver"] != 2:
            pass
        while third.hear("seats") != {"you": 3, "driver": 2, "pages": 2}:
            pass
        while second.final()["viewport"] != [88, 60]:
            pass
        second.say("set_time", time=3)
        while third.final()["time"] != 3:
            pass


def test_playback_ends_when_nobody_looks(host: Host) -> None:
    """Oracle: the state that the next page gets."""
    with host.page(name="first") as page:
        page.final()
        page.say("play", is_playing=True)
        while not page.hear("state")["is_playing"]:
            pass
    with host.page(name="second") as other:
        while other.hear("state")["is_playing"]:
            pass


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
