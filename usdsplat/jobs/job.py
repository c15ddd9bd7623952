"""Describe a job: steps of tasks, each of which is one of our command lines."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Slot:
    """A word of a command that depends on a parameter of the task: a flag with its value."""

    flag: str
    """Flag with dashes, such as "--frames"."""
    parameter: str
    """Name of the parameter."""

    def filled(self, values: Mapping[str, str]) -> str:
        """Return the word for the parameters of a task."""
        return f"{self.flag}={values[self.parameter]}"


Command = tuple[str | Slot, ...]
"""Words after the name of the program."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter of the tasks of a step, with all its values."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One command line of a job. It writes whole files or none, and may be repeated."""

    step: str
    """Name of its step."""
    values: tuple[tuple[str, str], ...]
    """Pairs of a parameter and its value."""
    words: tuple[str, ...]
    """Words after the name of the program."""
    uses_gpu: bool = False
    """Whether it needs a GPU."""

    @property
    def name(self) -> str:
        """The task in a few words, such as "draw, frames 1-8, tile 2"."""
        return ", ".join([self.step, *(f"{name} {value}" for name, value in self.values)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Tasks that can run side by side: a command for each combination of the parameters."""

    name: str
    command: Command
    space: tuple[Parameter, ...] = ()
    after: tuple[str, ...] = ()
    """Names of earlier steps. A task begins when those of their tasks have ended that agree with it
    in all parameters that both have."""
    uses_gpu: bool = False
    """Whether its tasks need a GPU."""

    def tasks(self) -> Iterator[Task]:
        """Yield the tasks; the values of the last parameter change first."""
        for combination in itertools.product(*(each.values for each in self.space)):
            values = dict(zip((each.name for each in self.space), combination, strict=True))
            words = (w.filled(values) if isinstance(w, Slot) else w for w in self.command)
            yield Task(
                step=self.name,
                values=tuple(values.items()),
                words=tuple(words),
                uses_gpu=self.uses_gpu,
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Steps in an order in which they can run."""

    name: str
    steps: tuple[Step, ...]
    memory: int | None = None
    """Memory that a task may need [byte]; None if unknown."""

    def tasks(self) -> list[Task]:
        """Return all tasks, by step."""
        return [task for step in self.steps for task in step.tasks()]

    def needs(self) -> dict[Task, tuple[Task, ...]]:
        """Return the tasks that each task waits for."""
        by_step = {step.name: list(step.tasks()) for step in self.steps}
        found: dict[Task, tuple[Task, ...]] = {}
        for step in self.steps:
            for task in by_step[step.name]:
                earlier = (each for name in step.after for each in by_step[name])
                found[task] = tuple(each for each in earlier if _agree(task, each))
        return found


def _agree(a: Task, b: Task) -> bool:
    """Return whether two tasks have no parameter with different values."""
    values = dict(a.values)
    return all(values.get(name, value) == value for name, value in b.values)
