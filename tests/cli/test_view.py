"""Tests of `usdsplat view`: errors before a window opens, serving and ending."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest


@pytest.fixture
def _no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
@pytest.mark.usefixtures("_no_display")
def test_without_a_display_the_way_out_is_the_page(run, capture):
    """Oracle: one sentence, status 2."""
    status, out, err = run("view", capture)
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: window: found no display, expected ")
    assert "--web" in err


def test_without_qt_the_ways_out_are_the_extra_and_the_page(run, capture, monkeypatch):
    """Oracle: one sentence, status 2."""
    monkeypatch.setitem(sys.modules, "PySide6", None)
    status, out, err = run("view", capture)
    assert (status, out) == (2, "")
    assert err == (
        "usdsplat: window: found no PySide6, expected 'pip install usdsplat[view]', or --web for "
        "a page in a browser\n"
    )


@pytest.mark.parametrize("web", [(), ("--web", "--no-open")])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.ply", "found no such file, expected a stage or a capture"),
        ("none.usd", "found no such file, expected a stage or a capture"),
        ("folder.usda", "found no plain file, expected a stage or a capture"),
        ("folder", "found a directory without meta.json, expected a capture"),
        ("text.txt", "found suffix '.txt', expected one of .compressed.ply"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused_before_anything_is_shown(
    run, tmp_path, name, words, web
):
    """Oracle: where: found X, expected Y, status 2, and no address printed."""
    for folder in ("folder", "folder.usda"):
        (tmp_path / folder).mkdir()
    (tmp_path / "text.txt").write_text("words")
    status, out, err = run("view", tmp_path / name, *web)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {tmp_path / name}: {words}")
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (("--port", 8008), "--port: found no --web"),
        (("--host", "0.0.0.0"), "--host: found no --web"),
        (("--no-open",), "--no-open: found no --web"),
        (("--allow-remote",), "--allow-remote: found no --web"),
        (("--web", "--port", 65536), "--port: found 65536, expected 0 to 65535"),
        (("--frame", "nan"), "--frame: found nan"),
        (("--variant", "/A:b=c"), "--variant: found a capture, "),
    ],
)
def test_options_that_cannot_be_meant_are_refused(run, capture, argv, words):
    """Oracle: where: found X, expected Y, status 2."""
    status, out, err = run("view", capture, *argv)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {words}")


def test_an_internal_error_of_a_window_is_in_the_terminal(run, monkeypatch, capsys):
    """Oracle: the exception's own words on stderr, where the window's message points; and none
    after the command has ended."""
    pytest.importorskip("PySide6")
    from usdsplat.cli import view
    from usdsplat.preview.qt import app
    from usdsplat.preview.session import LOG

    def window(*arguments: object, **options: object) -> int:
        try:
            raise TypeError("a bug of this test")
        except TypeError:
            LOG.exception("a bug in the preview")
        return 0

    monkeypatch.setattr(view, "_check_window", lambda: None)
    monkeypatch.setattr(app, "run", window)
    status, _, err = run("view")
    assert status == 0 and "TypeError: a bug of this test" in err
    LOG.error("later")
    assert "later" not in capsys.readouterr().err


def test_axes_are_for_captures(run, shot):
    """Oracle: the sentence that render has for it."""
    status, _, err = run("view", shot, "--axes", "rdf")
    assert (status, err) == (2, run("render", shot, "--axes", "rdf", "-o", "a.png")[2])


def test_a_page_of_nothing_is_refused(run):
    """Oracle: a page has no drop."""
    status, _, err = run("view", "--web")
    assert status == 2
    assert err.startswith("usdsplat: --web: found no STAGE, expected one to serve")


def test_an_address_that_others_reach_has_to_be_wanted(run, capture):
    """Oracle: loopback is the default, and the only address without another word."""
    status, out, err = run("view", capture, "--web", "--no-open", "--host", "0.0.0.0")
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: --host: found '0.0.0.0', which other machines can reach")
    assert "--allow-remote" in err
    assert len(err.splitlines()) == 1


LISTENING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background has none
from usdsplat.cli.supervise import entry
sys.exit(entry())
"""


@contextmanager
def viewing(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A process of the command, which hears Ctrl-C and does not outlive the test."""
    process = subprocess.Popen(
        [sys.executable, "-c", LISTENING, "view", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_page_is_served_until_a_signal(capture, number):
    """Oracle: what a browser gets at the address that was printed; 128 + the signal, and no
    word."""
    with viewing(str(capture), "--web", "--no-open") as process:
        assert process.stdout is not None and process.stderr is not None
        url = process.stdout.readline().strip()
        try:
            with urllib.request.urlopen(url, timeout=60) as page:
                assert page.status == 200
                assert b"<!doctype html>" in page.read(200).lower()
        finally:
            process.send_signal(number)
        assert process.wait(60) == 128 + number
        assert (process.stdout.read(), process.stderr.read()) == ("", "")


@pytest.mark.skipif(os.name == "nt", reason="signals and modes of Unix")
def test_a_browser_is_led_to_the_page_by_a_file_that_nobody_else_reads(capture, tmp_path):
    """Oracle: what `ps` shows of a browser's arguments has no key in it; the file has, for its
    owner alone, and is gone in the end."""
    told = tmp_path / "told"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" > {told}.part\nmv {told}.part {told}\nsleep 2\n')
    browser.chmod(0o755)
    with viewing(str(capture), "--web", BROWSER=f"{browser} %s") as process:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        try:
            deadline = time.monotonic() + 60
            while not told.exists():
                assert time.monotonic() < deadline
            argument = told.read_text().strip()
            path = Path(url2pathname(urlsplit(argument).path))
            assert urlsplit(url).path.strip("/") not in argument
            assert url in path.read_text()
            assert (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777) == (
                0o600,
                0o700,
            )
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        assert not path.parent.exists()
