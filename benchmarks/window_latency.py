"""Measure how soon a window answers: the first picture, the sharp one, pictures per second.

    python -m benchmarks.window_latency [--seconds 3] [--times 8] [--scene NAME ...] [--json FILE]

USDSPLAT_THREADS sets the number of threads. A real window without a display gets mouse events 60
times a second, as from a person who drags the view. Times count from the event to the end of the
painting that shows it.

    idle     the first picture of a movement that begins when nothing is drawn
    busy     the same while the full picture is drawn; the movement begins anywhere in it
    sharp    the full picture, from the release of the button
    gap      the longest time between two pictures of a movement, 95th percentile
    scale    median pixels of the viewport per side of a drawn pixel, while dragging
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from pxr import Usd
from PySide6.QtCore import QEvent, QEventLoop, QObject, QPointF, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication
from rich.table import Table

from benchmarks.report import Report, spread
from benchmarks.scenes import garden
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.wording import counted
from usdsplat.interchange.lod import build_tree
from usdsplat.kernels.device import usual_threads
from usdsplat.preview.document import Document
from usdsplat.preview.opening import open_document
from usdsplat.preview.qt.opening_again import Opener
from usdsplat.preview.qt.window import Window
from usdsplat.preview.values import Picture, ViewState

SIZE = (1600, 980)
"""Size of the window; its viewport has about half of the pixels."""
TICK = 1 / 60
"""Time between mouse events [s]."""
STEP = 5.0
"""Way of the pointer between two events [pixel]."""
COLUMNS = ("scene", "idle", "busy", "sharp", "pictures/s", "gap", "scale")
PATIENCE = 600.0
"""Time after which the window counts as hanging [s]."""


@dataclass
class Shown(QObject):
    """Pictures that the viewport painted, with their times."""

    window: Window
    pictures: list[tuple[float, Picture]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        assert self.window.workspace is not None
        self.viewport = self.window.workspace.viewport
        self.viewport.installEventFilter(self)
        self._asked: dict[int, tuple[float, ViewState]] = {}
        self.viewport.viewer.listen(self._note)

    def _note(self) -> None:
        state = self.viewport.viewer.state
        self._asked.setdefault(id(state), (time.perf_counter(), state))

    def moving_since(self, began: float) -> list[float]:
        """Return when pictures of a movement were painted that were asked for since a time."""
        return [
            at
            for at, each in self.pictures
            if each.state.is_moving and self._asked[id(each.state)][0] >= began
        ]

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint:
            QTimer.singleShot(0, self._painted)
        return False

    def _painted(self) -> None:
        picture = self.viewport.picture
        if picture is not None and (not self.pictures or self.pictures[-1][1] is not picture):
            self.pictures.append((time.perf_counter(), picture))


def wait(condition: Callable[[], object]) -> None:
    """Let the event loop run until something is so.

    One timer serves it: each QTimer.singleShot without a receiver costs PySide 6.12 some 70 bytes
    for ever, half a megabyte for each document of the soak.
    """
    until, loop, timer = time.perf_counter() + PATIENCE, QEventLoop(), QTimer()
    timer.timeout.connect(loop.quit)
    timer.start(1)
    while not condition():
        if time.perf_counter() > until:
            raise SystemExit("the window does not answer")
        loop.exec()


class Hand:
    """A hand that drags the view of a window with the left button and Alt."""

    def __init__(self, shown: Shown) -> None:
        self._shown, self._viewport = shown, shown.viewport
        self._place = QPointF(0.0, 0.0)

    def send(self, kind: QEvent.Type, buttons: Qt.MouseButton) -> None:
        """Send a mouse event at the current place."""
        none, left = Qt.MouseButton.NoButton, Qt.MouseButton.LeftButton
        button = none if kind == QEvent.Type.MouseMove else left
        there = self._viewport.mapToGlobal(self._place)
        alt = Qt.KeyboardModifier.AltModifier
        event = QMouseEvent(kind, self._place, there, button, buttons, alt)
        QApplication.sendEvent(self._viewport, event)

    def press(self) -> None:
        """Press the button in the middle."""
        self._place = QPointF(self._viewport.rect().center())
        self.send(QEvent.Type.MouseButtonPress, Qt.MouseButton.LeftButton)

    def move(self) -> None:
        """Move by one step."""
        self._place += QPointF(STEP, 0.0)
        self.send(QEvent.Type.MouseMove, Qt.MouseButton.LeftButton)

    def let_go(self) -> None:
        """Let the button go."""
        self.send(QEvent.Type.MouseButtonRelease, Qt.MouseButton.NoButton)

    def drag(self, is_over: Callable[[float], object]) -> float:
        """Press and move until something is so; return the time of the first move, which the
        function gets too."""
        self.press()
        began = time.perf_counter()
        tick = 0
        while not is_over(began):
            self.move()
            tick += 1
            wait(lambda due=began + tick * TICK: time.perf_counter() >= due)
        return began


@dataclass(frozen=True)
class Answer:
    """Latency of a window with one scene [ms]."""

    idle: list[float]
    busy: list[float]
    sharp: list[float]
    fps: float
    gap: float
    scale: float
    """Median pixels of the viewport per side of a drawn pixel, while dragging."""


def measure(window: Window, seconds: float, times: int) -> Answer:
    """Drag, rest, and begin anew while the full picture is drawn."""
    shown = Shown(window)
    hand, rng = Hand(shown), np.random.default_rng(0)

    def is_sharp() -> bool:
        return bool(shown.pictures) and shown.pictures[-1][1].is_final

    def rest() -> float:
        hand.let_go()
        began = time.perf_counter()
        shown.pictures.clear()
        wait(is_sharp)
        return 1e3 * (shown.pictures[-1][0] - began)

    def first() -> float:
        began = hand.drag(shown.moving_since)
        return 1e3 * (shown.moving_since(began)[0] - began)

    def drag(seconds: float) -> None:
        end = time.perf_counter() + seconds
        hand.drag(lambda began: time.perf_counter() > end and shown.moving_since(began))

    wait(lambda: shown.viewport.picture is not None and shown.viewport.picture.is_final)
    for _ in range(2):  # loads and compiles kernels, and lets the quality settle
        drag(1.5)
        rest()
    sharp, idle, busy = [], [], []
    for _ in range(times):
        shown.pictures.clear()
        idle.append(first())
        sharp.append(rest())
    for _ in range(times):
        drag(0.2)
        hand.let_go()
        due = time.perf_counter() + rng.uniform(0.0, 1e-3 * float(np.median(sharp)))
        wait(lambda due=due: time.perf_counter() >= due)
        busy.append(first())
        rest()
    shown.pictures.clear()
    drag(seconds)
    moving = [(at, each.scale) for at, each in shown.pictures if each.state.is_moving]
    rest()
    at = np.array([each for each, _ in moving])
    return Answer(
        idle=idle,
        busy=busy,
        sharp=sharp,
        fps=(len(at) - 1) / (at[-1] - at[0]),
        gap=1e3 * float(np.percentile(np.diff(at), 95)),
        scale=float(np.median([scale for _, scale in moving])),
    )


def of_garden(count: int) -> Opener:
    """Return a function that opens part of the garden."""

    def opened(publish: Callable[[object], None], **_: object) -> Document:
        cloud = garden(5)[0]
        few = np.random.default_rng(0).permutation(len(cloud)) < count
        stage = Usd.Stage.CreateInMemory()
        schema.author(stage, "/Garden", edit.take(cloud, few))
        return Document(stage, publish=publish)

    return opened


def tree_of_garden(folder: Path, count: int) -> Path:
    """Write a splat tree of part of the garden."""
    cloud = garden(5)[0]
    few = np.random.default_rng(0).permutation(len(cloud)) < count
    formats.write(edit.take(cloud, few), folder / "garden.ply")
    build_tree(folder / "garden.ply", folder / "tree.usda")
    return folder / "tree.usda"


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--scene", nargs="*", default=["100 k", "1 M", "tree"])
    options = parser.parse_args(report.arguments)
    application = QApplication.instance() or QApplication([])
    threads = counted(usual_threads(), "thread")
    table = Table(title=f"How soon a window answers, on {threads}: median (largest), in ms")
    for name in COLUMNS:
        table.add_column(name, justify="right")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.scene:
            window = Window()
            window.resize(*SIZE)
            window.show()
            if name == "tree":
                path = tree_of_garden(Path(folder), 1_000_000)
                window.open_with(partial(open_document, path))
            else:
                window.open_with(of_garden(100_000 if name == "100 k" else 1_000_000))
            wait(lambda window=window: window.workspace is not None)
            answer = measure(window, options.seconds, options.times)
            window.leave()
            table.add_row(
                name,
                *(
                    f"{np.median(each):.0f} ({max(each):.0f})"
                    for each in (answer.idle, answer.busy, answer.sharp)
                ),
                f"{answer.fps:.0f}", f"{answer.gap:.0f}", f"{answer.scale:g}",
            )  # fmt: skip
            report.add(device="cpu", scene=name, **spread(answer.busy))
    report.show(table)
    application.processEvents()


if __name__ == "__main__":
    with Report("window_latency", sys.argv[1:]) as report:
        main(report)
