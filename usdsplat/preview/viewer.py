"""One user's view of a session: its state, its timeline and its bookmarks.

A window or a socket owns one, in its own thread, and passes it user actions and events. It requests
views from the session. Call `tick` while `is_ticking`, as playback and moves need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from usdsplat.core.knobs import checked
from usdsplat.preview.bookmarks import Bookmark, free_name, renamed, without
from usdsplat.preview.camera import FreeCamera, Glide, Side, UpAxis, Vector, middle_of
from usdsplat.preview.latest_request import Asks
from usdsplat.preview.placement import Placement, Placing
from usdsplat.preview.timeline import Timeline
from usdsplat.preview.values import (
    DisplaySettings,
    Look,
    Opened,
    Picture,
    SimulationStatus,
    StageChanged,
    ViewState,
)
from usdsplat.render.specs import CameraSpec, Matrix
from usdsplat.render.subject import Subject

FLIGHT = 0.5
"""Fraction of the distance to the target that a flight covers per second, at speed 1."""
SPEEDS = (1e-3, 1e3)
"""Lowest and highest flight speed."""
LONGEST_TICK = 0.1
"""Longest time step of a flight [s], so that a delayed tick does not cause a leap."""


class Viewer:
    """A user's view of a session.

    Args:
        session: Receiver of view requests. It calls back in this viewer's thread; where the session
            has another thread, pass a proxy.
        changed: Called after each change of the viewer.
        glide: Duration of a camera move to a framed target [s]; 0 without a clock.
    """

    def __init__(
        self,
        session: Asks,
        *,
        changed: Callable[[], None] = lambda: None,
        glide: float = 0.0,
    ) -> None:
        self._session = session
        self._listeners: tuple[Callable[[], None], ...] = (changed,)
        self._placing = Placing(session, changed=self._changed)
        self._glide_time = glide
        self.state = ViewState()
        self.timeline = Timeline()
        self.bookmarks: tuple[Bookmark, ...] = ()
        self.cameras: tuple[str, ...] = ()  # paths of the stage's cameras
        self.lights: tuple[str, ...] = ()  # AOVs of the stage's light groups
        self.has_simulation = False  # whether the stage has a simulation
        self._range = (0.0, 0.0)  # range of the stage; the timeline's may differ
        self.up_axis: UpAxis = "Y"
        self.subject: Subject | None = None
        """What a camera frames of the scene; None until it is known, and for an empty scene."""
        self.speed = 1.0
        """Speed of flights."""
        self._seen: CameraSpec | None = None
        self.flight = (0.0, 0.0, 0.0)
        """Flight direction: right, up and forward."""
        self._glide: Glide | None = None
        self._ticked: float | None = None

    @property
    def aspect(self) -> float:
        """Width divided by height of the viewport."""
        return self.state.size[0] / self.state.size[1]

    def listen(self, changed: Callable[[], None]) -> Callable[[], None]:
        """Add a listener for changes and return a function that removes it."""
        self._listeners = (*self._listeners, changed)

        def stop() -> None:
            self._listeners = tuple(each for each in self._listeners if each is not changed)

        return stop

    # --- what happened ---------------------------------------------------------------------

    def opened(self, event: Opened) -> None:
        """Show a newly opened stage, all of it framed, at its first time; the look stays."""
        self.timeline = Timeline(
            start=event.start, end=event.end, rate=event.rate, current=event.start
        )
        self.cameras, self.lights, self.up_axis = event.cameras, event.lights, event.up_axis
        self.has_simulation, self._range = event.has_simulation, (event.start, event.end)
        self.bookmarks, self.subject, self._seen = (), None, None
        self._glide, self.flight = None, (0.0, 0.0, 0.0)
        self._session.ask(lambda document: document.subject(), partial(setattr, self, "subject"))
        self._see(
            camera=None,
            time=event.start if event.end > event.start else None,
            look=replace(self.state.look, time=None),
            other=None,
            selected=(),
            is_moving=False,
        )
        self._follow()

    def shown(self, picture: Picture) -> None:
        """Record the camera of a picture, where moves start, and the places of its lights."""
        self._placing.note(picture.overlays.lights)
        if picture.state.camera == self.state.camera:
            self._seen = picture.camera

    def stage_changed(self, event: StageChanged) -> None:
        """Update the selected prim's place and, for a new structure, cameras and range."""
        self._follow()
        if event.structure:
            self._session.ask(lambda document: document.opened(), self._renew)

    def simulated(self, status: SimulationStatus) -> None:
        """Follow a running or recorded simulation, and extend the timeline to its frames."""
        if status.frames is not None:
            first, last = status.frames
            now = self.timeline
            now.set_range(min(first, now.start), max(last, now.end))
        if status.state in ("running", "recording") and status.frame is not None:
            self.set_time(status.frame)
        else:
            self._changed()

    def resize(self, width: int, height: int) -> None:
        """Set the size of the viewport [screen pixel]."""
        self._see(size=(max(width, 1), max(height, 1)))

    # --- moves -----------------------------------------------------------------------------

    def orbit(self, right: float, down: float) -> None:
        """Orbit the target by a drag, in fractions of the viewport's height."""
        self._move(lambda camera: camera.orbited(right, down))

    def pan(self, right: float, down: float) -> None:
        """Pan with a drag, in fractions of the viewport's height."""
        self._move(lambda camera: camera.panned(right, down, aspect=self.aspect))

    def dolly(self, factor: float) -> None:
        """Multiply the distance from the target."""
        self._move(lambda camera: camera.dollied(factor))

    def look_around(self, right: float, down: float) -> None:
        """Turn the view about the eye by a drag, in fractions of the viewport's height."""
        self._move(lambda camera: camera.looked_around(right, down))

    def fly(self, right: float, up: float, forward: float) -> None:
        """Move eye and target, in seconds of flight at the current speed."""

        def flown(camera: FreeCamera) -> FreeCamera:
            pace = FLIGHT * self.speed * camera.distance
            return camera.flown(pace * right, pace * up, pace * forward)

        self._move(flown)

    def set_flight(self, right: float, up: float, forward: float) -> None:
        """Set the flight direction, such as for held keys; zeros stop the flight."""
        self.flight = (right, up, forward)

    def set_speed(self, speed: float) -> None:
        """Set the flight speed, 1 being the default."""
        self.speed = min(max(speed, SPEEDS[0]), SPEEDS[1])
        self._changed()

    def end_move(self) -> None:
        """End a move of the view, so that the next picture is of full quality."""
        self.flight = (0.0, 0.0, 0.0)
        if self.state.is_moving and not self.is_ticking:
            self._see(is_moving=False)

    # --- cameras ---------------------------------------------------------------------------

    def free_camera(self) -> FreeCamera | None:
        """Return the free camera of the last picture, where moves start; None before any."""
        if isinstance(self.state.camera, FreeCamera):
            return self.state.camera
        if self._seen is None:
            return None
        return FreeCamera.like(
            self._seen,
            target=middle_of(self.subject, self._seen),
            up_axis=self.up_axis,
            aspect=self.aspect,
        )

    def frame(self, paths: tuple[str, ...] = ()) -> None:
        """Frame some prims, or everything, from the current direction."""
        self._session.ask(
            lambda document: document.subject(paths),
            lambda subject: None if subject is None else self.frame_subject(subject),
        )

    def frame_subject(self, subject: Subject) -> None:
        """Frame a subject from the current direction."""
        camera = self.free_camera()
        if camera is not None:
            self._go(camera, camera.framing(subject, aspect=self.aspect))

    def aim(self, target: Vector) -> None:
        """Centre the view on a point, and orbit it from now on."""
        camera = self.free_camera()
        if camera is not None:
            self._go(camera, camera.aimed(target))

    def face(self, side: Side) -> None:
        """See the middle of the view from a side."""
        camera = self.free_camera()
        if camera is not None:
            self.use_camera(camera.facing(side))

    def use_camera(self, camera: FreeCamera | str | None, *, is_moving: bool = False) -> None:
        """Look through a stage's camera (its path), a free camera, or one that frames all (None).

        Args:
            is_moving: Whether more changes follow soon, until `end_move`.
        """
        self._glide = None
        self._see(camera=camera, is_moving=is_moving)

    def add_bookmark(self, name: str = "") -> Bookmark:
        """Save the view under a name, replacing a bookmark of that name; "" chooses a new name."""
        bookmark = Bookmark(
            name=name or free_name(self.bookmarks),
            camera=self.state.camera or self.free_camera(),
            time=self.state.time,
        )
        self.bookmarks = (*without(self.bookmarks, bookmark.name), bookmark)
        self._changed()
        return bookmark

    def restore(self, name: str) -> None:
        """Restore a bookmark; an unknown name does nothing."""
        for bookmark in self.bookmarks:
            if bookmark.name == name:
                self.use_camera(bookmark.camera)
                if bookmark.time is not None:
                    self.set_time(bookmark.time)

    def rename(self, name: str, to: str) -> None:
        """Give a bookmark another name, which replaces one that has it; "" changes nothing."""
        self.bookmarks = renamed(self.bookmarks, name, to)
        self._changed()

    def remove(self, name: str) -> None:
        """Remove a bookmark."""
        self.bookmarks = without(self.bookmarks, name)
        self._changed()

    # --- time ------------------------------------------------------------------------------

    def set_time(self, time: float, *, is_scrubbing: bool = False) -> None:
        """Show a time [time code], clamped to the timeline.

        Args:
            is_scrubbing: Whether more changes follow soon, until `end_move`.
        """
        self._see(time=self.timeline.go(time), is_moving=is_scrubbing or self.timeline.is_playing)

    def advance(self, frames: int) -> None:
        """Stop playback and move by a number of frames."""
        self._see(time=self.timeline.advance(frames), is_moving=False)

    def play(self, is_playing: bool = True) -> None:
        """Start or stop playback; it advances with `tick`."""
        self.timeline.play(is_playing)
        time = None if self.state.time is None else self.timeline.current
        self._see(time=time, is_moving=is_playing)

    @property
    def is_ticking(self) -> bool:
        """Whether playback, a flight or a camera move needs ticks."""
        return self.timeline.is_playing or any(self.flight) or self._glide is not None

    def tick(self, now: float) -> None:
        """Advance playback, flight and camera move.

        Args:
            now: Time of a monotonic clock [s].
        """
        was_ticking = self.is_ticking
        passed = 0.0 if self._ticked is None else min(now - self._ticked, LONGEST_TICK)
        changes: dict[str, Any] = {}
        time = self.timeline.tick(now) if self.timeline.is_playing else None
        if time is not None:
            changes["time"] = time
        if self._glide is not None:
            changes["camera"], is_there = self._glide.at(now)
            self._glide = None if is_there else self._glide
        if changes:
            self._see(**changes, is_moving=True)
        if any(self.flight):
            self.fly(*(passed * part for part in self.flight))
        self._ticked = now if self.is_ticking else None
        if was_ticking and not self.is_ticking:
            self.end_move()

    # --- how it is shown -------------------------------------------------------------------

    def set_look(self, **changes: Any) -> None:
        """Change fields of `state.look`."""
        self._see(look=replace(self.state.look, **changes))

    def set_other(self, other: Look | None) -> None:
        """Set the look right of the wipe; None for no comparison."""
        self._see(other=other)

    def set_wipe(self, part: float) -> None:
        """Set the wipe's position as a fraction of the width."""
        self._see(wipe=min(max(part, 0.0), 1.0))

    def set_display(self, **changes: Any) -> None:
        """Change fields of `state.display`.

        Raises:
            UsageError: If one cannot have that value.
        """
        self._see(display=checked("display", DisplaySettings, asdict(self.state.display) | changes))

    def set_purposes(self, purposes: tuple[str, ...]) -> None:
        """Set the purposes that are drawn."""
        self._see(purposes=purposes)

    def set_overlays(self, **shows: bool) -> None:
        """Set which overlays are wanted, by the names of the state's fields."""
        self._see(**shows)

    def select(self, paths: tuple[str, ...]) -> None:
        """Select these prims and no others."""
        self._see(selected=paths)
        self._follow()

    @property
    def placement(self) -> Placement | None:
        """Place of the last selected prim; None until it is known, and for prims without one."""
        return self._placing.placement

    def begin_drag(self, verb: str = "Move") -> None:
        """Start a drag: one undo, named by a verb, takes back all following calls of `place`."""
        self._placing.begin(verb)

    def place(self, matrix: Matrix | None) -> None:
        """Set the local-to-world matrix of the last selected prim, on the session layer; None
        takes the drag back."""
        self._placing.move(matrix, self.state.time)
        self._see(is_moving=True)

    # --- private ---------------------------------------------------------------------------

    def _changed(self) -> None:
        for listener in self._listeners:
            listener()

    def _renew(self, event: Opened) -> None:
        """Update cameras, simulation and range of the stage."""
        self.cameras, self.lights = event.cameras, event.lights
        self.has_simulation = event.has_simulation
        before, self._range = self._range, (event.start, event.end)
        if self._range != before:
            self.timeline.set_range(event.start, max(event.start, event.end))
            self._see(time=self.timeline.current if event.end > event.start else None)
        else:
            self._changed()

    def _follow(self) -> None:
        path = self.state.selected[-1] if self.state.selected else ""
        self._placing.follow(path, self.state.time)

    def _see(self, **changes: Any) -> None:
        before = self.state
        self.state = replace(self.state, **changes)
        if before.time != self.state.time:
            self._follow()
        self._session.look(self.state)
        self._changed()

    def _move(self, moved: Callable[[FreeCamera], FreeCamera]) -> None:
        camera = self.free_camera()
        if camera is not None:
            self._glide = None
            self._see(camera=moved(camera), is_moving=True)

    def _go(self, here: FreeCamera, there: FreeCamera) -> None:
        if self._glide_time > 0.0:
            self._glide = Glide(here, there, self._glide_time)
            self._changed()
        else:
            self._see(camera=there)
