"""A simulation that is baked to a file while one looks: what `usdsplat simulate` would write."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from pxr import Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.output import Existing
from usdsplat.images.frames import LIMIT
from usdsplat.kernels.device import Device
from usdsplat.preview.simulating.job import Host, Job
from usdsplat.preview.simulating.live import span
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.simulating import SimulateOptions, simulate


class Recording(Job):
    """One bake, of the stage as it is when it begins: edits that come later do not count.

    Args:
        host: Whose stage is simulated.
        device: Computes.
        changed: Called when there is something new to say.
        target, frames: As `simulate` takes them; None takes the stage's range.
        existing: What becomes of a bake that is there already.
        without: Layers of the session that do not count, by identifier.
        after: Recordings that were stopped; they may still be writing, to the same files perhaps.
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
        # Here, where the caller has the lock: what is recorded is what the user sees.
        self._stage = twin(host.stage, without)

    def work(self) -> None:
        """Implements `Job.work`."""
        for each in self._after:
            each.join()
        frames = self._frames if self._frames is not None else _range(self._stage)
        self.end = frames[-1]
        self._left = frames
        report = simulate(
            self._stage,
            self.target,
            frames,
            SimulateOptions(device=self._device, existing=self._existing),
            progress=self,
            reading=self._reading,
        )
        self.message = f"{self.target}: {report.sentence()}"

    def step(self, label: str, done: int, total: int) -> None:
        """Implements `Progress.step`: frames that are done, of those that were left."""
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
        """What is left where it is stopped now, a sentence."""
        done = "before its first frame" if self.frame is None else f"after frame {self.frame:g}"
        return f"{self.target}: stopped {done}; record to it again to resume"


def can_resume(target: Path) -> bool:
    """Whether a bake at a file was stopped after its first checkpoint, and can go on from it."""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(target), metadataOnly=True)
    except RuntimeError:  # how pxr says that a file cannot be read
        return False
    record = read_record(layer)
    return record is not None and bool(record.get("checkpoint"))


def twin(stage: Usd.Stage, without: Sequence[str]) -> Usd.Stage:
    """Another stage of the same layers, with a copy of what the session says of it now.

    Args:
        stage: Its lock is held.
        without: Sublayers of the session that are left out, by identifier.
    """
    session = Sdf.Layer.CreateAnonymous("recorded.usda")
    session.TransferContent(stage.GetSessionLayer())
    session.subLayerPaths = [path for path in session.subLayerPaths if path not in without]
    made = Usd.Stage.OpenMasked(
        stage.GetRootLayer(),
        session,
        stage.GetPathResolverContext(),
        stage.GetPopulationMask(),
        Usd.Stage.LoadNone,
    )
    made.SetLoadRules(stage.GetLoadRules())
    made.MuteAndUnmuteLayers(stage.GetMutedLayers(), [])
    made.SetInterpolationType(stage.GetInterpolationType())
    return made


def _range(stage: Usd.Stage) -> list[float]:
    """The frames of a stage."""
    first, last = span(stage)
    if last is None or last - first >= LIMIT:
        found = "a stage without a range" if last is None else f"frames from {first:g} to {last:g}"
        raise UsageError("record", found, f"frames, at most {LIMIT}")
    return [first + number for number in range(int(last - first) + 1)]
