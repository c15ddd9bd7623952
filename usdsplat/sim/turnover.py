"""Splats that a step adds to and removes from a field: births, deaths, new matter, and those of
another capture.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.sim import population, styles
from usdsplat.sim.parts import Parts
from usdsplat.sim.pattern import UV
from usdsplat.sim.specs import Moment
from usdsplat.sim.state import State
from usdsplat.sim.timeline import Step


def accrete(parts: Parts, state: State, moment: Moment, step: Step) -> list[I64]:
    """Add new matter where the pattern has reached it, and shape all of it.

    Returns:
        For each change, the row that every row of the new state had before it, shape (m,).

    Args:
        parts: Parts of the solver; nothing is done without `accretion`.
        state: All of its arrays may be replaced.
        moment: Values of the stage.
        step: The substep.
    """
    accretion = parts.accretion
    if accretion is None:
        return []
    knobs = styles.resolved(moment.parameters.accretion)
    uv: F32 = state.globals[UV]
    carriers, rows = accretion.due(state, uv, knobs, moment.parameters.sim.max_count, step.now)
    changes: list[I64] = []
    if len(rows):
        changes.append(np.concatenate([np.arange(len(state)), rows]))
        population.append(state, rows, now=step.now)
        accretion.bind(state, carriers, knobs)
        parts.target_pose.append_children(rows, state)
    accretion.shape(state, uv, knobs, step.now, is_new=bool(changes))
    return changes


def fill(parts: Parts, state: State, moment: Moment, now: float) -> bool:
    """Fill the pieces that have broken off since the last time, and cut splats at their seams;
    return whether there are any.

    Args:
        parts: Parts of the solver.
        state: All of its arrays may be replaced.
        moment: Values of the stage.
        now: Time since the simulation's start [s].
    """
    matter = parts.matter
    if matter is None or matter.filling is None:
        return False
    filling = matter.filling
    due = filling.due(state, matter.places(), maximum=moment.parameters.sim.max_count)
    if not due:
        return False
    population.append(state, due.parents, now=now)
    filling.shape(state, due)
    parts.target_pose.append_children(due.parents, state)
    return True


def join(parts: Parts, state: State, moment: Moment, now: float) -> bool:
    """Append the splats of another capture if they must join now; return whether they did.

    Args:
        parts: Parts of the solver.
        state: All of its arrays may be replaced.
        moment: Values of the stage.
        now: Time since the simulation's start [s].
    """
    cloud = parts.target_pose.joining(moment, now)
    if cloud is None:
        return False
    population.join(state, cloud, now=now)
    parts.target_pose.append_joined(len(cloud))
    parts.masks.append_joined(state, len(cloud))
    return True


def breed(
    device: Device,
    parts: Parts,
    state: State,
    moment: Moment,
    step: Step,
    *,
    maximum: int,
    rate_factor: F32 | None,
) -> list[I64]:
    """Apply births, then deaths.

    Returns:
        For each change, the row that every row of the new state had before it, shape (m,).

    Args:
        device: Runs the kernels.
        parts: Parts of the solver.
        state: All of its arrays may be replaced.
        moment: Values of the stage.
        step: The substep.
        maximum: Number of splats at which births end.
        rate_factor: Factor of the rate of births, shape (n,).
    """
    growth, changes = moment.parameters.growth, list[I64]()
    parents = population.births(
        device, state, growth, step, parts.pattern.neighborhood(state, moment),
        maximum=maximum, rate_factor=rate_factor,
    )  # fmt: skip
    if len(parents):
        parts.target_pose.append_children(parents, state)
        changes.append(np.concatenate([np.arange(len(state) - len(parents)), parents]))
    left = population.deaths(state, growth, now=step.now, dt=step.dt)
    if left is not None:
        parts.target_pose.select(left)
        changes.append(left)
    return changes
