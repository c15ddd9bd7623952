"""Drive a window for ten minutes, and fail if its memory or its threads grow.

    python -m benchmarks.soak [--minutes 10] [--splats 100000] [--json FILE]

A window without a display opens a capture, an animated stage and a splat tree in turn. Of each, the
view is orbited, time is scrubbed and played, a prim is moved and hidden and that is undone, looks
are changed, and two looks are compared while the view moves. After each minute, when the capture is
open and drawn in full, the table has the memory of the process, its threads, and its open files.
The first `WARM` minutes load and compile kernels and fill caches; after that nothing may grow.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from pxr import Usd, UsdGeom
from PySide6.QtWidgets import QApplication
from rich.table import Table

from benchmarks.leaks import Minute, growth
from benchmarks.report import Report
from benchmarks.scenes import garden
from benchmarks.window_latency import SIZE, TICK, Hand, Shown, wait
from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.freed import share_freed_memory
from usdsplat.interchange.lod import build_tree
from usdsplat.preview.opening import open_document
from usdsplat.preview.qt.window import Window
from usdsplat.preview.values import Look
from usdsplat.render.memory import resident
from usdsplat.render.settings import RenderSettings

LOOKS = (
    Look(aov="Z"),
    Look(aov="splatId"),
    Look(aov="N"),
    Look(settings=RenderSettings(display_mode="ellipses")),
    Look(settings=RenderSettings(sorting="rayHitDistance")),
    Look(),
)
"""Looks of a view at rest, in turn; the last one stays."""
FRAMES = 24
MOVES = 10
"""Steps by which a prim is dragged."""
DRAG, COMPARED, PLAYED = 2.0, 1.0, 1.0
"""Time of an orbit [s], of one that compares two looks, and of playback."""


def written(folder: Path, cloud: SplatCloud) -> list[Path]:
    """Write a capture, a stage whose two fields move, and a splat tree."""
    capture, moving, tree = (folder / name for name in ("a.ply", "b.usdc", "c.usda"))
    formats.write(cloud, capture)
    build_tree(capture, tree)
    stage = Usd.Stage.CreateNew(str(moving))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(FRAMES)
    few = edit.take(cloud, np.arange(len(cloud)) % 2 == 0)
    for name, way in (("A", 0.5), ("B", -0.5)):
        schema.author(stage, f"/{name}", few)
        move = UsdGeom.Xformable(stage.GetPrimAtPath(f"/{name}")).AddTranslateOp()
        for frame in (1, FRAMES):
            move.Set((way * frame / FRAMES, 0, 0), frame)
    stage.Save()
    return [capture, moving, tree]


class Visitor:
    """Somebody who uses a window."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self.opened, self.pictures = 0, 0

    def visit(self, path: Path) -> None:
        """Open a file and look at it in every way."""
        before = self._window.workspace
        self._window.open_with(partial(open_document, path))
        wait(lambda: self._window.workspace not in (None, before))
        self.opened += 1
        self._shown = Shown(self._window)
        self._rest()
        self._orbit(DRAG)
        viewer = self._shown.viewport.viewer
        if viewer.timeline.end > viewer.timeline.start:
            for frame in range(FRAMES):
                viewer.set_time(viewer.timeline.start + frame, is_scrubbing=True)
                self._pause(2 * TICK)
            viewer.end_move()
            self._rest()
            viewer.play()
            self._pause(PLAYED)
            viewer.play(False)
            self._rest()
        self._edit()
        for look in LOOKS:
            viewer.set_look(aov=look.aov, settings=look.settings)
            self._rest()
        viewer.set_other(replace(viewer.state.look, aov="Z"))
        self._orbit(COMPARED)
        viewer.set_other(None)
        self._rest()

    def _edit(self) -> None:
        """Move and hide the first prim that has a place, and undo both."""
        workspace, viewer = self._window.workspace, self._shown.viewport.viewer
        assert workspace is not None
        found: list[tuple[str, ...]] = []
        workspace.proxy.ask(lambda document: tuple(document.engine.drawn_paths()), found.append)
        wait(lambda: found)
        viewer.select(found[0][:1])
        wait(lambda: viewer.placement is not None)
        assert viewer.placement is not None
        matrix = np.reshape(viewer.placement.matrix, (4, 4)).copy()
        viewer.begin_drag()
        for _ in range(MOVES):
            matrix[0, 3] += 0.01
            viewer.place(tuple(matrix.ravel().tolist()))
            self._pause(TICK)
        viewer.end_move()
        self._rest()
        workspace.context.edit(lambda edits: edits.set_visible(found[0][0], False))
        self._rest()
        workspace.undo()
        workspace.undo()
        self._rest()
        viewer.select(())

    def minute(self) -> Minute:
        """Return the state of the process, and begin to count pictures anew."""
        self._pause(1.0)  # sessions of earlier documents end in threads of their own
        gc.collect()
        found = Minute(
            megabytes=1e-6 * resident(),
            threads=len(os.listdir("/proc/self/task")),
            files=len(os.listdir("/proc/self/fd")),
            opened=self.opened,
            pictures=self.pictures,
        )
        self.pictures = 0
        return found

    def _orbit(self, seconds: float) -> None:
        end = time.perf_counter() + seconds
        hand = Hand(self._shown)
        hand.drag(lambda began: time.perf_counter() > end)
        hand.let_go()
        self._rest()

    def _pause(self, seconds: float) -> None:
        due = time.perf_counter() + seconds
        wait(lambda: time.perf_counter() >= due)

    def _rest(self) -> None:
        """Wait for the full picture of the current state."""
        viewport = self._shown.viewport

        def is_there() -> bool:
            picture, state = viewport.picture, viewport.viewer.state
            return picture is not None and picture.is_final and picture.state == state

        wait(is_there)
        self.pictures += len(self._shown.pictures)
        self._shown.pictures.clear()


def main(report: Report) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--splats", type=int, default=100_000)
    options = parser.parse_args(report.arguments)
    share_freed_memory()  # as `usdsplat view` does
    application = QApplication.instance() or QApplication([])
    cloud = garden(5)[0]
    some = np.random.default_rng(0).permutation(len(cloud)) < options.splats
    window = Window()
    window.resize(*SIZE)
    window.show()
    visitor, minutes = Visitor(window), list[Minute]()
    with tempfile.TemporaryDirectory() as folder:
        capture, *others = written(Path(folder), edit.take(cloud, some))
        del cloud
        began = time.perf_counter()
        while len(minutes) < options.minutes:
            visitor.visit(capture)
            if time.perf_counter() - began >= 60.0 * (len(minutes) + 1):
                minutes.append(visitor.minute())
                print(minutes[-1], flush=True)
            for each in others:
                visitor.visit(each)
        window.leave()
        application.processEvents()
    table = Table(title="A window in use, at the end of each minute")
    for name in ("minute", "MB", "threads", "open files", "documents opened", "pictures"):
        table.add_column(name, justify="right")
    for number, each in enumerate(minutes, 1):
        table.add_row(
            f"{number}", f"{each.megabytes:,.0f}", f"{each.threads}", f"{each.files}",
            f"{each.opened}", f"{each.pictures:,}",
        )  # fmt: skip
    report.show(table)
    if grown := growth(minutes):
        raise SystemExit("\n".join(grown))
    report.say("Nothing has grown.")


if __name__ == "__main__":
    with Report("soak", sys.argv[1:]) as report:
        main(report)
