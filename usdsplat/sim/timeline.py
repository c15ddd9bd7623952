"""Steps of a simulation, and the times that they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usdsplat.sim.parameters import SimParameters


@dataclass(frozen=True, slots=True)
class Step:
    """One substep of a simulation."""

    now: float
    """Time since the simulation's start at the end of the step [s]."""
    dt: float
    """Duration [s]."""
    seed: int
    """Seed of the simulation's random numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """Times are worked out from the number of steps, and never added up."""

    zero: float
    """Of step 0 [time code]."""
    lead: int
    """Steps from there to the first frame that is drawn."""
    begin: int
    """Step at which the simulation begins."""
    substeps: int
    """In a frame."""
    dt: float
    """Duration of a step [s]."""

    @classmethod
    def of(cls, sim: SimParameters, first: float, codes_per_second: float) -> Timeline:
        """Of a simulation that is drawn from a frame on.

        Where it begins earlier, there are steps before that frame; where it begins later, there
        are steps before it begins.

        Args:
            sim: Its steps and its start.
            first: The frame [time code].
            codes_per_second: Time codes in a second.
        """
        steps = sim.substeps
        start = sim.start_time if math.isfinite(sim.start_time) else first
        lead = max(0, math.ceil((first - start) * steps))
        zero = first - lead / steps
        return cls(
            zero=zero,
            lead=lead,
            begin=max(0, math.ceil((start - zero) * steps)),
            substeps=steps,
            dt=1.0 / (codes_per_second * steps),
        )

    def time(self, step: int) -> float:
        """[time code]."""
        return self.zero + step / self.substeps

    def seconds(self, step: int) -> float:
        """Since the simulation began; 0 before [s]."""
        return max(0, step - self.begin) * self.dt

    def is_frame(self, step: int) -> bool:
        """Whether a step ends at a frame."""
        return (step - self.lead) % self.substeps == 0
