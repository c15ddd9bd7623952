"""Tests of what documents leave in a process when others are opened in their place."""

from __future__ import annotations

import ctypes
import gc
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from pxr import Usd
from PySide6.QtWidgets import QApplication

from benchmarks.window_latency import wait
from tests.preview.qt import windows
from tests.preview.qt.conftest import wait_until
from tests.schema.clouds import cloud
from usdsplat import schema
from usdsplat.core.freed import return_freed_memory

SESSION = "usdsplat session"

if TYPE_CHECKING:
    from usdsplat.preview.qt.window import Window

SPLATS, WARM, OPENED, SOME = 20_000, 4, 12, 4
"""Splats of a document; documents before the count begins, and after; and how many are counted
together: a picture more or less is in use from one to the next."""
MOST, MOST_BLOCKS = 100_000, 200
"""Bytes of the C library, and blocks of Python, that a document may leave. Its splats have 5 MB."""
WAITS = 400


class _Books(ctypes.Structure):
    """glibc's `struct mallinfo2`."""

    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]


def allocated() -> int:
    """Return the bytes that C libraries have allocated, NumPy's arrays among them."""
    gc.collect()
    return_freed_memory()
    library = ctypes.CDLL(None)
    library.mallinfo2.restype = _Books
    books = library.mallinfo2()
    return int(books.uordblks + books.hblkhd)


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="needs glibc's books of its memory"
)
def test_a_document_leaves_nothing_when_the_next_is_opened(window: Window, tmp_path: Path) -> None:
    """Oracle: the books of the C library and of Python, which count what is in use."""
    paths = [tmp_path / f"{name}.usdc" for name in "ab"]
    for path in paths:
        stage = Usd.Stage.CreateNew(str(path))
        schema.author(stage, "/Field", cloud(n=SPLATS))
        stage.Save()
    del stage

    left, blocks = [], []
    for number in range(WARM + OPENED):
        windows.opened(window, paths[number % 2])
        wait_until(lambda: sum(each.name == SESSION for each in threading.enumerate()) == 1)
        left.append(allocated())
        blocks.append(sys.getallocatedblocks())
    for books, most in ((left, MOST), (blocks, MOST_BLOCKS)):
        early, late = min(books[WARM : WARM + SOME]), min(books[-SOME:])
        assert late - early < most * (OPENED - SOME)


def test_waiting_for_a_window_leaves_nothing(application: QApplication) -> None:
    """Oracle: Python's count of its blocks; a soak waits some thousand times for each document."""
    turns = iter(range(WAITS))
    wait(lambda: next(turns) > WAITS // 2)
    before = sys.getallocatedblocks()
    wait(lambda: next(turns, None) is None)
    assert sys.getallocatedblocks() - before < WAITS // 8
