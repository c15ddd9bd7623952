"""Look at a stage, or a capture: a window with usdview's habits, or a page in a browser.

examples:
  usdsplat view scan.ply
      a capture, framed; drag with Alt to orbit, F frames, a click picks
  usdsplat view shot.usd --camera /World/Cam --frame 1010
      a stage, as a camera of it sees it at a frame
  usdsplat view
      an empty window to drop a file on
  usdsplat view grow.usda
      with a simulation on the stage: run it, and turn its knobs while it runs
  usdsplat view scan.ply --web
      the same in a browser, for machines without Qt or a display; prints the page's address
  usdsplat view shot.usd --web --no-open --port 8008
      over SSH: ssh -L 8008:127.0.0.1:8008 HOST, then open the address that is printed

notes:
  The window needs Qt: pip install usdsplat[view]. The page needs a browser, and nothing else.
  No file is changed: edits go to the session layer, which can be saved as a layer of its own.
  Whoever has the address of the page can do what the page can; it holds a key that is made up anew
  each time, and only this machine is listened to unless --allow-remote says otherwise.
"""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli.arguments import option, positional
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core.errors import BackendError, StageError, UnknownFormatError, UsageError

if TYPE_CHECKING:
    from usdsplat.preview.document import Document

LOOPBACK = "127.0.0.1"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
"""Any of these tells Qt on Linux where to show a window."""
INTERRUPTED = 130
"""What shells return after Ctrl-C."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WebOptions:
    """For a browser instead of a window."""

    web: Annotated[bool, option()] = False
    """serve a page rather than open a window"""
    host: Annotated[str, option("ADDRESS")] = LOOPBACK
    """to listen on; default: 127.0.0.1, this machine alone"""
    port: Annotated[int, option("N")] = 0
    """to listen on; default: any that is free"""
    no_open: Annotated[bool, option()] = False
    """only print the address, and open no browser"""
    allow_remote: Annotated[bool, option()] = False
    """let --host be one that other machines reach, unencrypted; an SSH tunnel is the better way"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat view`."""

    file: Annotated[Path | None, positional("[STAGE|CAPTURE]")] = None
    """stage or capture to look at; default: none yet, drop one on the window"""
    camera: Annotated[str | None, option("/PRIM")] = None
    """camera to begin with; default: one that frames everything"""
    frame: Annotated[float | None, option("FRAME")] = None
    """time code to begin at; default: the first of the stage's range"""
    axes: Annotated[str | None, option("AXES")] = None
    """of a capture: where its x, y and z point, such as rdf; default: as the file says"""
    device: Annotated[str, option("NAME")] = "auto"
    """what draws, auto, cpu or cuda; default: auto, the fastest here"""
    threads: Annotated[int | None, option("N")] = None
    """how many to use; default: all"""
    browser: WebOptions = field(default_factory=WebOptions)
    opening: StageOptions = field(default_factory=StageOptions)


def run(options: Options) -> int:
    """Show it until the window is closed, or Ctrl-C."""
    time_code(options.frame)
    _check_web(options)
    path = options.file
    if path is not None:
        _check_file(path, options)
        if options.browser.web:
            return _serve(_opener(path, options), options)
    _check_window()
    from usdsplat.preview.qt.app import run as run_window

    return run_window(
        None if path is None else _opener(path, options),
        camera=options.camera,
        time=options.frame,
        device=options.device,
        threads=options.threads,
    )


def _opener(path: Path, options: Options) -> Callable[..., Document]:
    """What opens the file, told by `publish` where news go; in the thread that has the stage."""
    from usdsplat.preview.opening import StageLoading, open_document

    opening = options.opening
    return partial(
        open_document,
        path,
        device=options.device,
        threads=options.threads,
        axes=options.axes,
        loading=StageLoading(
            variants=opening.variant,
            mute=opening.mute,
            mask=opening.mask,
            session_layer=opening.session_layer,
        ),
    )


def _serve(open_document: Callable[..., Document], options: Options) -> int:
    """Serve until Ctrl-C."""
    from usdsplat.preview.session import Session
    from usdsplat.preview.web.server import serve

    web = options.browser

    session = Session(lambda publish: open_document(publish=publish))
    folder = tempfile.TemporaryDirectory(prefix="usdsplat-")  # nobody else may look into it

    def ready(url: str) -> None:
        print(url, flush=True)
        if not web.no_open:
            webbrowser.open(_way_to(url, Path(folder.name)).as_uri())

    try:
        server = serve(
            session,
            host=web.host,
            port=web.port,
            allow_remote=web.allow_remote,
            camera=options.camera,
            time=options.frame,
            ready=ready,
        )
        try:
            server.wait()
        finally:
            server.close()
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        folder.cleanup()
        session.close()
    return 0


def _way_to(url: str, folder: Path) -> Path:
    """A file that leads a browser to an address, for other users can read what it is started with.

    Only who started this can read the file, which is gone in the end.
    """
    path = folder / "open.html"
    address = escape(url, quote=True)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(
            '<!doctype html><meta charset="utf-8"><title>usdsplat</title>'
            f'<meta http-equiv="refresh" content="0; url={address}">'
            f'<a href="{address}">usdsplat</a>\n'
        )
    return path


def _check_web(options: Options) -> None:
    """Refuse what belongs to the page where there is none, and a page of nothing."""
    from usdsplat.preview.web.guard import is_loopback

    web = options.browser
    if web.web:
        if options.file is None:
            raise UsageError("--web", "no STAGE", "one to serve")
        if not 0 <= web.port <= 65535:
            raise UsageError("--port", str(web.port), "0 to 65535")
        if not (web.allow_remote or is_loopback(web.host)):
            found = f"{web.host!r}, which other machines can reach, without encryption"
            raise UsageError("--host", found, "this machine and an SSH tunnel, or --allow-remote")
        return
    given = {
        "--host": web.host != LOOPBACK,
        "--port": web.port != 0,
        "--no-open": web.no_open,
        "--allow-remote": web.allow_remote,
    }
    for flag, is_given in given.items():
        if is_given:
            raise UsageError(flag, "no --web", "it, for there is nothing to listen otherwise")


def _check_file(path: Path, options: Options) -> None:
    """Refuse what is no stage and no capture, before a window is open and empty."""
    from usdsplat import formats
    from usdsplat.cli.stages import check_no_stage_options
    from usdsplat.interchange.files import SUFFIXES, is_usd

    if not path.exists():
        raise StageError(str(path), "no such file", "a stage or a capture")
    if is_usd(path):
        if options.axes is not None:
            raise UsageError("--axes", "a stage, which says where its axes point", "a capture")
        if not path.is_file():
            raise StageError(str(path), "no plain file", "a stage or a capture")
        return
    check_no_stage_options(path, options.opening)
    try:
        formats.find(path)
    except UnknownFormatError as error:
        expected = f"{error.expected}, {', '.join(SUFFIXES)}"
        raise UnknownFormatError(error.where, error.found, expected) from None


def _check_window() -> None:
    """Refuse where no window can be shown; each sentence names the page as a way out."""
    try:
        import PySide6.QtWidgets  # noqa: F401 - whether it loads
    except ModuleNotFoundError:
        expected = "'pip install usdsplat[view]', or --web for a page in a browser"
        raise BackendError("window", "no PySide6", expected) from None
    except ImportError as error:
        expected = "the libraries that Qt needs, or --web for a page in a browser"
        raise BackendError("window", str(error), expected) from None
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in SCREENS):
        expected = "one that $DISPLAY or $WAYLAND_DISPLAY names, or --web for a page in a browser"
        raise BackendError("window", "no display", expected)
