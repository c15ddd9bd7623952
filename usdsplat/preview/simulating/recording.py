"""Record a simulation to a bake while the preview runs, with the result of `usdsplat simulate`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from pxr import Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.output import Existing
from usdsplat.images.frame_numbers import LIMIT
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.gate import Stopped
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live import span
from usdsplat.sim.stage.extending import EARLY
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.simulating import Ending, SimulateOptions, simulate
from usdsplat.sim.stage.twins import twin


class Recording(Job):
    """One bake of the stage in its state at the start; later edits have no effect.

    Args:
        host: Document of the stage.
        device: Runs the kernels.
        changed: Called when status or message has changed.
        target, frames: See `simulate`; None takes the stage's range.
        existing: What to do with an existing bake.
        without: Identifiers of session layers to leave out.
        after: Stopped recordings to wait for, as they may still write to the same files.
    """

    def __init__(
        self,
        host: Host,
        device: Device,
        changed: Callable[[], None],
        *,
        target: Path,
        frames: Sequence[float] | None,
        existing: Existing,
        without: Sequence[str],
        after: Sequence[Job],
    ) -> None:
        super().__init__(host, device, changed)
        self.target = target
        self.frame: float | None = None
        self.end: float | None = None
        self.seconds = 0.0
        self.message = f"recording {target.name}"
        self._frames, self._existing = frames, existing
        self._left: Sequence[float] = ()
        self._last = 0.0
        self._after = after
        # Copied here, where the caller has the lock, so that the recorded state is the visible one.
        self._stage = twin(host.stage, without)

    def work(self) -> None:
        """Implement `Job.work`."""
        for each in self._after:
            each.join()
        frames = self._frames if self._frames is not None else _range(self._stage)
        self.end = frames[-1]
        self._left = frames
        report = simulate(
            self._stage,
            self.target,
            frames,
            SimulateOptions(
                device=self._device,
                existing=self._existing,
                ending=Ending(errors=(Stopped,), reading=self._host.lock),
            ),
            progress=self,
            reading=self._reading,
        )
        self.message = f"{self.target}: {report.sentence()}"

    def step(self, label: str, done: int, total: int) -> None:
        """Implement `Progress.step`: count the finished frames of those that remained at the
        start."""
        now = time.perf_counter()
        if label == "simulating" and done:
            frame = self._left[len(self._left) - total + done - 1]
            if frame != self.frame:
                self.frame, self.seconds = frame, now - self._last
                self.message = f"recording {self.target.name}: {done} of {total} frames"
                self.gate.frame_done()
                self._changed()
        self._last = now
        self.gate.check()

    @property
    def stopped(self) -> str:
        """Sentence about the result if the recording is stopped now."""
        done = "before its first frame" if self.frame is None else f"after frame {self.frame:g}"
        return f"{self.target}: stopped {done}; record to it again to resume"


def can_resume(target: Path) -> bool:
    """Return whether there is a bake that was stopped, and can be resumed: it has a checkpoint, or
    is whole with fewer frames than were asked for."""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(target), metadataOnly=True)
    except RuntimeError:  # pxr's error for a file that cannot be read
        return False
    record = read_record(layer)
    return record is not None and bool(record.get("checkpoint") or record.get(EARLY))


def _range(stage: Usd.Stage) -> list[float]:
    """Return the frames of a stage."""
    first, last = span(stage)
    if last is None or last - first >= LIMIT:
        found = "a stage without a range" if last is None else f"frames from {first:g} to {last:g}"
        raise UsageError("record", found, f"frames, at most {LIMIT}")
    return [first + number for number in range(int(last - first) + 1)]
