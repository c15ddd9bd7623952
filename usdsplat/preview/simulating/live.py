"""A simulation whose frames are drawn as they are computed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial

from pxr import Usd

from usdsplat.core.errors import StageError
from usdsplat.core.finding_codes import CODES
from usdsplat.core.findings import Finding
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.job import Host
from usdsplat.preview.simulating.shown_job import ShownJob
from usdsplat.preview.simulating.watching import LiveRecipe, Watch
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.refinement import Refining
from usdsplat.sim.stage.simulation import Simulation, baked_fields

AHEAD = 240
"""Number of frames examined in advance if a stage has no range, to prepare the solver."""


class LiveRun(ShownJob):
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
        super().__init__(host, device, changed, budget=budget)
        self._is_paced = is_paced

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
            self._open_layer(baked_fields(simulation))
        simulation.begin()
        remarks = "; ".join(each.message for each in simulation.findings if is_loud(each))
        self.notes = tuple(note_of(each) for each in simulation.findings if not is_loud(each))
        due = began = time.perf_counter()
        held = self.gate.held
        for number in itertools.count() if self.end is None else range(count):
            if number:
                with self._reading:
                    watch.look()
                simulation.advance()
            shown = first + number
            is_last = self.end is not None and number == count - 1
            frames = {path: simulation.frame(path) for path in simulation.recipes}
            self._show(shown, frames, is_last=is_last)
            now = time.perf_counter()
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

    def _refused(self, error: StageError) -> None:
        """Report an error and wait until work is resumed after the stage is fixed."""
        self.failure = str(error)
        self.gate.hold()
        self._changed()
        self.gate.check()
        self.failure = ""
        self._changed()


def is_loud(found: Finding) -> bool:
    """Return whether a finding is about more than a choice that was made for the user."""
    return found.severity != "note"


def note_of(found: Finding) -> str:
    """Return what a note is about, in a sentence without paths."""
    text = CODES[found.code].meaning.replace(f"{NAMESPACE}:", "")
    return f"{text[0].upper()}{text[1:]}."


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
