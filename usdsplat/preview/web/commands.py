"""Apply the messages of a page that need only the viewer: moves, time, and how it is shown."""

from __future__ import annotations

from dataclasses import replace

from usdsplat.core.errors import UsageError
from usdsplat.images.aovs import AOVS, is_light
from usdsplat.preview.knob_model import with_value
from usdsplat.preview.setting_editors import with_setting
from usdsplat.preview.viewer import Viewer
from usdsplat.preview.web import messages as m
from usdsplat.render.settings import RenderSettings

MOST_BOOKMARKS = 200


def apply(viewer: Viewer, message: m.Message) -> bool:
    """Apply a message, and return False if it needs the stage.

    Raises:
        UsageError: If it refers to something that does not exist.
    """
    return any(step(viewer, message) for step in (_move, _set_time, _set_look, _change_bookmarks))


def _move(viewer: Viewer, message: m.Message) -> bool:
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
        case m.EndMove():
            viewer.end_move()
        case m.UseCamera(path=path):
            if path is not None and path not in viewer.cameras:
                cameras = ", ".join(viewer.cameras) or "none: the stage has no camera"
                raise UsageError("camera", repr(path), cameras)
            viewer.use_camera(path)
        case _:
            return False
    return True


def _set_time(viewer: Viewer, message: m.Message) -> bool:
    match message:
        case m.Play(is_playing=is_playing):
            viewer.play(is_playing)
        case m.Advance(frames=frames):
            viewer.advance(frames)
        case m.SetTime(time=time, is_scrubbing=is_scrubbing):
            viewer.set_time(time, is_scrubbing=is_scrubbing)
        case m.SetRange(start=start, end=end):
            viewer.timeline.set_range(start, end)
            viewer.set_time(viewer.timeline.current)
        case _:
            return False
    return True


def _set_look(viewer: Viewer, message: m.Message) -> bool:
    match message:
        case m.SetAov(name=name):
            _check_aov(name)
            viewer.set_look(aov=name)
        case m.SetSetting(name=name, value=value):
            settings = with_setting(viewer.state.look.settings, name, value)
            _check_names_no_file(settings)
            viewer.set_look(settings=settings)
        case m.SetDisplay(name=name, value=value):
            display = with_value(viewer.state.display, name, value)
            viewer.set_display(**{name: getattr(display, name)})
        case m.SetOther(aov=None):
            viewer.set_other(None)
        case m.SetOther(aov=str(aov), time=time):
            _check_aov(aov)
            before = viewer.state.other or viewer.state.look
            viewer.set_other(replace(before, aov=aov, time=time))
        case m.SetWipe(part=part):
            viewer.set_wipe(part)
        case _:
            return False
    return True


def _change_bookmarks(viewer: Viewer, message: m.Message) -> bool:
    match message:
        case m.AddBookmark(name=name):
            name = name.strip()
            is_new = name not in {each.name for each in viewer.bookmarks}
            if is_new and len(viewer.bookmarks) >= MOST_BOOKMARKS:
                raise UsageError("bookmark", "one more", f"at most {MOST_BOOKMARKS}")
            viewer.add_bookmark(name)
        case m.RestoreBookmark(name=name):
            viewer.restore(name)
        case m.RemoveBookmark(name=name):
            viewer.remove(name)
        case _:
            return False
    return True


def _check_aov(name: str) -> None:
    if name not in AOVS and not is_light(name):
        raise UsageError("AOV", repr(name), f"one of {', '.join(AOVS)}")


def _check_names_no_file(settings: RenderSettings) -> None:
    """Raise an error for settings that would read a file of this machine's disks."""
    config = settings.ocio_config
    if config and not config.startswith("ocio://"):
        raise UsageError(
            "ocio_config", repr(config), "an ocio:// name; a file can only be set by $OCIO"
        )
