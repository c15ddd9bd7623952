"""Show a stage or a capture in a window similar to usdview's, or on a page in a browser.

examples:
  usdsplat view scan.ply
      a capture, framed; Alt-drag orbits, F frames, a click selects
  usdsplat view shot.usd --camera /World/Cam --frame 1010
      a stage through one of its cameras, at a frame
  usdsplat view
      an empty window; drop a file on it
  usdsplat view grow.usda
      a stage with a simulation; parameters can be changed while it runs
  usdsplat view scan.ply --web
      in a browser, for machines without Qt or a display; prints the page's address
  usdsplat view shot.usd --web --no-open --port 8008
      over SSH: ssh -L 8008:127.0.0.1:8008 HOST, then open the printed address

notes:
  The window needs Qt, the extra [view]. The page needs only a browser.
  No file is changed. Edits go to the session layer, which can be saved as a separate layer.
  Anyone with the address of the page can use all its functions. The address contains a key that is
  new each time. The server listens on this machine only; --host with --allow-remote opens it to
  others, without encryption.
"""

from __future__ import annotations

import logging
import os
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from usdsplat.cli import console
from usdsplat.cli.arguments import option, positional
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.stage_options import StageOptions
from usdsplat.cli.values import time_code
from usdsplat.core import interrupt
from usdsplat.core.errors import BackendError, StageError, UnknownFormatError, UsageError
from usdsplat.core.freed import share_freed_memory
from usdsplat.core.scratch import scratch_folder

if TYPE_CHECKING:
    from usdsplat.preview.document import Document

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True, kw_only=True)
class WebOptions:
    """Options of the page in a browser."""

    web: Annotated[bool, option()] = False
    """serve a page instead of opening a window"""
    host: Annotated[str, option("ADDRESS")] = LOOPBACK
    """address to listen on; default: 127.0.0.1, this machine only"""
    port: Annotated[int, option("N")] = 0
    """port to listen on; default: any free port"""
    no_open: Annotated[bool, option()] = False
    """print the address without opening a browser"""
    allow_remote: Annotated[bool, option()] = False
    """allow a --host that other machines can reach, without encryption; prefer an SSH tunnel"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Arguments of `usdsplat view`."""

    file: Annotated[Path | None, positional("[STAGE|CAPTURE]")] = None
    """stage or capture to show; default: an empty window"""
    camera: Annotated[str | None, option("/PRIM")] = None
    """first camera; default: one that frames everything"""
    frame: Annotated[float | None, option("FRAME")] = None
    """first time code; default: the start of the stage's range"""
    axes: Annotated[str | None, option("AXES")] = None
    """directions of a capture's x, y and z, such as rdf; default: auto: as stated in the file, else
    as its splats suggest, else rdf"""
    device: Annotated[str, option("NAME")] = "auto"
    """device that renders, auto, cpu or cuda; default: auto, the one that finishes first"""
    threads: Annotated[int | None, option("N")] = None
    """number of threads; default: USDSPLAT_THREADS, or all cores"""
    browser: WebOptions = field(default_factory=WebOptions)
    opening: StageOptions = field(default_factory=StageOptions)
    reporting: ReportingOptions = field(default_factory=ReportingOptions)


def run(options: Options, reporter: Reporter) -> int:
    """Show the file until the window is closed, or until Ctrl-C."""
    from usdsplat.interchange.files import is_usd

    share_freed_memory()
    time_code(options.frame)
    _check_web(options)
    path = options.file
    if path is not None:
        _check_file(path, options)
        if reporter.findings.is_strict and is_usd(path):
            _check_stage(path, options, reporter)
        if options.browser.web:
            try:
                with _bugs_in_the_terminal():
                    return _serve(_opener(path, options), options)
            except KeyboardInterrupt as error:  # the usual end of a server
                return interrupt.status(error)
    _check_window()
    from usdsplat.preview.qt.app import run as run_window

    with _bugs_in_the_terminal():
        return run_window(
            None if path is None else _opener(path, options),
            path=path,
            camera=options.camera,
            time=options.frame,
            device=options.device,
            threads=options.threads,
        )


@contextmanager
def _bugs_in_the_terminal() -> Iterator[None]:
    """Print tracebacks of internal errors, which end no session: windows and pages refer to them.

    Commands silence the log otherwise.
    """
    log, handler = logging.getLogger("usdsplat"), logging.StreamHandler()
    handler.setLevel(logging.ERROR)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


def _opener(path: Path, options: Options) -> Callable[..., Document]:
    """Return a function that opens the file. It is called in the thread of the stage, with
    `publish` as the receiver of news."""
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
    """Serve the page until Ctrl-C, or another signal that ends a process."""
    from usdsplat.preview.session import Session
    from usdsplat.preview.web.server import serve

    web = options.browser
    folder: Path

    def ready(url: str) -> None:
        console.say(url)
        if not web.no_open:
            webbrowser.open(_way_to(url, folder).as_uri())

    with ExitStack() as stack:
        session = Session(lambda publish: open_document(publish=publish))
        stack.callback(session.close)
        folder = stack.enter_context(scratch_folder())
        server = serve(
            session,
            host=web.host,
            port=web.port,
            allow_remote=web.allow_remote,
            camera=options.camera,
            time=options.frame,
            ready=ready,
        )
        stack.callback(server.close)
        server.wait()
    return 0


def _way_to(url: str, folder: Path) -> Path:
    """Write a file that redirects a browser to an address, and return its path.

    Other users can read the browser's command line, but not this file. It is removed at the end.
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
    """Raise an error for page options without --web, and for --web without a file."""
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
            raise UsageError(flag, "no --web", "--web, because only the page has an address")


def _check_file(path: Path, options: Options) -> None:
    """Raise an error for a file that is neither a stage nor a capture, before a window opens."""
    from usdsplat import formats
    from usdsplat.cli.stages import check_no_stage_options
    from usdsplat.interchange.files import SUFFIXES, is_usd

    if not path.exists():
        raise StageError(str(path), "no such file", "a stage or a capture")
    if is_usd(path):
        if options.axes is not None:
            raise UsageError("--axes", "a stage, which defines its own axes", "a capture")
        if not path.is_file():
            raise StageError(str(path), "no plain file", "a stage or a capture")
        return
    check_no_stage_options(path, options.opening)
    try:
        formats.find(path)
    except UnknownFormatError as error:
        expected = f"{error.expected}, {', '.join(SUFFIXES)}"
        raise UnknownFormatError(error.where, error.found, expected) from None


def _check_stage(path: Path, options: Options, reporter: Reporter) -> None:
    """Raise an error if a stage has findings when it is opened.

    Raises:
        StrictError: If there is an error or a warning.
    """
    from usdsplat.cli.stages import open_stage
    from usdsplat.products.checking import opening_findings

    stage = open_stage(path, options.opening, reporter)
    reporter.findings.extend(opening_findings(stage, options.frame))
    reporter.findings.check()


def _check_window() -> None:
    """Raise an error if no window can be shown."""
    from usdsplat.preview.screen import obstacle

    if (missing := obstacle()) is not None:
        raise BackendError("window", *missing)
