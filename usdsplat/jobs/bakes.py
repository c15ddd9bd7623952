"""Divide bakes into tasks: bakes side by side, and the frames of each in order."""

from __future__ import annotations

from collections.abc import Sequence

from usdsplat.core.errors import UsageError
from usdsplat.jobs.job import Command, Job, Parameter, Slot, Step

BAKE, SHEET = "bake", "sheet"


def bake_job(
    command: Command,
    frames: Sequence[float],
    *,
    bakes: int | None = None,
    chunk: int | None,
    until: float | None = None,
    uses_gpu: bool = False,
) -> Job:
    """Return the job of a `usdsplat simulate`.

    Every task resumes its bake, so all may be repeated.

    Args:
        command: The command without --resume, --until and --combination.
        frames: Frames of all bakes.
        bakes: Number of bakes of a wedge; None for a bake without one.
        chunk: Least number of frames of a task, which ends at a checkpoint; None for one task for
            each bake.
        until: Frame at which the bakes stop; None for their end.
        uses_gpu: Whether a GPU computes.

    Raises:
        UsageError: If a chunk has no frame.
    """
    if chunk is not None and chunk < 1:
        raise UsageError("--chunk", str(chunk), "1 or more frames")
    last = frames[-1] if until is None else until
    ends = [] if chunk is None else [frames[i] for i in range(chunk - 1, len(frames) - 1, chunk)]
    ends = [end for end in ends if end < last]
    words: Command = (*command, "--resume")
    space: tuple[Parameter, ...] = ()
    if bakes is not None:
        words = (*words, Slot("--combination", BAKE))
        space = (Parameter(name=BAKE, values=tuple(str(n + 1) for n in range(bakes))),)
    steps: list[Step] = []
    for number, end in enumerate((*ends, until)):
        steps.append(
            Step(
                name=f"part {number + 1}" if ends else "simulate",
                command=words if end is None else (*words, f"--until={end!r}"),
                space=space,
                after=(steps[-1].name,) if steps else (),
                uses_gpu=uses_gpu,
            )
        )
    return Job(name="simulate", steps=tuple(steps))


def with_sheet(job: Job, command: Command) -> Job:
    """Return the job of a wedge with a last task, which draws the contact sheet.

    Args:
        job: See `bake_job`.
        command: The command that does what is left.
    """
    last = job.steps[-1]
    step = Step(name=SHEET, command=command, after=(last.name,), uses_gpu=last.uses_gpu)
    return Job(name=job.name, steps=(*job.steps, step), memory=job.memory)
