"""Find out whether a window can be shown, before Qt is asked, which ends the process if not."""

from __future__ import annotations

import ctypes
import importlib
import os
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass

INSTEAD = "or --web for a page in a browser"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
"""Environment variables of which Qt on Linux needs at least one to show a window."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """A library of the system that Qt loads on Linux."""

    file: str
    debian: str
    """Package of Debian and its kin that has the library."""
    fedora: str
    """Package of Fedora and its kin."""


def _libraries(rows: Sequence[tuple[str, str, str]]) -> tuple[Library, ...]:
    """Return the libraries in rows of file, package of Debian, package of Fedora."""
    return tuple(Library(file=file, debian=deb, fedora=rpm) for file, deb, rpm in rows)


QT = _libraries(
    (
        ("libEGL.so.1", "libegl1", "libglvnd-egl"),
        ("libGL.so.1", "libgl1", "libglvnd-glx"),
        ("libxkbcommon.so.0", "libxkbcommon0", "libxkbcommon"),
        ("libfontconfig.so.1", "libfontconfig1", "fontconfig"),
        ("libdbus-1.so.3", "libdbus-1-3", "dbus-libs"),
    )
)
"""Libraries that Qt's widgets need in any case."""
XCB = _libraries(
    (
        ("libxcb-cursor.so.0", "libxcb-cursor0", "xcb-util-cursor"),
        ("libxcb-icccm.so.4", "libxcb-icccm4", "xcb-util-wm"),
        ("libxcb-image.so.0", "libxcb-image0", "xcb-util-image"),
        ("libxcb-keysyms.so.1", "libxcb-keysyms1", "xcb-util-keysyms"),
        ("libxcb-randr.so.0", "libxcb-randr0", "libxcb"),
        ("libxcb-render-util.so.0", "libxcb-render-util0", "xcb-util-renderutil"),
        ("libxcb-shape.so.0", "libxcb-shape0", "libxcb"),
        ("libxcb-xkb.so.1", "libxcb-xkb1", "libxcb"),
        ("libxkbcommon-x11.so.0", "libxkbcommon-x11-0", "libxkbcommon-x11"),
    )
)
"""Libraries that Qt needs for a window on X11."""


def obstacle() -> tuple[str, str] | None:
    """Return the reason why no window can be shown here, as (found, expected), or None."""
    try:
        importlib.import_module("PySide6")
    except ModuleNotFoundError:
        return "no PySide6", f"'pip install usdsplat[view]', {INSTEAD}"
    if sys.platform.startswith("linux"):
        if not any(os.environ.get(name) for name in SCREENS):
            return "no display", f"one that $DISPLAY or $WAYLAND_DISPLAY names, {INSTEAD}"
        if missing := missing_libraries():
            files = ", ".join(each.file for each in missing)
            return f"no {files}", f"'{installation(missing)}', {INSTEAD}"
    try:
        importlib.import_module("PySide6.QtWidgets")
    except ImportError as error:
        return str(error), f"the libraries that Qt needs, {INSTEAD}"
    return None


def missing_libraries() -> tuple[Library, ...]:
    """Return the libraries that Qt needs for a window on this display, and that are not there."""
    return tuple(each for each in (*QT, *(XCB if _is_x11() else ())) if not _loads(each.file))


def installation(missing: Sequence[Library]) -> str:
    """Return the command that installs libraries: Fedora's where its tool is, else Debian's."""
    is_fedora = shutil.which("dnf") is not None and shutil.which("apt-get") is None
    names = sorted({each.fedora if is_fedora else each.debian for each in missing})
    return f"{'dnf' if is_fedora else 'apt-get'} install {' '.join(names)}"


def _is_x11() -> bool:
    """Return whether Qt will show windows by X11."""
    if named := os.environ.get("QT_QPA_PLATFORM"):
        return named.startswith("xcb")
    return bool(os.environ.get("DISPLAY")) and not os.environ.get("WAYLAND_DISPLAY")


def _loads(file: str) -> bool:
    """Return whether the system's loader finds a library."""
    try:
        ctypes.CDLL(file)
    except OSError:
        return False
    return True
