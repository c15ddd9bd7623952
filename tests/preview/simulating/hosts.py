"""A document for tests of a runner, and functions that wait for its events."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pxr import Usd

from tests.sim.stage.scenes import save_shot
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Event, SimulationStatus

PATIENCE = 300.0
"""For a machine that compiles all kernels first [s]."""


class Host:
    """A stage with a lock, that remembers what was published of its simulation."""

    def __init__(self, stage: Usd.Stage) -> None:
        self.stage = stage
        self.lock = threading.RLock()
        self.events: list[SimulationStatus] = []
        self.wakes = 0
        self._told = threading.Condition()

    def publish(self, event: Event) -> None:
        if not isinstance(event, SimulationStatus):  # such as that kernels compile
            return
        with self._told:
            self.events.append(event)
            self._told.notify_all()

    def wake(self) -> None:
        self.wakes += 1

    def wait(self, so: Callable[[SimulationStatus], bool]) -> SimulationStatus:
        """The first status since the last wait that is so."""
        with self._told:
            while True:
                for number, event in enumerate(self.events):
                    if so(event):
                        del self.events[: number + 1]
                        return event
                assert self._told.wait(PATIENCE), "nothing came"

    def until(self, state: str) -> SimulationStatus:
        """Wait for a state."""
        return self.wait(lambda event: event.state == state)

    def reached(self, frame: float) -> SimulationStatus:
        """Wait for a frame."""
        return self.wait(lambda event: event.frame == frame)

    def ended(self) -> SimulationStatus:
        """Wait until the last frame is done."""
        return self.wait(lambda event: "the last frame" in event.message)


def shot(folder: Path, values: dict[str, Any], *, last: int = 6, count: int = 200) -> Usd.Stage:
    """A shot of `tests.sim.stage.scenes` with a range from frame 1."""
    path = save_shot(folder, values, count=count)
    stage = Usd.Stage.Open(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(last)
    stage.Save()
    return stage


@contextmanager
def running(stage: Usd.Stage, **options: Any) -> Iterator[tuple[Host, Runner]]:
    """A runner of a stage; frames come as fast as they can."""
    host = Host(stage)
    runner = Runner(host, **{"is_paced": False, **options})
    try:
        yield host, runner
    finally:
        runner.close()
