"""Record a simulation to a bake, with the bytes of `usdsplat simulate`, while it is shown."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.output import Existing
from usdsplat.images.frame_numbers import LIMIT
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.gate import Stopped
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live import span
from usdsplat.preview.simulating.shown_job import ShownJob
from usdsplat.sim.stage.extending import EARLY
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.simulating import Ending, SimulateOptions, simulate
from usdsplat.sim.stage.simulation import Simulation, baked_fields
from usdsplat.sim.stage.twins import twin
from usdsplat.sim.state import Frame


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is recorded, and where to; see `simulate`."""

    target: Path
    frames: Sequence[float] | None
    """None takes the stage's range."""
    existing: Existing
    """What to do with an existing bake."""


class Recording(ShownJob):
    """One bake of the stage in its state at the start; later edits have no effect.

    Its frames are shown on the host's stage.

    Args:
        host: Document of the stage.
        device: Runs the kernels.
        changed: Called when status or message has changed.
        asked: What is recorded.
        without: Identifiers of session layers to leave out.
        budget: As for `LiveLayer`.
        after: Stopped recordings to wait for, as they may still write to the same files.
    """

    def __init__(
        self,
        host: Host,
        device: Device,
        changed: Callable[[], None],
        *,
        asked: Asked,
        without: Sequence[str],
        budget: float | None,
        after: Sequence[Job],
    ) -> None:
        super().__init__(host, device, changed, budget=budget)
        self.target = target = asked.target
        self.message = f"recording {target.name}"
        self.is_whole = False
        """Whether the bake has all frames that were asked for."""
        self._frames, self._existing = asked.frames, asked.existing
        self._every: Sequence[float] = ()
        self._left: Sequence[float] = ()
        self._told: float | None = None
        """Last frame whose end was reported."""
        self._last = 0.0
        self._done: int | None = None
        """Number of frames in the bake, once it is over."""
        self._shows = True
        self._after = after
        # Copied here, where the caller has the lock, so that the recorded state is the visible one.
        self._stage = twin(host.stage, without)

    def work(self) -> None:
        """Implement `Job.work`."""
        for each in self._after:
            each.join()
        frames = self._frames if self._frames is not None else _range(self._stage)
        self.end = frames[-1]
        self._every = self._left = frames
        report = simulate(
            self._stage,
            self.target,
            frames,
            SimulateOptions(
                device=self._device,
                existing=self._existing,
                seen=self._seen,
                ending=Ending(errors=(Stopped,), reading=self._host.lock),
            ),
            progress=self,
            reading=self._reading,
        )
        self.is_whole = report.is_finished
        self.message = f"{self.target}: {report.sentence()}"

    def stop(self) -> None:
        """End the recording; its bake becomes whole with the frames so far, which stay visible."""
        self.message = f"finishing {self.target.name}"
        self.gate.stop()

    def _stopped(self) -> None:
        """Say what was recorded, and show all of it."""
        super()._stopped()
        if self.frame is not None or self._existing == "resume":
            self._done = _completed(self.target)
        self.message = self.stopped
        with self._host.lock:
            if self._is_removed:
                return
            if self.layer is not None:
                self.layer.author()
        self._changed()

    def step(self, label: str, done: int, total: int) -> None:
        """Implement `Progress.step`: count the finished frames of those that remained at the
        start."""
        now = time.perf_counter()
        if label == "simulating" and done:
            frame = self._left[len(self._left) - total + done - 1]
            if frame != self._told:
                self._told, self.seconds = frame, now - self._last
                self.message = f"recording {self.target.name}: {done} of {total} frames"
                self.gate.frame_done()
                self._changed()
        self._last = now
        self.gate.check()

    @property
    def goes(self) -> bool:
        """Whether it is at work, or finishes its bake."""
        return self.gate.is_open or self.gate.is_stopped

    @property
    def count(self) -> tuple[int, int]:
        """Number of frames in the bake, and of those that were asked for."""
        if self.is_whole:
            return len(self._every), len(self._every)
        if self._done is not None:
            return self._done, len(self._every)
        done = 0 if self.frame is None else list(self._every).index(self.frame) + 1
        return done, len(self._every)

    @property
    def has_bake(self) -> bool:
        """Whether it is over and has left a bake."""
        return self.is_over and not self.failure and self.count[0] > 0

    def _seen(self, simulation: Simulation, time: float, frames: Mapping[str, Frame]) -> None:
        """Show a frame that was recorded, on the host's stage, which may have changed meanwhile.

        What cannot be shown there is recorded all the same.
        """
        if self._shows:
            try:
                self._show_recorded(simulation, time, frames)
            except Exception as error:  # whatever the edits of the stage lead to
                self._hide(error)
        self.frame = time
        self.splats = sum(len(solver.state) for solver in simulation.solvers.values())
        self._host.wake()

    def _show_recorded(
        self, simulation: Simulation, time: float, frames: Mapping[str, Frame]
    ) -> None:
        if self.layer is None:
            with self._reading:
                refined = simulation.refinement.layer
                if refined is not None:
                    self._compose(self._host.stage, refined)
                self._open_layer(baked_fields(simulation))
        self._show(time, frames, is_last=time == self._every[-1])

    def _hide(self, error: Exception) -> None:
        """Show no frames any more, after an error."""
        self._shows, self.frames = False, None
        self.notes = (*self.notes, f"frames are recorded, but not shown: {error}")
        with self._reading:
            layer, self.layer = self.layer, None
            if layer is not None and not self._is_removed:
                layer.remove()

    @property
    def stopped(self) -> str:
        """Sentence about the result if the recording is stopped now."""
        frame = self._every[self._done - 1] if self._done else self.frame
        done = "before its first frame" if frame is None else f"after frame {frame:g}"
        return f"{self.target}: stopped {done}; record to it again to resume"


def can_resume(target: Path) -> bool:
    """Return whether there is a bake that was stopped, and can be resumed: it has a checkpoint, or
    is whole with fewer frames than were asked for."""
    record = _record(target)
    return bool(record.get("checkpoint") or record.get(EARLY))


def _completed(target: Path) -> int:
    """Return the number of frames in a bake; a resumed one also has those from before."""
    return int(_record(target).get("completedFrames", 0))


def _record(target: Path) -> Mapping[str, Any]:
    """Return the record of a bake; an empty one if there is none."""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(target), metadataOnly=True)
    except RuntimeError:  # pxr's error for a file that cannot be read
        return {}
    return read_record(layer) or {}


def _range(stage: Usd.Stage) -> list[float]:
    """Return the frames of a stage."""
    first, last = span(stage)
    if last is None or last - first >= LIMIT:
        found = "a stage without a range" if last is None else f"frames from {first:g} to {last:g}"
        raise UsageError("record", found, f"frames, at most {LIMIT}")
    return [first + number for number in range(int(last - first) + 1)]
