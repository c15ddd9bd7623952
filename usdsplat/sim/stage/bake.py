"""Bake frames into a layer of opinions over the capture.

with Bake.open(stage, target, fields, times, parameters, provenance, resume=True) as bake:
    for time in bake.left:                       # continues from bake.resumed.states, if any
        ...
        bake.write(path, frame)                  # each field, at each frame
        if bake.is_checkpoint_due(time):
            bake.checkpoint(time, states)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.schema import tokens
from usdsplat.sim import checkpoint as checkpoints
from usdsplat.sim.checkpoint import Checkpoint
from usdsplat.sim.parameters import BakeParameters
from usdsplat.sim.stage import plan as plans
from usdsplat.sim.stage.bake_authors import Author, author_of
from usdsplat.sim.stage.bake_dense import stop
from usdsplat.sim.stage.bake_layers import BakeLayers, resume_frame
from usdsplat.sim.stage.bake_parts import parts_of, spans_of
from usdsplat.sim.stage.epochs import samples
from usdsplat.sim.stage.extending import EARLY, MERGED, extension, is_shorter, last_epoch
from usdsplat.sim.stage.plan import BakedField, Plan
from usdsplat.sim.stage.provenance import Provenance, known_record, parameter_hash
from usdsplat.sim.stage.sample_layer import new_part
from usdsplat.sim.stage.spool import Spool
from usdsplat.sim.state import Frame, State

_EXTRA = "bake:"


@dataclass(slots=True, eq=False, kw_only=True)
class _Field:
    plan: Plan
    spool: Spool
    author: Author


class Bake:
    """The bake of all fields of a simulation. Nothing is written before it is entered. If it is
    left by an exception, it can be resumed from its last checkpoint; before the first one, it is
    removed."""

    def __init__(
        self,
        layers: BakeLayers,
        fields: dict[str, _Field],
        times: Sequence[float],
        parameters: BakeParameters,
        provenance: Provenance,
    ) -> None:
        self._layers = layers
        self._fields = fields
        self._times = times
        self._parameters = parameters
        self._provenance = provenance
        self._epochs = 0
        self._is_new = False
        self._has_begun = False
        self._merged: int | None = None
        """Epochs whose samples are in the file of a shorter bake; None unless one is extended."""
        self._shown = 0
        """Frames of the shorter bake."""
        self._start_hashes: dict[int, str] = {}
        """Index of each frame to keep a checkpoint of -> hash of the parameters up to it."""
        self._is_early = False
        self._keeps = True
        self.is_stopped = False
        """Whether the bake is left unfinished, to be resumed from its last checkpoint."""
        self.resumed: Checkpoint | None = None
        """Checkpoint to continue from: states after the frame `resumed.time`."""
        self.is_complete = False
        """Whether all frames are written."""

    @classmethod
    def open(
        cls,
        stage: Usd.Stage,
        target: Path | str,
        fields: Sequence[BakedField],
        times: Sequence[float],
        parameters: BakeParameters,
        provenance: Provenance,
        *,
        resume: bool = False,
        keeps_checkpoint: bool = True,
    ) -> Bake:
        """Start, resume or extend a bake. Nothing is written yet.

        Args:
            stage: The simulated stage; it has a file, and is not changed.
            target: The layer to write, a .usda; its samples go to a folder beside it, of the same
                name and "_data".
            fields: At least one.
            times: All frames, ascending, evenly spaced [time code].
            parameters: Mode and rates.
            provenance: What the bake is made of.
            resume: Continue the bake at `target` from its last checkpoint, or a finished one of
                fewer frames from the checkpoint that it keeps. Without a bake, or before its first
                checkpoint, start anew.
            keeps_checkpoint: Keep the checkpoint from which frames can be added.

        Raises:
            StageError: If a field cannot be baked in this mode, or the bake at `target` was made of
                other parameters or files.
            FormatError: If the checkpoint is damaged.
            OutputError: If there is no space or no permission to write.
        """
        found = [plans.plan(stage, field, parameters) for field in fields]
        layers = BakeLayers(stage, Path(target), found)
        known = known_record(layers.target) if resume else None
        made = {
            plan.path: _Field(
                plan=plan,
                spool=Spool(layers.folder, f"{number:02d}", plan.keeping, plan.rest),
                author=author_of(stage, plan, parameters, times[0]),
            )
            for number, plan in enumerate(found)
        }
        bake = cls(layers, made, [float(time) for time in times], parameters, provenance)
        bake._keeps = keeps_checkpoint
        last = last_epoch(len(times), parameters.clip_frames)
        bake._start_hashes[last] = bake._hash_until(stage, last)
        if known is None:
            bake._is_new = True
        else:
            bake._continue(stage, known)
        return bake

    @property
    def target(self) -> Path:
        """The layer of results."""
        return self._layers.target

    @property
    def left(self) -> Sequence[float]:
        """Frames that are still to be written [time code]."""
        return () if self.is_complete else self._times[self._frames :]

    def is_checkpoint_due(self, time: float) -> bool:
        """Return whether `checkpoint` must be called after a frame."""
        return self.is_resumable(time) or self._is_start(time)

    def is_resumable(self, time: float) -> bool:
        """Return whether an interrupted bake can be resumed after a frame."""
        done = self._times.index(time) + 1
        return done % self._parameters.checkpoint_every == 0 and done < len(self._times)

    def _is_start(self, time: float) -> bool:
        """Return whether frames can be added to the finished bake from a frame."""
        return self._keeps and self._times.index(time) in self._start_hashes

    def write(self, path: str, frame: Frame) -> None:
        """Write the next frame of a field, in the field's own space.

        Args:
            path: Path of the field.
            frame: Rows ascend by id.

        Raises:
            UsageError: If it is not the next frame.
            StageError: If splats were born or died in a fixed population.
        """
        field = self._fields[path]
        index = field.spool.frames
        if index >= len(self._times) or frame.time != self._times[index]:
            expected = f"{self._times[index]:g}" if index < len(self._times) else "no more frames"
            raise UsageError(f"{path}, next frame", f"{frame.time:g}", expected)
        if field.plan.keeping.is_fixed and not field.spool.has_same(frame):
            found = f"births or deaths ({len(frame.cloud)} splats)"
            raise StageError(
                f"{path} at {frame.time:g}", found, f"the capture's {len(field.plan.rest)} splats"
            )
        field.spool.take(frame, self._rate(index))
        end = (self._epochs + 1) * self._parameters.clip_frames
        if self._frames > end:
            self._write_epoch(range(end - self._parameters.clip_frames, end), is_closed=True)

    def checkpoint(self, time: float, states: Mapping[str, State]) -> None:
        """Write a checkpoint, in place of the last one, or the one that a finished bake keeps.

        Args:
            time: Last frame that was written, of all fields [time code].
            states: States after it, by the field's path.
        """
        extras: dict[str, npt.NDArray[Any]] = {}
        for number, field in enumerate(self._fields.values()):
            kept = field.spool.arrays()
            extras |= {f"{_EXTRA}{number}:{name}": array for name, array in kept.items()}
        extras[f"{_EXTRA}epochs"] = np.array(self._epochs)
        where = Checkpoint(
            time=time, states=states, parameter_hash=self._provenance.param_hash, extras=extras
        )
        if self._is_start(time):
            opinions = self._start_hashes[self._times.index(time)]
            checkpoints.save(self._layers.kept, replace(where, parameter_hash=opinions))
        if not self.is_resumable(time):
            return
        checkpoints.save(self._layers.checkpoint, where)
        for field in self._fields.values():
            field.spool.forget(self._epochs * self._parameters.clip_frames)

    @property
    def done(self) -> Sequence[float]:
        """Frames that are written [time code]."""
        return self._times[: self._frames]

    def may_end_early(self, stage: Usd.Stage) -> None:
        """Keep a checkpoint of each epoch of the simulated stage meanwhile, for `end_early`."""
        for start in range(0, len(self._times), self._parameters.clip_frames):
            self._start_hashes[start] = self._hash_until(stage, start)

    def end_early(self, provenance: Provenance) -> None:
        """End with the frames so far, unless there are none, or fewer than in a shorter bake."""
        if self._frames and self._frames >= self._shown:
            self._times, self._provenance = list(self.done), provenance
            start = self._times[last_epoch(len(self._times), self._parameters.clip_frames)]
            kept = self._layers.kept
            self._is_early = kept.exists() and checkpoints.time_of(kept) == start
            self.close()

    def close(self) -> Path:
        """Write the remaining samples, and the layer of results.

        Returns:
            The path of the layer.

        Raises:
            UsageError: If frames are missing.
        """
        if self.is_complete:
            return self._layers.target
        if self._frames < len(self._times):
            raise UsageError("bake", f"{self._frames} frames", f"{len(self._times)}")
        for field in self._fields.values():
            field.spool.finish()
        first = self._epochs * self._parameters.clip_frames
        self._write_epoch(range(first, len(self._times)), is_closed=False)
        is_clips = self._parameters.mode == "clips"
        record = self._provenance.record(completed=len(self._times), checkpoint="")
        record |= {EARLY: True} if self._is_early else {}
        if is_clips:
            self._layers.show_clips(self._spans, record)
        else:
            spans = self._parameters.clip_frames, self._merged or 0, self._epochs
            self._layers.show_merged(parts_of(self._layers, self._times, *spans), record)
        self._layers.end(keeps_clips=is_clips, keeps_checkpoint=self._keeps)
        self.is_complete = True
        return self._layers.target

    def __enter__(self) -> Self:
        try:
            if self._is_new:
                self._layers.begin()
            self._has_begun = True
            if not self.is_complete:
                self._present()
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None and not self.is_stopped:
                self.close()
        finally:
            self._leave()

    def _leave(self) -> None:
        """Remove what an unfinished bake cannot use: everything before the first checkpoint, and
        frames after the last one. A bake that could not begin has nothing to remove."""
        if self.is_complete or not self._has_begun:
            return
        # What is on disk decides: an interrupt may come between a checkpoint and the next statement
        if self.resumed is None and not self._layers.checkpoint.exists():
            self._layers.discard()
        elif (time := resume_frame(self._layers.target)) in self._times:
            for field in self._fields.values():  # its own frame is in the checkpoint
                field.spool.forget_from(self._times.index(time))

    @property
    def _frames(self) -> int:
        """Number of frames that all fields have."""
        return min(field.spool.frames for field in self._fields.values())

    def _rate(self, index: int) -> float:
        """Return the frames per second, from the distance to the frame before."""
        if not index:
            return self._layers.rate
        return self._layers.rate / (self._times[index] - self._times[index - 1])

    def _write_epoch(self, frames: range, *, is_closed: bool) -> None:
        """Write frames as a clip, all fields in one file."""
        with new_part(self._layers.clip(self._epochs), self._layers.rate) as part:
            for field in self._fields.values():
                for sample in samples(field.spool, frames, self._times, is_closed=is_closed):
                    field.author.write(part, sample)
                    part.save()
                if field.plan.keeping.velocities:
                    if not self._epochs:
                        stop(part, field.plan.path, tokens.LONG_AGO)
                    if not is_closed:
                        stop(part, field.plan.path, self._end)
        self._epochs += 1
        self._present()

    def _present(self) -> None:
        """Refer to the finished clips in the layer of results; the record is written last. While a
        bake is extended, its results stay until there are more."""
        done = min(self._epochs * self._parameters.clip_frames, len(self._times))
        has_clips = self._parameters.mode == "clips"
        is_earlier = self._merged is not None and (done < self._shown or not has_clips)
        name = self._layers.checkpoint
        record = self._provenance.record(
            completed=self._shown if is_earlier else done,
            checkpoint=f"./{name.parent.name}/{name.name}",
        )
        if self._merged is not None:
            record[MERGED] = self._merged
        if is_earlier:
            self._layers.show_earlier(record, has_clips=has_clips)
        else:
            self._layers.show_clips(self._spans, record)

    @property
    def _spans(self) -> list[tuple[float, float]]:
        return spans_of(self._times, self._end, self._parameters.clip_frames, self._epochs)

    @property
    def _end(self) -> float:
        """One frame after the last one [time code]."""
        step = self._times[-1] - self._times[-2] if len(self._times) > 1 else 1.0
        return self._times[-1] + step

    def _continue(self, stage: Usd.Stage, known: Mapping[str, Any]) -> None:
        """Continue or extend the bake with a record; if it has no checkpoint yet, start anew."""
        layers, size = self._layers, self._parameters.clip_frames
        if is_shorter(known, self._times) and not known.get("checkpoint"):
            start = last_epoch(self._times.index(float(known["frameRange"][1])) + 1, size)
            found = extension(
                layers.target, layers.kept, known, self._provenance, self._times,
                self._hash_until(stage, start),
            )  # fmt: skip
            self._restore(found.start, found.start.parameter_hash)
            self._merged, self._shown = self._epochs, found.completed
            return
        self._provenance.check(layers.target, known)
        self._merged = known.get(MERGED)
        self._shown = int(known.get("completedFrames", 0))
        if not known.get("checkpoint"):
            self.is_complete = True
            layers.end(keeps_clips=self._parameters.mode == "clips", keeps_checkpoint=self._keeps)
        elif layers.checkpoint.exists():
            self._restore(checkpoints.load(layers.checkpoint), self._provenance.param_hash)
        elif self._merged is not None:  # it was stopped before the first checkpoint of its own
            kept = checkpoints.load(layers.kept)
            self._restore(kept, self._hash_until(stage, self._times.index(kept.time)))
        else:
            self._is_new = True

    def _hash_until(self, stage: Usd.Stage, index: int) -> str:
        """Return the hash of the parameters at the frames up to one."""
        return parameter_hash(stage, self._times[: index + 1])

    def _restore(self, found: Checkpoint, parameters: str) -> None:
        """Continue from a checkpoint that was made of parameters with this hash."""
        if found.parameter_hash != parameters:
            raise StageError(
                str(self._layers.checkpoint), "a checkpoint of other parameters", "this bake's"
            )
        self._epochs = int(found.extras[f"{_EXTRA}epochs"])
        for number, field in enumerate(self._fields.values()):
            prefix = f"{_EXTRA}{number}:"
            kept = {k: v for k, v in found.extras.items() if k.startswith(prefix)}
            field.spool.restore({k.removeprefix(prefix): v for k, v in kept.items()})
        self.resumed = found
