"""Divide the relighting of a stage into tasks: the times at which it is lit, side by side."""

from __future__ import annotations

from usdsplat.jobs.job import Command, Job, Parameter, Slot, Step

PART = "part"


def relight_job(
    command: Command, *, parts: int, uses_gpu: bool = False, finishes: bool = False
) -> Job:
    """Return the job of a `usdsplat relight`.

    Args:
        command: The command without part.
        parts: Number of tasks that light.
        uses_gpu: Whether a GPU lights.
        finishes: Whether the last task is the command itself, which writes the layer; it needs no
            GPU. Otherwise the caller does so.
    """
    space = (Parameter(name=PART, values=tuple(f"{k + 1}/{parts}" for k in range(parts))),)
    words = (*command, Slot("--part", PART))
    steps = [Step(name="light", command=words, space=space, uses_gpu=uses_gpu)]
    if finishes:
        steps.append(Step(name="write", command=command, after=("light",)))
    return Job(name="relight", steps=tuple(steps))
