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
from usdsplat.images.aovs import AOVS
from usdsplat.preview import opening
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.knob_model import editors_of, with_value
from usdsplat.preview.picking import Picked, pick
from usdsplat.preview.session import Session
from usdsplat.preview.setting_editors import setting_editors, with_setting
from usdsplat.preview.stage_model import parameters
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
from usdsplat.preview.web.pages import Pages
from usdsplat.preview.web.session_proxy import SessionProxy
from usdsplat.render.settings import RenderSettings

GLIDE = 0.25
"""Duration of a camera move when something is framed [s]."""
TICK = 1 / 60
"""Interval of the timer during playback and camera moves [s]."""


class WebController:
    """One view of a session, controlled by the page that holds it.

    Args:
        session: The session.
        pages: The open pages; the one that holds the view receives events.
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
        self._proxy = SessionProxy(session, heard=self._heard)
        self._viewer = Viewer(self._proxy, changed=self._changed, glide=GLIDE)
        self._opened: Opened | None = None
        self._status = SimulationStatus(state="none")
        self._busy = ""
        self._picture: Picture | None = None
        self._parameters: Any = []
        self._settings_told: tuple[Any, ...] = ()
        self._problem = ""
        self._clock: asyncio.Task[None] | None = None
        self._first_camera, self._first_time = camera, time
        # events sent before this listener was added are requested
        self._proxy.ask(_beginning, self._begin)

    # --- for the server --------------------------------------------------------------------

    def welcome(self, width: int, height: int) -> None:
        """Send everything to a page that got the view, and fit the pictures to it."""
        self._tell("welcome", None)
        self._tell_opened()
        self._settings_told = ()
        self._tell("parameters", self._parameters)
        self._tell("simulation", as_json(self._status))
        self._tell("busy", self._busy)
        if self._problem:
            self._tell("problem", self._problem)
        if self._picture is not None:
            self._show(self._picture)
        self._viewer.resize(width, height)

    def rest(self) -> None:
        """Stop playback and moves when no page is left; a simulation goes on."""
        self._viewer.play(False)
        self._viewer.end_move()

    def close(self) -> None:
        """Stop listening and ticking."""
        if self._clock is not None:
            self._clock.cancel()
        self._proxy.close()

    def do(self, message: m.Message) -> None:
        """Handle a page's message.

        Raises:
            UsageError: If it refers to something that does not exist, or exceeds a limit.
        """
        viewer = self._viewer
        match message:
            case m.Resize(width=width, height=height):
                viewer.resize(width, height)
            case m.Orbit(right=right, down=down):
                viewer.orbit(right, down)
            case m.Pan(right=right, down=down):
                viewer.pan(right, down)
            case m.Dolly(factor=factor):
                viewer.dolly(factor)
            case m.LookAround(right=right, down=down):
                viewer.look_around(right, down)
            case m.Fly(right=right, up=up, forward=forward):
                viewer.set_flight(right, up, forward)
                self._start_clock()
            case m.EndMove():
                viewer.end_move()
            case m.UseCamera(path=path):
                self._use_camera(path)
            case m.Play(is_playing=is_playing):
                viewer.play(is_playing)
            case m.Advance(frames=frames):
                viewer.advance(frames)
            case m.SetTime(time=time, is_scrubbing=is_scrubbing):
                viewer.set_time(time, is_scrubbing=is_scrubbing)
            case m.SetRange(start=start, end=end):
                viewer.timeline.set_range(start, end)
                viewer.set_time(viewer.timeline.current)
            case m.SetLoops(loops=loops):
                viewer.timeline.loops = loops
                self._changed()
            case m.SetAov(name=name):
                self._set_aov(name)
            case m.SetSetting(name=name, value=value):
                settings = with_setting(viewer.state.look.settings, name, value)
                _check_names_no_file(settings)
                viewer.set_look(settings=settings)
            case m.SetDisplay(name=name, value=value):
                display = with_value(viewer.state.display, name, value)
                viewer.set_display(**{name: getattr(display, name)})
            case _:
                self._ask_for(message)

    # --- what needs the stage --------------------------------------------------------------

    def _ask_for(self, message: m.Message) -> None:
        if self._proxy.is_overrun:
            raise UsageError("message", "too many open requests", "fewer at a time")
        match message:
            case m.Frame(everything=everything):
                self._viewer.frame(() if everything else self._viewer.state.selected)
            case m.Pick(x=x, y=y, is_target=is_target):
                self._proxy.ask(
                    lambda document: pick(document, x, y),
                    lambda picked: self._picked(picked, is_target=is_target),
                    key=f"pick {is_target}",
                )
            case m.Simulate(action=action):
                self._proxy.ask(lambda document: _simulate(document, action))
            case m.SetParameter():
                self._set_parameter(message)
            case m.Undo():
                self._edit(lambda document: document.edits.undo(), "Undid")
            case m.Redo():
                self._edit(lambda document: document.edits.redo(), "Did again")
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

    def _picked(self, picked: Picked | None, *, is_target: bool) -> None:
        self._tell("picked", as_json(picked))
        if picked is None:
            self._viewer.select(())
            return
        self._viewer.select((picked.path,))
        if is_target:
            self._viewer.aim(picked.position)

    # --- what needs only the viewer --------------------------------------------------------

    def _use_camera(self, path: str | None) -> None:
        if path is not None and path not in self._viewer.cameras:
            cameras = ", ".join(self._viewer.cameras) or "none: the stage has no camera"
            raise UsageError("camera", repr(path), cameras)
        self._viewer.use_camera(path)

    def _set_aov(self, name: str) -> None:
        if name not in AOVS:
            raise UsageError("AOV", repr(name), f"one of {', '.join(AOVS)}")
        self._viewer.set_look(aov=name)

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
                self._ask_parameters()
            case SimulationStatus():
                self._status = event
                self._tell("simulation", as_json(event))
                self._viewer.simulated(event)
            case Problem(sentence=sentence):
                self._problem = sentence
                self._tell("problem", sentence)
            case Busy(what=what):
                self._busy = what
                self._tell("busy", what)

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
                self._opened, cameras=viewer.cameras, has_simulation=viewer.has_simulation
            )
            if said != self._opened:
                self._opened = said
                self._tell_opened()
        self._tell(
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
            },
        )
        settings = (state.look.settings, state.display)
        if settings != self._settings_told:
            self._settings_told = settings
            render = as_json(setting_editors(settings[0]))
            self._tell("settings", {"render": render, "display": _editors(settings[1])})
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
        if self._pages.holder is not None:
            self._pages.holder.outbox.tell(kind, content)

    def _show(self, picture: Picture) -> None:
        if self._pages.holder is not None:
            self._pages.holder.outbox.show(picture)

    def _tell_opened(self) -> None:
        if self._opened is not None:
            aovs = [{"name": name, "meaning": aov.meaning} for name, aov in AOVS.items()]
            self._tell("opened", {**as_json(self._opened), "aovs": aovs})


def _beginning(document: Document) -> tuple[Opened, SimulationStatus]:
    """Return the first events of a session."""
    simulation = document.simulation
    status = SimulationStatus(state="none") if simulation is None else simulation.status
    return document.opened(), status


def _check_names_no_file(settings: RenderSettings) -> None:
    """Raise an error for settings that would read a file of this machine's disks."""
    config = settings.ocio_config
    if config and not config.startswith("ocio://"):
        raise UsageError(
            "ocio_config", repr(config), "an ocio:// name; a file can only be set by $OCIO"
        )


def _editors(instance: Any) -> Any:
    return as_json(editors_of(instance))


def _status(document: Document) -> SimulationStatus:
    """Return the simulation's status; runs in the session's thread."""
    simulation = document.simulation
    return SimulationStatus(state="none") if simulation is None else simulation.status


def _simulate(document: Document, action: str) -> None:
    """Control the simulation; runs in the session's thread."""
    if document.simulation is None:
        raise StageError("simulation", "none on the stage", "a SplatSim prim")
    getattr(document.simulation, action)()
