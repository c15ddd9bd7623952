"""Steps of a simulation and their times."""

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
    """Times of steps, computed from the step number and never accumulated."""

    zero: float
    """Time of step 0 [time code]."""
    lead: int
    """Steps from step 0 to the first frame that is drawn."""
    begin: int
    """Step at which the simulation begins."""
    substeps: int
    """Steps of a frame."""
    dt: float
    """Duration of a step [s]."""

    @classmethod
    def of(cls, sim: SimParameters, first: float, codes_per_second: float) -> Timeline:
        """Return the timeline of a simulation that is drawn from a frame on.

        If the simulation starts earlier, steps precede that frame; if it starts later, steps
        precede the start.

        Args:
            sim: Substeps and start time.
            first: The first frame [time code].
            codes_per_second: Time codes per second.
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
        """Return the time of a step [time code]."""
        return self.zero + step / self.substeps

    def seconds(self, step: int) -> float:
        """Return the time of a step since the simulation's start, 0 before it [s]."""
        return max(0, step - self.begin) * self.dt

    def is_frame(self, step: int) -> bool:
        """Return whether a step ends at a frame."""
        return (step - self.lead) % self.substeps == 0
