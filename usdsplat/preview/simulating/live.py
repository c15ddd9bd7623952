"""A simulation whose frames are drawn as they are computed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial

from pxr import Sdf, Usd

from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live_layer import LiveLayer
from usdsplat.preview.simulating.watching import LiveRecipe, Watch
from usdsplat.sim.stage.refinement import Refining
from usdsplat.sim.stage.simulation import Simulation, baked_fields
from usdsplat.sim.stage.twins import in_session, leave_session

AHEAD = 240
"""Number of frames examined in advance if a stage has no range, to prepare the solver."""


class LiveRun(Job):
    """A simulation run, from its start to its end or until it is stopped.

    It computes each frame of the stage's range, or without one runs from 1 without an end. Features
    that are first needed after the first `AHEAD` frames of such a run are left out and reported.

    Args:
        host: Document of the stage.
        device: Computes.
        changed: Called when the status changes.
        budget: As for `LiveLayer`.
        is_paced: Whether it is limited to the stage's playback rate.
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
        """The frames; access only with the stage's lock."""
        self.refined: Sdf.Layer | None = None
        """Layer of refined captures, below that of the frames."""
        self.frame: float | None = None
        self.frames: tuple[float, float] | None = None
        self.end: float | None = None
        self.splats = 0
        self.seconds = 0.0
        self.message = ""
        self._budget, self._is_paced = budget, is_paced

    @property
    def layers(self) -> list[str]:
        """Identifiers of the layers that the run adds to the session."""
        own = self.layer.identifier if self.layer else ""
        refined = self.refined.identifier if self.refined else ""
        return [name for name in (own, refined) if name]

    def remove(self) -> None:
        """Remove these layers; requires the stage's lock."""
        if self.layer is not None:
            self.layer.remove()
        if self.refined is not None:
            leave_session(self._host.stage, self.refined)

    def work(self) -> None:
        """Implement `Job.work`."""
        with self._reading:
            watch = Watch(self._host.stage, self._refused)
        try:
            self._play(watch)
        except Exception:
            if self.layer is not None:  # what was computed stays
                with self._reading:
                    self.layer.author()
            raise
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
            refining=Refining(compose=self._compose),
        )
        with self._reading:
            watch.begin(simulation)
            layer = LiveLayer(stage, baked_fields(simulation), budget=self._budget)
            self.layer = layer
        simulation.begin()
        remarks = "; ".join(found.told for found in simulation.findings)
        due = began = time.perf_counter()
        held = self.gate.held
        for number in itertools.count() if self.end is None else range(count):
            if number:
                with self._reading:
                    watch.look()
                simulation.advance()
            shown = first + number
            layer.put(shown, {path: simulation.frame(path) for path in simulation.recipes})
            is_last = self.end is not None and number == count - 1
            if layer.is_empty or layer.is_over or is_last or not self.gate.is_endless:
                with self._reading:
                    if layer.is_over and not (layer.is_empty or is_last):
                        layer.trim()
                    else:
                        layer.author()
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
        self.message = "the last frame is done; Run starts again"

    def _compose(self, stage: Usd.Stage, layer: Sdf.Layer) -> Usd.Stage:
        """Show refined captures on the stage."""
        self.refined = layer
        return in_session(stage, layer)

    def _refused(self, error: StageError) -> None:
        """Report an error and wait until work is resumed after the stage is fixed."""
        self.failure = str(error)
        self.gate.hold()
        self._changed()
        self.gate.check()
        self.failure = ""
        self._changed()


def span(stage: Usd.Stage) -> tuple[float, float | None]:
    """Return the first frame, and the last if the stage has a range [time code].

    Raises:
        StageError: If the range runs backwards.
    """
    if not stage.HasAuthoredTimeCodeRange():
        return 1.0, None
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not last >= first:
        where = stage.GetRootLayer().GetDisplayName()
        raise StageError(where, f"frames from {first:g} to {last:g}", "an ascending range")
    return first, last
