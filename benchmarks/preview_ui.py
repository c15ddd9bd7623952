"""Measure how long a window's thread is blocked while a simulation grows a million splats.

    python -m benchmarks.preview_ui [SPLATS] [FRAMES]

A thread that wakes every 5 ms represents the window's thread. A second thread draws each frame, as
a session does, and the simulation has its own. The table has the longest delays of the first thread
by phase, and these delays without the time in which it was ready but no processor was free, which
is common on busy machines; the system reports it. For long delays, it also has what the other
threads were doing at the end.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import garden
from usdsplat import schema
from usdsplat.core import edit
from usdsplat.delegate.engine import Engine
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Event, SimulationStatus
from usdsplat.sim.stage.presets import author_preset

TICK = 0.005
"""Interval of the thread [s]."""
LONG = 0.03
"""Delay from which details are reported [s]."""
SIZE = (480, 360)
LAST = 100


class Ticker:
    """Thread that wakes every 5 ms and records its delays."""

    def __init__(self) -> None:
        self.phase = "idle"
        self.late: dict[str, list[tuple[float, float]]] = {}
        """Delays of each phase, and the part of each that was not due to a lack of processors
        [s]."""
        self.seen: list[tuple[float, str, str]] = []
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._is_over = True
        self._thread.join()

    def _run(self) -> None:
        while not self._is_over:
            before, began = queued(), time.perf_counter()
            time.sleep(TICK)
            late = time.perf_counter() - began - TICK
            ours = max(0.0, late - (queued() - before))
            self.late.setdefault(self.phase, []).append((late, ours))
            if ours > LONG:
                self.seen.append((ours, self.phase, whereabouts()))


def whereabouts() -> str:
    """Return the current positions of the other threads."""
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


def queued() -> float:
    """Return the total time in which this thread was ready but no processor was free [s]; 0 if the
    system does not report it."""
    try:
        text = Path(f"/proc/self/task/{threading.get_native_id()}/schedstat").read_text()
    except OSError:  # not on Linux
        return 0.0
    return 1e-9 * int(text.split()[1])


class Window:
    """A document that is drawn whenever it is notified."""

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


def shot(folder: Path, count: int, degree: int) -> Usd.Stage:
    """Return a stage with the garden and the preset grow, which colours, moves and multiplies
    splats."""
    cloud = garden(3, degree=degree)[0]
    stage = Usd.Stage.CreateNew(str(folder / "capture.usdc"))
    schema.author(stage, "/Garden", edit.take(cloud, np.arange(len(cloud)) < count))
    stage.Save()
    author_preset("grow", stage, folder / "shot.usda", last=LAST)
    return Usd.Stage.Open(str(folder / "shot.usda"))


def measure(count: int, frames: int, degree: int) -> Table:
    """Measure one case by phase."""
    table = Table(title=f"degree {degree}, {count:,} splats")
    for column in (
        "phase", "s", "longest wait [ms]", "without the queue", "99 %", "over 50 ms",
        "pictures",
    ):  # fmt: skip
        table.add_column(column, justify="left" if column == "phase" else "right")
    with tempfile.TemporaryDirectory() as folder:
        stage = shot(Path(folder), count, degree)
        window = Window(stage)
        runner = Runner(window)
        ticker = Ticker()
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
            late, ours = np.array(ticker.late.get(phase) or [(0.0, 0.0)]).T
            table.add_row(
                phase, f"{spent:.1f}", f"{1e3 * late.max():.0f}", f"{1e3 * ours.max():.0f}",
                f"{1e3 * np.percentile(ours, 99):.0f}", str((ours > 0.05).sum()),
                str(window.pictures),
            )  # fmt: skip
            print(f"  {phase}: {spent:.1f} s", file=sys.stderr)
        ticker.stop()
        runner.close()
        window.close()
    for late, phase, where in sorted(ticker.seen, reverse=True)[:8]:
        print(f"  {1e3 * late:.0f} ms, {phase}: {where}", file=sys.stderr)
    return table


def main(report: Report, count: int = 1_000_000, frames: int = 6) -> None:
    """Print a table for each case. Small cases before load or compile the kernels."""
    for degree in (0, 3):
        measure(5_000, frames, degree)
        report.show(measure(count, frames, degree))


if __name__ == "__main__":
    with Report("preview_ui", sys.argv[1:]) as report:
        main(report, *map(int, report.arguments))
