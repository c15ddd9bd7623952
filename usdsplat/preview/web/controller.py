"""Handle the messages of a page, in the server's thread.

Requests that need the stage run in the session's thread; their results are sent to the page like
any other event.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.preview import opening
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.display import choices
from usdsplat.preview.document import Document
from usdsplat.preview.knob_model import editors_of
from usdsplat.preview.picking import Picked, pick
from usdsplat.preview.session import Session
from usdsplat.preview.setting_editors import setting_editors
from usdsplat.preview.stage_model import parameters
from usdsplat.preview.stage_model.prims import path_of
from usdsplat.preview.values import (
    Busy,
    Event,
    Opened,
    Picture,
    Problem,
    SimulationStatus,
    StageChanged,
    as_json,
)
from usdsplat.preview.viewer import Viewer
from usdsplat.preview.web import messages as m
from usdsplat.preview.web.commands import apply
from usdsplat.preview.web.pages import MOST_WAITING, Page, Pages
from usdsplat.preview.web.questions import answer, overrun
from usdsplat.preview.web.recording import Recording
from usdsplat.preview.web.session_proxy import SessionProxy

GLIDE = 0.25
"""Duration of a camera move when something is framed [s]."""
TICK = 1 / 60
"""Interval of the timer during playback and camera moves [s]."""


class WebController:
    """One view of a session, controlled by the page that drives.

    Args:
        session: The session.
        pages: The open pages; all receive events.
        camera: Path of the first camera; None frames the whole scene.
        time: First time code; None for that of the stage.
    """

    def __init__(
        self,
        session: Session,
        pages: Pages,
        *,
        camera: str | None = None,
        time: float | None = None,
    ) -> None:
        self._pages = pages
        self._to: tuple[Page, ...] | None = None
        """Pages that are told; None for all."""
        self._proxy = SessionProxy(session, heard=self._heard)
        self._viewer = Viewer(self._proxy, changed=self._changed, glide=GLIDE)
        self._opened: Opened | None = None
        self._status = SimulationStatus(state="none")
        self._busy = ""
        self._picture: Picture | None = None
        self._parameters: Any = []
        self._settings_told: tuple[Any, ...] = ()
        self._recording: Recording | None = None
        self._problem = ""
        self._clock: asyncio.Task[None] | None = None
        self._first_camera, self._first_time = camera, time
        # events sent before this listener was added are requested
        self._proxy.ask(_beginning, self._begin)

    # --- for the server --------------------------------------------------------------------

    def welcome(self, page: Page) -> None:
        """Send everything to a page, and fit the pictures to it if it drives."""
        self._to = (page,)
        try:
            self._tell_opened()
            self._settings_told = ()
            self._tell("parameters", self._parameters)
            self._tell("simulation", as_json(self._status))
            self._tell("busy", self._busy)
            running = self._recording
            self._tell("recording", "" if running is None else running.progress_for(page))
            if self._problem:
                self._tell("problem", self._problem)
            if self._picture is not None:
                page.outbox.show(self._picture)
            self._changed()
        finally:
            self._to = None
        if page is self._pages.driver:
            self._viewer.resize(*page.size)

    def leave(self, page: Page) -> None:
        """Let another page drive when one is closed. When none is left, playback and moves stop,
        and a simulation goes on."""
        was_driving = page is self._pages.driver
        self._pages.leave(page)
        if self._recording is not None and self._recording.page is page:
            self._recording.leave()
        if was_driving:
            self._pass_on()

    def _pass_on(self) -> None:
        """Fit the view to the page that drives now."""
        self._viewer.end_move()
        if self._pages.driver is None:
            self._viewer.play(False)
        else:
            self._viewer.resize(*self._pages.driver.size)

    def hear(self, page: Page, message: m.Message) -> None:
        """Handle a message of a page; those that watch may only look.

        Raises:
            UsageError: If it refers to something that does not exist, or exceeds a limit.
        """
        if isinstance(message, m.Resize | m.TakeOver):
            page.size = message.width, message.height
        if isinstance(message, m.TakeOver):
            self._pages.take_over(page)
            self._pass_on()
        elif isinstance(message, m.Look):
            answer(message, page, pages=self._pages, proxy=self._proxy, viewer=self._viewer)
        elif isinstance(message, m.EndRecord):
            if self._recording is not None and self._recording.page is page:
                self._recording.cancel()
        elif page is self._pages.driver:
            self.do(message)
        elif not isinstance(message, m.Resize):
            page.outbox.tell("watching", None)

    def close(self) -> None:
        """Stop listening and ticking."""
        if self._clock is not None:
            self._clock.cancel()
        if self._recording is not None:
            self._recording.close()
        self._proxy.close()

    def do(self, message: m.Message) -> None:
        """Handle a message of the page that drives.

        Raises:
            UsageError: If it refers to something that does not exist, or exceeds a limit.
        """
        if apply(self._viewer, message):
            self._start_clock()
        elif isinstance(message, m.SetLoops):
            self._viewer.timeline.loops = message.loops
            self._changed()
        else:
            self._ask_for(message)

    # --- what needs the stage --------------------------------------------------------------

    def _check_rate(self) -> None:
        if self._proxy.is_overrun():
            raise overrun()

    def _record(self) -> None:
        """Record the timeline's range for the page that drives."""
        running, driver, viewer = self._recording, self._pages.driver, self._viewer
        if running is not None and not running.is_over:
            raise UsageError("recording", f"one of viewer {running.page.number}", "its end first")
        if (waiting := self._pages.waiting) > MOST_WAITING:
            raise UsageError("recording", f"files of {waiting} bytes under way", "their end first")
        if driver is not None:
            self._recording = Recording(
                viewer.state, viewer.timeline, page=driver, proxy=self._proxy
            )

    def _ask_for(self, message: m.Message) -> None:
        self._check_rate()
        match message:
            case m.Frame(everything=everything):
                self._viewer.frame(() if everything else self._viewer.state.selected)
            case m.Pick(x=x, y=y):
                self._proxy.ask(
                    lambda document: pick(document, x, y),
                    lambda picked: self._picked(picked, message),
                    key=f"pick {message.is_target} {message.is_framed}",
                )
            case m.Simulate(action=action):
                self._proxy.ask(lambda document: _simulate(document, action))
            case m.SetParameter():
                self._set_parameter(message)
            case m.Select(path=path):
                self._proxy.ask(
                    lambda document: () if path is None else (path_of(document.stage, path),),
                    self._viewer.select,
                    key="select",
                )
            case m.SetVisible(path=path, is_visible=is_visible):
                self._proxy.ask(lambda document: document.edits.set_visible(path, is_visible))
            case m.Undo():
                self._edit(lambda document: document.edits.undo(), "Undid")
            case m.Redo():
                self._edit(lambda document: document.edits.redo(), "Did again")
            case m.Record():
                self._record()
            case m.Reload():
                self._proxy.ask(
                    opening.reload,
                    lambda names: self._tell("said", f"Read {', '.join(names) or 'nothing'} again"),
                    key="reload",
                )

    def _set_parameter(self, message: m.SetParameter) -> None:
        path, name, value = message.path, message.name, message.value
        now = self._viewer.state.time
        merge = f"{path} {name} {message.drag}" if message.drag else None

        def task(document: Document) -> None:
            parameters.edit_parameter(document.edits, path, name, value, now=now, merge=merge)

        def refused(error: UsdSplatError) -> None:
            self._heard(Problem(sentence=str(error)))
            self._ask_parameters()  # the page shows the rejected value

        # on success the stage has changed, and the page is notified
        self._proxy.ask(task, failed=refused, key=f"set {path} {name}")

    def _edit(self, task: Callable[[Document], str | None], word: str) -> None:
        self._proxy.ask(
            task, lambda step: self._tell("said", f"{word}: {step}" if step else "Nothing to do")
        )

    def _ask_parameters(self) -> None:
        time = self._viewer.state.time
        self._proxy.ask(
            lambda document: parameters.editors(document.stage, time=time),
            self._keep_parameters,
            key="parameters",
        )

    def _keep_parameters(self, prims: tuple[parameters.ParameterPrim, ...]) -> None:
        self._parameters = as_json(prims)
        self._tell("parameters", self._parameters)

    def _picked(self, picked: Picked | None, message: m.Pick) -> None:
        self._tell("picked", as_json(picked))
        self._viewer.select(() if picked is None else (picked.path,))
        if picked is not None and message.is_target:
            self._viewer.aim(picked.position)
        elif message.is_framed:
            self._viewer.frame(self._viewer.state.selected)

    # --- what happened ---------------------------------------------------------------------

    def _heard(self, event: Event) -> None:
        match event:
            case Picture():
                self._picture = event
                self._viewer.shown(event)
                self._show(event)
            case Opened():
                self._opened = event
                self._problem = ""
                self._tell_opened()
                self._viewer.opened(event)
                self._look_first()
                self._ask_parameters()
                self._proxy.ask(_status, self._heard)
            case StageChanged():
                self._viewer.stage_changed(event)
                if event.structure or event.visibility:
                    self._tell("stage_changed", None)
                self._ask_parameters()
            case SimulationStatus():
                self._status = event
                self._tell("simulation", as_json(event))
                self._viewer.simulated(event)
            case Problem(sentence=sentence):
                self._problem = sentence
                self._tell("problem", sentence)
            case Busy(what=what, done=done, total=total):
                self._busy = f"{what} {done}/{total}" if event.of_picture and total else what
                self._tell("busy", self._busy)

    def _begin(self, told: tuple[Opened, SimulationStatus]) -> None:
        opened, status = told
        if self._opened is None:
            self._heard(opened)
        if self._status.state == "none":
            self._heard(status)

    def _look_first(self) -> None:
        """Apply the camera and time that were given at the start."""
        camera, self._first_camera = self._first_camera, None
        time, self._first_time = self._first_time, None
        if camera is not None:
            self._viewer.use_camera(camera)
        if time is not None:
            self._viewer.set_time(time)

    def _changed(self) -> None:
        """Send the viewer's state to the page after a change."""
        viewer = self._viewer
        state, timeline = viewer.state, viewer.timeline
        if self._opened is not None:
            said = replace(
                self._opened, cameras=viewer.cameras, lights=viewer.lights,
                has_simulation=viewer.has_simulation,
            )  # fmt: skip
            if said != self._opened:
                self._opened = said
                self._tell_opened()
        look = state.other
        other = None if look is None else {"aov": look.aov, "time": look.time}
        self._keep(
            "state",
            {
                "camera": state.camera if isinstance(state.camera, str) else None,
                "is_free": isinstance(state.camera, FreeCamera),
                "aov": state.look.aov,
                "selected": state.selected,
                "time": timeline.current,
                "start": timeline.start,
                "end": timeline.end,
                "rate": timeline.rate,
                "step": timeline.step,
                "loops": timeline.loops,
                "is_playing": timeline.is_playing,
                "other": other,
                "wipe": state.wipe,
                "bookmarks": [each.name for each in viewer.bookmarks],
            },
        )
        settings = (state.look.settings, state.display)
        if settings != self._settings_told:
            self._settings_told = settings
            render = as_json(setting_editors(settings[0]))
            display = as_json(editors_of(settings[1]))
            self._tell("settings", {"render": render, "display": display})
        self._start_clock()

    def _start_clock(self) -> None:
        if self._viewer.is_ticking and (self._clock is None or self._clock.done()):
            self._clock = asyncio.get_running_loop().create_task(self._tick())

    async def _tick(self) -> None:
        loop = asyncio.get_running_loop()
        while self._viewer.is_ticking:
            self._viewer.tick(loop.time())
            await asyncio.sleep(TICK)

    # --- telling ---------------------------------------------------------------------------

    def _tell(self, kind: str, content: Any) -> None:
        for page in self._to or self._pages.present:
            page.outbox.tell(kind, content)

    def _keep(self, kind: str, content: Any) -> None:
        for page in self._to or self._pages.present:
            page.outbox.keep(kind, content)

    def _show(self, picture: Picture) -> None:
        for page in self._pages.present:
            page.outbox.show(picture)

    def _tell_opened(self) -> None:
        if self._opened is not None:
            aovs = [{"name": a.name, "meaning": a.meaning} for a in choices(self._opened.lights)]
            self._tell("opened", {**as_json(self._opened), "aovs": aovs})


def _beginning(document: Document) -> tuple[Opened, SimulationStatus]:
    """Return the first events of a session."""
    simulation = document.simulation
    status = SimulationStatus(state="none") if simulation is None else simulation.status
    return document.opened(), status


def _status(document: Document) -> SimulationStatus:
    """Return the simulation's status; runs in the session's thread."""
    simulation = document.simulation
    return SimulationStatus(state="none") if simulation is None else simulation.status


def _simulate(document: Document, action: str) -> None:
    """Control the simulation; runs in the session's thread."""
    if document.simulation is None:
        raise StageError("simulation", "none on the stage", "a SplatSim prim")
    getattr(document.simulation, action)()
