"""Divide bakes into tasks: bakes side by side, and the frames of each in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from usdsplat.core.errors import UsageError
from usdsplat.jobs.job import Command, Job, Step


def bake_job(
    commands: Mapping[str, Command],
    frames: Sequence[float],
    *,
    name: str,
    chunk: int | None,
    until: float | None,
) -> Job:
    """Return the job of some bakes.

    Every task resumes its bake, so all may be repeated.

    Args:
        commands: Name of each bake, and its command.
        frames: Frames of all of them.
        name: Name of the job.
        chunk: Least number of frames of a task, which ends at a checkpoint; None for one task for
            each bake.
        until: Frame at which the bakes stop; None for their end.

    Raises:
        UsageError: If a chunk has no frame.
    """
    if chunk is not None and chunk < 1:
        raise UsageError("--chunk", str(chunk), "1 or more frames")
    last = frames[-1] if until is None else until
    ends = [] if chunk is None else [frames[i] for i in range(chunk - 1, len(frames) - 1, chunk)]
    ends = [end for end in ends if end < last]
    steps: list[Step] = []
    for bake, command in commands.items():
        before: tuple[str, ...] = ()
        for number, end in enumerate((*ends, until)):
            words = (*command, "--resume")
            if end is not None:
                words = (*words, f"--until={end!r}")
            step = f"{bake}, part {number + 1}" if ends else bake
            steps.append(Step(name=step, command=words, after=before))
            before = (step,)
    return Job(name=name, steps=tuple(steps))
