"""Divide the building of a splat tree into tasks."""

from __future__ import annotations

from usdsplat.jobs.job import Command, Job, Parameter, Slot, Step


def tree_job(command: Command, *, name: str, parts: int) -> Job:
    """Return the job of a `usdsplat lod`, all but its end, which the command itself does.

    Args:
        command: The command without step and part.
        name: Name of the job.
        parts: Number of tasks that sort, and of those that build.
    """
    values = tuple(f"{k + 1}/{parts}" for k in range(parts))
    # the parameters have different names: each part of the building needs all sorted splats
    steps = [Step(name="begin", command=(*command, "--step=begin"))]
    for step, parameter in (("sort", "part"), ("build", "share")):
        space = (Parameter(name=parameter, values=values),)
        words = (*command, f"--step={step}", Slot("--part", parameter))
        steps.append(Step(name=step, command=words, space=space, after=(steps[-1].name,)))
    return Job(name=name, steps=tuple(steps))
