"""Run, pause, step, reset and record the simulations of a document.

runner = Runner(document)
runner.run()                    # computes frames, and wakes the document, which draws them
runner.pause()                  # the frames so far are on the stage
runner.step()                   # one frame
runner.record("bake.usda")      # the same bits as `usdsplat simulate`
runner.stop()                   # the bake is whole, with the frames so far
runner.reset()                  # restores the stage
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Literal

from pxr import Sdf, Usd

from usdsplat.core.output import Existing
from usdsplat.delegate.live_clouds import LiveClouds
from usdsplat.kernels.devices import open_device
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live import LiveRun
from usdsplat.preview.simulating.recording import Asked, Recording
from usdsplat.preview.simulating.shown_job import ShownJob
from usdsplat.preview.values import SimulationStatus
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.recipe import find_simulations

State = Literal["none", "ready", "beginning", "running", "paused", "recording", "failed"]


class Runner:
    """Runner of the simulations of a document, in their own threads.

    All methods return at once and are called by one thread at a time, with or without the
    document's lock. Work is held and stopped between two kernels. `document.publish` is called with
    a `SimulationStatus` on every change, in any thread.

    A run computes every frame of the stage's range and stops there; without a range it runs from 1
    on. Edited parameters and transforms take effect at the solver's next step. Changes that a
    running solver cannot accept wait for `reset`, and the status lists them: uniform values, added
    or removed prims, and features that no frame of the range needed.

    Args:
        document: Document of the stage.
        device, threads: As for `open_device`.
        budget: Maximum memory of frames, as values and on the stage [byte]; beyond it the oldest
            are dropped. None is 2 GB, or a quarter of the free memory at the start of a run, if
            that is less.
        is_paced: Whether a run is limited to the stage's playback rate.

    Raises:
        BackendError: If the device is not usable here.
        UsageError: If `threads` is out of range.
    """

    def __init__(
        self,
        document: Host,
        *,
        device: str = "auto",
        threads: int | None = None,
        budget: float | None = None,
        is_paced: bool = True,
    ) -> None:
        self._document = document
        self._device = open_device(device, threads=threads, task="geometry")
        self._budget, self._is_paced = budget, is_paced
        self._telling = threading.RLock()
        self._live: LiveRun | None = None
        self._recording: Recording | None = None
        self._jobs: list[Job] = []
        self._message = ""
        self._simulations: list[Usd.Prim] = []
        self._exists = False
        self._begins: float | None = None
        """When the first simulation starts [time code], see `SimulationStatus.start`."""
        self._look()

    @property
    def status(self) -> SimulationStatus:
        """Current status."""
        live, recording = self._live, self._recording
        showing = self._shown()
        shown = showing.frames if showing else None
        if recording is not None and not recording.is_over:
            return SimulationStatus(
                state="recording" if recording.goes else "paused",
                frame=recording.frame,
                frames=shown,
                start=self._begins,
                end=recording.end,
                splats=recording.splats,
                seconds=recording.seconds,
                message=recording.message,
                notes=recording.notes,
                recorded=recording.count,
            )
        if recording is not None and recording.has_bake:
            return SimulationStatus(
                state="paused" if showing else "ready",
                frame=showing.frame if showing else None,
                frames=shown,
                start=self._begins,
                end=recording.end,
                splats=recording.splats,
                message=recording.message,
                notes=recording.notes,
                recorded=recording.count,
                bake=str(recording.target),
            )
        if live is None:
            failed = recording.failure if recording else ""
            told = recording.message if recording else self._message
            rest: State = "ready" if self._exists else "none"
            return SimulationStatus(
                state="failed" if failed else rest, start=self._begins, message=failed or told
            )
        failed = live.failure or (recording.failure if recording else "")
        return SimulationStatus(
            state="failed" if failed else _state_of(live),
            frame=live.frame,
            frames=shown,
            start=self._begins,
            end=live.end,
            splats=live.splats,
            seconds=live.seconds,
            message=failed or (recording.message if recording else live.message),
            notes=live.notes,
        )

    @property
    def is_recording(self) -> bool:
        """Whether a bake is in progress, held or not."""
        return self._recording is not None and not self._recording.is_over

    def run(self) -> None:
        """Start or continue; after the last frame or a failure, restart."""
        self._go_on(float("inf"))

    def step(self) -> None:
        """Compute one frame and pause; do nothing after the last."""
        job = self._current()
        if job is None or job.failure or not job.is_over:
            self._go_on(1)

    def pause(self) -> None:
        """Hold the current work: the recording if there is one, else the run."""
        job = self._current()
        if job is not None:
            job.gate.hold()
        self.author()
        self._tell()

    def reset(self) -> None:
        """End all work and restore the stage. A recording can be resumed."""
        self._end_recording()
        self._end_live()
        self._look()
        self._document.wake()
        self._tell()

    def stop(self) -> None:
        """End a recording; its bake becomes whole with the frames so far, which stay visible."""
        if self._recording is not None and not self._recording.is_over:
            self._recording.stop()
            self._tell()

    def record(
        self,
        path: Path | str,
        *,
        frames: Sequence[float] | None = None,
        existing: Existing = "error",
    ) -> None:
        """Bake to a file, from the first frame on, as `usdsplat simulate` does.

        The frames that are recorded are shown. A run is held meanwhile and continues with `run`
        afterwards, in place of them. The stage is recorded in its
        current state, including the session's edits; later edits are not included.

        Args:
            path: Result layer, a .usda.
            frames: Ascending frames, one apart [time code]; None is the stage's range.
            existing: What happens to an existing bake; "resume" continues it.
        """
        self._end_recording()
        if self._live is not None:
            self._live.gate.hold()
            self.author()
        with self._document.lock:
            recording = Recording(
                self._document,
                self._device,
                self._tell,
                asked=Asked(target=Path(path), frames=frames, existing=existing),
                without=self._live.layers if self._live else [],
                budget=self._budget,
                after=[each for each in self._jobs if isinstance(each, Recording)],
            )
        self._recording = recording
        self._start(recording)

    def shown_at(self, time: float | None) -> LiveClouds | None:
        """Return what to draw in place of the stage at a time; requires the stage's lock."""
        shown = self._shown()
        return None if shown is None or shown.layer is None else shown.layer.shown_at(time)

    def author(self) -> None:
        """Author the frames that were only drawn so far."""
        for job in (self._live, self._recording):
            if job is not None and job.layer is not None:
                with self._document.lock:
                    job.layer.author()

    def look(self, *, has_new_prims: bool = True) -> None:
        """Update whether the stage has simulations and when they start, after it has changed.

        Args:
            has_new_prims: Whether prims may have been added or removed, and not only edited.
        """
        before = self._exists, self._begins
        self._look(has_new_prims=has_new_prims)
        if (self._exists, self._begins) != before:
            self._tell()

    def close(self) -> None:
        """End all work and wait for it; the stage is restored."""
        self._end_recording()
        self._end_live()
        for job in self._jobs:
            job.join()
        self._device.close()

    # --- private ---------------------------------------------------------------------------

    def _go_on(self, frames: float) -> None:
        job = self._current()
        if job is not self._recording:
            self._end_recording()
        if job is None or job.is_over:
            self._end_live()
            job = self._live = LiveRun(
                self._document,
                self._device,
                self._tell,
                budget=self._budget,
                is_paced=self._is_paced,
            )
            job.gate.open(frames)
            self._start(job)
        else:
            job.gate.open(frames)
            self._tell()

    def _shown(self) -> ShownJob | None:
        """Return the job whose frames are shown."""
        recording = self._recording
        has_frames = recording is not None and recording.layer is not None
        return recording if has_frames else self._live

    def _current(self) -> Job | None:
        """Return the job that `run` and `pause` control."""
        return self._recording if self.is_recording else self._live

    def _start(self, job: Job) -> None:
        self._jobs = [each for each in self._jobs if not each.is_over]
        self._jobs.append(job)
        self._tell()
        job.start()

    def _end_recording(self) -> None:
        recording, self._recording = self._recording, None
        self._message = ""
        if recording is None:
            return
        if not recording.is_over:
            recording.gate.stop()
            self._message = recording.stopped
        with self._document.lock:
            recording.remove()

    def _end_live(self) -> None:
        """Stop a run and remove its frames from the stage."""
        live, self._live = self._live, None
        if live is not None:
            live.gate.stop()
            with self._document.lock:
                live.remove()

    def _look(self, *, has_new_prims: bool = True) -> None:
        with self._document.lock:
            if has_new_prims:
                self._simulations = find_simulations(self._document.stage)
            self._exists = bool(self._simulations)
            self._begins = _start_of(self._simulations)

    def _tell(self) -> None:
        """Publish the status, in the order of the changes."""
        with self._telling:
            self._document.publish(self.status)


def _state_of(live: LiveRun) -> State:
    """Return the state of a run that has not failed."""
    if live.is_over or not live.gate.is_open:
        return "paused"
    return "beginning" if live.frame is None else "running"


def _start_of(simulations: Sequence[Usd.Prim]) -> float | None:
    """Return the earliest start [time code]; None if one starts with the timeline. What is no
    number is no start: a run says what is wrong with it."""
    name = f"{NAMESPACE}:sim:startTime"
    starts = [prim.GetAttribute(name).Get() if prim else None for prim in simulations]
    numbers = [float(each) for each in starts if isinstance(each, Sdf.TimeCode | Real)]
    known = list(filter(math.isfinite, numbers))
    return min(known) if known and len(known) == len(starts) else None
