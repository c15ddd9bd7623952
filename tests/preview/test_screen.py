"""Tests of what is found out before a window is asked for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from usdsplat.preview import screen

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="libraries of Linux")


def without(monkeypatch, *names):
    """A system that lacks these libraries, and has all others."""

    def load(name):
        if name in names:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(screen.ctypes, "CDLL", load)


@pytest.fixture(autouse=True)
def x11(monkeypatch):
    """A display by X11, on a system with apt-get."""
    for name in screen.SCREENS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(screen.shutil, "which", lambda name: "there" if name == "apt-get" else None)


def test_missing_libraries_of_x_are_one_sentence_with_their_packages(monkeypatch):
    """Oracle: written out by hand from Debian's contents."""
    pytest.importorskip("PySide6")
    without(monkeypatch, "libxcb-cursor.so.0", "libxcb-keysyms.so.1")
    assert screen.obstacle() == (
        "no libxcb-cursor.so.0, libxcb-keysyms.so.1",
        "'apt-get install libxcb-cursor0 libxcb-keysyms1', or --web for a page in a browser",
    )


def test_fedora_has_other_packages(monkeypatch):
    """Oracle: written out by hand from Fedora's contents; one package has two of the libraries."""
    monkeypatch.setattr(screen.shutil, "which", lambda name: "there" if name == "dnf" else None)
    without(monkeypatch, "libxcb-randr.so.0", "libxcb-shape.so.0", "libEGL.so.1")
    missing = screen.missing_libraries()
    assert screen.installation(missing) == "dnf install libglvnd-egl libxcb"


@pytest.mark.parametrize(
    "name, value", [("QT_QPA_PLATFORM", "offscreen"), ("WAYLAND_DISPLAY", "wayland-0")]
)
def test_a_window_without_x_needs_no_libraries_of_x(monkeypatch, name, value):
    """Oracle: Qt's plug-ins of other platforms do not load them."""
    monkeypatch.setenv(name, value)
    without(monkeypatch, *(each.file for each in screen.XCB))
    assert screen.missing_libraries() == ()


def test_a_machine_without_a_display_is_told_so(monkeypatch):
    """Oracle: the sentence."""
    pytest.importorskip("PySide6")
    monkeypatch.delenv("DISPLAY")
    found = screen.obstacle()
    assert found is not None and found[0] == "no display"


def test_the_libraries_are_those_that_qt_links():
    """Oracle: the dynamic section of Qt's X11 plug-in, read by ldd."""
    pyside = pytest.importorskip("PySide6")
    plugin = Path(pyside.__file__).with_name("Qt") / "plugins" / "platforms" / "libqxcb.so"
    linked = subprocess.run(["ldd", plugin], capture_output=True, text=True, check=True).stdout
    names = {line.split()[0] for line in linked.splitlines()}
    absent = {line.split()[0] for line in linked.splitlines() if "not found" in line}
    assert {each.file for each in screen.XCB} <= names
    assert absent <= {each.file for each in (*screen.QT, *screen.XCB)}
