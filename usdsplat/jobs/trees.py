"""Divide the building of a splat tree into tasks."""

from __future__ import annotations

from usdsplat.jobs.job import Command, Job, Parameter, Slot, Step


def tree_job(
    command: Command, *, parts: int, memory: int | None = None, finishes: bool = False
) -> Job:
    """Return the job of a `usdsplat lod`.

    Args:
        command: The command without step and part.
        parts: Number of tasks that sort, and of those that build.
        memory: See `Job`.
        finishes: Whether the last task is the command itself, which measures the errors and writes
            the stage. Otherwise the caller does so.
    """
    values = tuple(f"{k + 1}/{parts}" for k in range(parts))
    # the parameters have different names: each part of the building needs all sorted splats
    steps = [Step(name="begin", command=(*command, "--step=begin"))]
    for step, parameter in (("sort", "part"), ("build", "share")):
        space = (Parameter(name=parameter, values=values),)
        words = (*command, f"--step={step}", Slot("--part", parameter))
        steps.append(Step(name=step, command=words, space=space, after=(steps[-1].name,)))
    if finishes:
        steps.append(Step(name="finish", command=command, after=(steps[-1].name,)))
    return Job(name="lod", steps=tuple(steps), memory=memory)
