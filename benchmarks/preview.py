"""Measure the preview: pictures per second while orbiting, and latency.

    python -m benchmarks.preview [--seconds 5] [--million] [--soak 60] [CAPTURE ...]

A real session is driven as by a window: a new state every 1/60 s, of which the latest is drawn.
Latency is the time from the `look` of a state to its picture, for drawn states. `age` is the age of
the displayed picture when the next one arrives. `full` is the time from the last state, at rest, to
the final picture. A soak test changes times, looks, comparisons and sizes at random, and reports
memory and errors.
"""

from __future__ import annotations

import argparse
import gc
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pxr import Usd
from rich.table import Table

from benchmarks.report import Report
from benchmarks.scenes import CAPTURES, DATA, garden
from usdsplat import schema
from usdsplat.core import edit
from usdsplat.images.aovs import AOVS
from usdsplat.interchange import import_capture
from usdsplat.preview.camera import FreeCamera
from usdsplat.preview.document import Document
from usdsplat.preview.session import Session
from usdsplat.preview.values import (
    DisplaySettings,
    Event,
    Look,
    Opened,
    Picture,
    Problem,
    ViewState,
)
from usdsplat.render.memory import resident

SIZE = (960, 720)
TICK = 1 / 60
"""Time between states [s]."""
PATIENCE = 600.0
"""Time after which the session counts as hanging [s]."""
WARM = 1.0
"""Initial time of a drive that is not counted [s]: kernels are loaded, and quality settles."""
FPS, LATENCY_MS = 24.0, 150.0
"""Goals for pictures per second and latency."""
MILLION = 1_000_000


@dataclass
class Heard:
    """Events of a session, with their times."""

    pictures: list[tuple[float, Picture]] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)
    is_open: bool = False

    def __call__(self, event: Event) -> None:
        with self.changed:
            if isinstance(event, Picture):
                self.pictures.append((time.perf_counter(), event))
            elif isinstance(event, Problem):
                self.problems.append(event.sentence)
            elif isinstance(event, Opened):
                self.is_open = True
            self.changed.notify_all()

    def wait(self, is_there: Callable[[], bool]) -> None:
        def is_over() -> bool:
            return is_there() or (bool(self.problems) and not self.is_open)

        with self.changed:
            if not self.changed.wait_for(is_over, PATIENCE) or not is_there():
                raise SystemExit(" ".join(self.problems) or "the session does not answer")

    def wait_for_final(self, state: ViewState) -> float:
        """Return the time of the final picture of a state."""

        def is_it(picture: Picture) -> bool:
            return picture.is_final and picture.state is state

        self.wait(lambda: bool(self.pictures) and is_it(self.pictures[-1][1]))
        return self.pictures[-1][0]


def of_capture(name: str) -> Callable[[Callable[[Event], None]], Document]:
    """Return a function that opens a capture."""

    def opened(publish: Callable[[Event], None]) -> Document:
        stage = Usd.Stage.CreateInMemory()
        import_capture(DATA / "splats" / name, stage)
        return Document(stage, path=Path(name), publish=publish)

    return opened


def of_million() -> Callable[[Callable[[Event], None]], Document]:
    """Return a function that opens a million splats of the garden."""

    def opened(publish: Callable[[Event], None]) -> Document:
        cloud = garden(7)[0]
        stage = Usd.Stage.CreateInMemory()
        few = np.random.default_rng(0).permutation(len(cloud)) < MILLION
        schema.author(stage, "/Garden", edit.take(cloud, few))
        return Document(stage, publish=publish)

    return opened


def first_picture(session: Session, heard: Heard) -> float:
    """Return the time of the first final picture."""
    first = ViewState(size=SIZE)
    session.look(first)
    return heard.wait_for_final(first)


def framed(session: Session) -> FreeCamera:
    """Return a camera that frames the whole stage."""
    boxes: list[object] = []
    there = threading.Event()
    session.ask(lambda document: document.bounds(), lambda box: (boxes.append(box), there.set()))
    there.wait(PATIENCE)
    return FreeCamera().framing(boxes[0], aspect=SIZE[0] / SIZE[1]).orbited(0.0, 0.1)


@dataclass(frozen=True)
class Drive:
    """Results of an orbit."""

    fps: float
    scales: str
    latency: tuple[float, float]
    """Median and 95th percentile [ms]."""
    age: float
    """95th percentile [ms]."""
    full: float
    """Time to the final picture [ms]."""
    middle: int
    """Number of pictures before the final one."""
    ms: dict[str, float]
    """Mean times by stage."""
    splats: int


def orbit(session: Session, heard: Heard, seconds: float, aov: str = "color") -> Drive:
    """Orbit the stage, then rest."""
    camera = framed(session)
    state = ViewState(size=SIZE, camera=camera, look=Look(aov=aov), is_moving=True)
    asked: dict[int, float] = {}
    states: list[ViewState] = []
    heard.pictures.clear()
    began = time.perf_counter()
    tick = 0
    while time.perf_counter() - began < seconds:
        camera = camera.orbited(0.004, 0.001 * np.sin(0.05 * tick))
        state = replace(state, camera=camera)
        states.append(state)
        asked[id(state)] = time.perf_counter()
        session.look(state)
        tick += 1
        time.sleep(max(0.0, began + tick * TICK - time.perf_counter()))
    last = replace(state, is_moving=False)
    stopped = time.perf_counter()
    session.look(last)
    finished = heard.wait_for_final(last)
    moving = [
        (at, each) for at, each in heard.pictures if each.state.is_moving and at > began + WARM
    ]
    times = [at for at, _ in moving]
    waits = [1e3 * (at - asked[id(each.state)]) for at, each in moving]
    ages = [
        1e3 * (after - asked[id(each.state)])
        for (_, each), after in zip(moving, times[1:], strict=False)
    ]
    shares = Counter(each.scale for _, each in moving)
    books = [each.milliseconds for _, each in moving]
    return Drive(
        fps=(len(times) - 1) / (times[-1] - times[0]),
        scales=" ".join(
            f"{scale:g}:{count / len(moving):.0%}" for scale, count in sorted(shares.items())
        ),
        latency=(float(np.median(waits)), float(np.percentile(waits, 95))),
        age=float(np.percentile(ages, 95)),
        full=1e3 * (finished - stopped),
        middle=sum(not each.state.is_moving for _, each in heard.pictures) - 1,
        ms={name: float(np.mean([book.get(name, 0.0) for book in books])) for name in books[0]},
        splats=moving[-1][1].total,
    )


def at_random(session: Session, heard: Heard, seconds: float, seed: int = 0) -> int:
    """Change all properties of the view at random. Return the number of states."""
    rng = np.random.default_rng(seed)
    camera = framed(session)
    state = ViewState(size=SIZE, camera=camera)
    until, count = time.perf_counter() + seconds, 0
    while time.perf_counter() < until:
        camera = camera.orbited(*rng.normal(0, 0.01, 2)).dollied(float(rng.uniform(0.97, 1.031)))
        state = replace(state, camera=camera, is_moving=True)
        if rng.random() < 0.02:
            state = replace(state, look=Look(aov=str(rng.choice(list(AOVS)))))
        if rng.random() < 0.02:
            other = Look(aov=str(rng.choice(list(AOVS))), time=float(rng.integers(1, 5)))
            state = replace(state, other=other if rng.random() < 0.5 else None)
        if rng.random() < 0.05:
            state = replace(state, wipe=float(rng.random()), time=float(rng.integers(1, 5)))
        if rng.random() < 0.05:
            state = replace(state, display=DisplaySettings(exposure=float(rng.normal())))
        if rng.random() < 0.01:
            state = replace(state, size=tuple(int(each) for each in rng.integers(200, 1000, 2)))
        if rng.random() < 0.03:
            state = replace(state, is_moving=False)
        session.look(state)
        count += 1
        time.sleep(TICK if rng.random() < 0.97 else 0.4)
        with heard.changed:
            del heard.pictures[:-1]
    return count


def soak(name: str, seconds: float) -> None:
    """Run four equal random drives, after which the memory must not have grown."""
    heard = Heard()
    session = Session(of_capture(name))
    session.listen(heard)
    count, held = 0, []
    for _ in range(4):
        count += at_random(session, heard, 0.25 * seconds)
        session.look(ViewState(size=SIZE))
        gc.collect()
        held.append(f"{1e-6 * resident():.0f}")
    session.close()
    print(
        f"soak {name}, {seconds:g} s: {', '.join(held)} MB after each quarter; "
        f"{count} states, {len(heard.problems)} problems"
    )
    for sentence, times in Counter(heard.problems).items():
        print(f"  {times} x {sentence}")


class Lines:
    """The printed table."""

    def __init__(self) -> None:
        self._table = Table(title=f"orbiting at {SIZE[0]}×{SIZE[1]}, a state each 1/60 s")
        for name in (
            "scene", "AOV", "splats", "fps", "scale", "latency ms median", "95 %", "age 95 %",
            "full ms", "steps", "goals", "means by stage [ms]",
        ):  # fmt: skip
            self._table.add_column(name, justify="right")

    def add(self, name: str, aov: str, drive: Drive) -> None:
        """Add a line."""
        is_met = drive.fps >= FPS and drive.full <= LATENCY_MS
        stages = " ".join(f"{stage} {ms:.1f}" for stage, ms in drive.ms.items() if ms >= 0.5)
        self._table.add_row(
            name, aov, f"{drive.splats:,}", f"{drive.fps:.1f}", drive.scales,
            f"{drive.latency[0]:.0f}", f"{drive.latency[1]:.0f}", f"{drive.age:.0f}",
            f"{drive.full:.0f}", str(drive.middle), "met" if is_met else "not met", stages,
        )  # fmt: skip

    @property
    def table(self) -> Table:
        """Return the table."""
        return self._table


def main(report: Report) -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", nargs="*", default=CAPTURES)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--aov", default="color", choices=AOVS)
    parser.add_argument("--million", action="store_true")
    parser.add_argument("--soak", type=float, default=0.0, metavar="SECONDS")
    options = parser.parse_args(report.arguments)
    lines = Lines()
    scenes = {name: of_capture(name) for name in options.captures}
    if options.million:
        scenes["garden, 1 M"] = of_million()
    for name, opened in scenes.items():
        heard = Heard()
        began = time.perf_counter()
        session = Session(opened)
        session.listen(heard)
        seconds = first_picture(session, heard) - began
        print(f"{name}: first final picture after {seconds:.2f} s", flush=True)
        lines.add(name, options.aov, orbit(session, heard, options.seconds, options.aov))
        session.close()
        for sentence in heard.problems:
            print(f"  {sentence}")
    report.show(lines.table, 220)
    if options.soak:
        soak(options.captures[0], options.soak)


if __name__ == "__main__":
    with Report("preview", sys.argv[1:]) as report:
        main(report)
