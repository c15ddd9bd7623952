"""Words on a time that a live simulation has not come to, at which another frame is shown."""

from __future__ import annotations

from usdsplat.preview.values import SimulationStatus


def unsimulated(
    status: SimulationStatus, time: float | None, *, first: float, is_baked: bool
) -> str:
    """Return what to say of the shown time; "" if it is simulated, or needs no simulation.

    Args:
        status: Status of the simulation.
        time: Shown time [time code]; None for a stage without times.
        first: First frame of the timeline [time code], with which a simulation starts that has no
            start of its own. Up to its start, splats are as captured.
        is_baked: Whether the stage has a bake, which is shown before a run.
    """
    if status.state == "none" or time is None:
        return ""
    if status.frames is None:
        start = first if status.start is None else status.start
        return "" if is_baked or time <= start else f"Frame {time:g} is not simulated yet"
    earliest, last = status.frames
    if time > last:
        return f"Frame {time:g} is not simulated yet: this is {last:g}"
    return f"Frame {time:g} is not simulated: this is {earliest:g}" if time < earliest else ""
