"""A simulation that shows its frames on the stage as they come."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial

from pxr import Usd

from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live_layer import LiveLayer
from usdsplat.preview.simulating.watching import LiveRecipe, Watch
from usdsplat.sim.stage.simulating import Simulation, baked_fields

AHEAD = 240
"""Frames that are looked at beforehand where a stage has no range, to see what will be needed."""


class LiveRun(Job):
    """One run, from its beginning to its end or until it is stopped.

    It shows each frame of the stage's range; where there is none it goes on from 1 without an end.
    What begins to happen only after the first `AHEAD` frames of such a run is left out, and told.

    Args:
        host: Whose stage is simulated.
        device: Computes.
        changed: Called when there is something new to say.
        budget: As `LiveLayer` takes it.
        is_paced: Whether it goes no faster than the stage plays.
    """

    def __init__(
        self,
        host: Host,
        device: Device,
        changed: Callable[[], None],
        *,
        budget: float | None,
        is_paced: bool,
    ) -> None:
        super().__init__(host, device, changed)
        self.layer: LiveLayer | None = None
        """What is shown; for those who hold the stage's lock."""
        self.frame: float | None = None
        self.frames: tuple[float, float] | None = None
        self.end: float | None = None
        self.splats = 0
        self.seconds = 0.0
        self.message = ""
        self._budget, self._is_paced = budget, is_paced

    def work(self) -> None:
        """Implements `Job.work`."""
        with self._reading:
            watch = Watch(self._host.stage, self._refused)
        try:
            self._play(watch)
        finally:
            watch.close()

    def _play(self, watch: Watch) -> None:
        stage = self._host.stage
        with self._reading:
            first, self.end = span(stage)
            rate = stage.GetTimeCodesPerSecond()
        count = AHEAD if self.end is None else int(self.end - first) + 1
        simulation = Simulation(
            stage,
            [first + number for number in range(count)],
            device=self._device,
            reading=self._reading,
            kind=partial(LiveRecipe, watch=watch),
        )
        with self._reading:
            watch.begin(simulation)
            layer = LiveLayer(stage, baked_fields(simulation), budget=self._budget)
            self.layer = layer
        simulation.begin()
        remarks = "; ".join(simulation.remarks)
        due = began = time.perf_counter()
        held = self.gate.held
        for number in itertools.count() if self.end is None else range(count):
            if number:
                with self._reading:
                    watch.look()
                simulation.advance()
            shown = first + number
            values = [
                value
                for path in simulation.recipes
                for value in layer.made(path, simulation.frame(path))
            ]
            with self._reading:
                layer.write(shown, values)
            del values
            now = time.perf_counter()
            self.frame, self.frames = shown, layer.frames
            self.splats = sum(len(solver.state) for solver in simulation.solvers.values())
            self.seconds = now - began - (self.gate.held - held)
            self.message = watch.message or remarks
            self.gate.frame_done()
            self._host.wake()
            self._changed()
            if self._is_paced:
                due = max(due + 1 / rate, now)
                self.gate.rest(due - now)
            began, held = time.perf_counter(), self.gate.held
        self.message = "the last frame is done; Run begins anew"

    def _refused(self, error: StageError) -> None:
        """Wait until somebody has mended the stage, and says so by letting work go on."""
        self.failure = str(error)
        self.gate.hold()
        self._changed()
        self.gate.check()
        self.failure = ""
        self._changed()


def span(stage: Usd.Stage) -> tuple[float, float | None]:
    """First frame, and the last where the stage has a range [time code].

    Raises:
        StageError: If the range runs backwards.
    """
    if not stage.HasAuthoredTimeCodeRange():
        return 1.0, None
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not last >= first:
        where = stage.GetRootLayer().GetDisplayName()
        raise StageError(where, f"frames from {first:g} to {last:g}", "a range that runs forwards")
    return first, last
