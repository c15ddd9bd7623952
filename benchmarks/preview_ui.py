"""How long a window's thread is kept from running while a simulation grows a million splats.

    python -m benchmarks.preview_ui [SPLATS] [FRAMES]

A thread that wants to run every 5 ms stands for the window's; a second one draws each frame, as a
session does, and the simulation has its own. What is printed are the longest times that the first
had to wait, by phase, beside the longest of a process that wants the same and shares nothing with
them: that much is the machine's. Where a wait is long, it is said what ended it.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd
from rich.console import Console
from rich.table import Table

from benchmarks.simulated_frame import shot
from usdsplat.delegate.engine import Engine
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Event, SimulationStatus
from usdsplat.sim.stage.authoring import author

TICK = 0.005
"""[s]"""
LONG = 0.03
"""A wait that is worth a word [s]."""
SIZE = (480, 360)
CASES = {
    "degree 0, a pattern grows": (0, {}),
    "degree 0, splats are born": (0, {"growth:birthRate": 0.2}),
    "degree 3, a pattern grows": (3, {}),
    "degree 3, splats are born": (3, {"growth:birthRate": 0.2}),
}


class Ticker:
    """Wants to run every 5 ms, and remembers how late it was."""

    def __init__(self) -> None:
        self.phase = "idle"
        self.late: dict[str, list[float]] = {}
        self.seen: list[tuple[float, str, str]] = []
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._is_over = True
        self._thread.join()

    def _run(self) -> None:
        last = time.perf_counter()
        while not self._is_over:
            time.sleep(TICK)
            now = time.perf_counter()
            late = now - last - TICK
            self.late.setdefault(self.phase, []).append(late)
            if late > LONG:
                self.seen.append((late, self.phase, whereabouts()))
            last = time.perf_counter()


def whereabouts() -> str:
    """What the other threads are at."""
    me, found = threading.get_ident(), []
    names = {each.ident: each.name for each in threading.enumerate()}
    for ident, frame in sys._current_frames().items():
        name = names.get(ident, "?")
        if ident == me or name == "MainThread":
            continue
        lines: list[str] = []
        at: Any = frame
        while at is not None and len(lines) < 3:
            lines.append(f"{Path(at.f_code.co_filename).name}:{at.f_lineno}")
            at = at.f_back
        found.append(f"{name} {' < '.join(lines)}")
    return "; ".join(found)


def apart(worst: Synchronized[float], is_over: Synchronized[int]) -> None:
    """The same in a process of its own."""
    last = time.perf_counter()
    while not is_over.value:
        time.sleep(TICK)
        now = time.perf_counter()
        worst.value = max(worst.value, now - last - TICK)
        last = time.perf_counter()


class Window:
    """A document that is drawn whenever it is woken."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.stage = stage
        self.lock = threading.RLock()
        self.publish: Callable[[Event], None] = self._heard
        self.wake: Callable[[], None] = self._woken
        self.pictures = 0
        self.status = SimulationStatus(state="none")
        self.told = threading.Condition()
        self._is_stale, self._is_over = True, False
        self._thread = threading.Thread(target=self._draw, name="session", daemon=True)
        self._thread.start()

    def wait(self, so: Callable[[SimulationStatus], bool]) -> None:
        with self.told:
            self.told.wait_for(lambda: so(self.status))

    def close(self) -> None:
        self._is_over = True
        self._woken()
        self._thread.join()

    def _heard(self, event: Event) -> None:
        assert isinstance(event, SimulationStatus)
        with self.told:
            self.status = event
            self.told.notify_all()

    def _woken(self) -> None:
        with self.told:
            self._is_stale = True
            self.told.notify_all()

    def _draw(self) -> None:
        with Engine(self.stage, time=1.0) as engine:
            with self.lock:
                view = engine.view(resolution=SIZE)
            while not self._is_over:
                with self.told:
                    self.told.wait_for(lambda: self._is_stale)
                    self._is_stale = False
                    frame = self.status.frame
                with self.lock:
                    engine.set_time(frame or 1.0)
                    engine.sync()
                engine.picture(view, sync=False)
                self.pictures += 1


def measure(count: int, frames: int, degree: int, values: dict[str, Any], table: Table) -> None:
    """One case."""
    spawn = multiprocessing.get_context("spawn")
    worst, is_over = spawn.Value("d", 0.0), spawn.Value("i", 0)
    other = spawn.Process(target=apart, args=(worst, is_over))
    with tempfile.TemporaryDirectory() as folder:
        stage = shot(Path(folder), count, degree, "carrier", frames)
        author(stage.GetPrimAtPath("/Sim"), {"growth:rate": 0.01, **values})
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(1 + 2 * frames)
        stage.Save()
        window = Window(stage)
        runner = Runner(window)
        ticker = Ticker()
        other.start()
        began = time.perf_counter()
        for phase, act, so in (
            ("beginning", runner.run, lambda each: each.frame is not None),
            ("running", runner.run, lambda each: (each.frame or 0.0) >= frames),
            ("pausing", runner.pause, lambda each: each.state == "paused"),
            ("stepping", runner.step, lambda each: (each.frame or 0.0) > frames),
            ("resetting", runner.reset, lambda each: each.state == "ready"),
        ):
            ticker.phase = phase
            act()
            window.wait(so)
            spent, began = time.perf_counter() - began, time.perf_counter()
            late = np.array(ticker.late.get(phase) or [0.0])
            table.add_row(
                phase, f"{spent:.1f}", f"{1e3 * late.max():.0f}",
                f"{1e3 * np.percentile(late, 99):.0f}", str((late > 0.05).sum()),
                f"{1e3 * worst.value:.0f}", str(window.pictures),
            )  # fmt: skip
            worst.value = 0.0
        ticker.stop()
        runner.close()
        window.close()
    is_over.value = 1
    other.join()
    for late, phase, where in sorted(ticker.seen, reverse=True)[:8]:
        print(f"  {1e3 * late:.0f} ms, {phase}: {where}")


def main(count: int = 1_000_000, frames: int = 6, only: str = "") -> None:
    """Print a table for each case."""
    for name, (degree, values) in CASES.items():
        if only not in name:
            continue
        table = Table(title=f"{name}, {count:,} splats")
        for column in (
            "phase", "s", "longest wait [ms]", "99 %", "over 50 ms", "another process", "pictures",
        ):  # fmt: skip
            table.add_column(column, justify="left" if column == "phase" else "right")
        measure(count, frames, degree, values, table)
        Console().print(table)


if __name__ == "__main__":
    main(*(int(each) for each in sys.argv[1:3]), *sys.argv[3:4])
