"""Growth, birth and death: where a pattern is high, splats rise, have children, and die.

Nothing here accumulates in what is drawn: a child's size and a dying splat's opacity are functions
of how long ago it was born or began to die, by `fades`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import population as kernels
from usdsplat.sim.parameters import GrowthParameters
from usdsplat.sim.state import ALIVE, BORN, DYING, FREE, PINNED, State
from usdsplat.sim.support import Neighborhood
from usdsplat.sim.timeline import Step

PROGRESS, SPLIT, HUNGRY, DYING_SINCE = (
    f"growth:{name}" for name in ("progress", "split", "hungry", "dying")
)
"""What the state remembers, all float32: the chance of a child so far, below 0 for not begun; when
it last had one [s]; how long it has starved [s]; when it began to die [s]."""

NEVER = np.float32(-np.inf)


def grow(
    device: Device,
    state: State,
    growth: GrowthParameters,
    *,
    dt: float,
    normals: F32,
    rate_factor: F32 | None = None,
) -> None:
    """Move splats along their normals, as fast as the pattern is high; a fifth of the support at
    most. Those that are PINNED, FREE or DYING stay.

    Args:
        device: Where.
        state: Its positions at rest change, and those now as a splat is turned by then.
        growth: Rate and thresholds.
        dt: [s].
        normals: At rest, shape (n, 3).
        rate_factor: Of the rate, shape (n,).
    """
    device.run(
        kernels.grow,
        state.positions,
        state.rest_positions,
        device.upload(state.rotations),
        device.upload(state.rest_rotations),
        device.upload(state.uv),
        device.upload(state.support),
        device.upload(normals),
        device.upload(np.empty(0, np.float32) if rate_factor is None else rate_factor),
        device.upload(state.flags),
        np.float32(growth.rate * dt),
        np.float32(growth.v_min),
        np.float32(growth.v_max),
        ALIVE,
        PINNED | FREE | DYING,
    )


def births(
    device: Device,
    state: State,
    growth: GrowthParameters,
    step: Step,
    neighborhood: Neighborhood,
    *,
    maximum: int,
    rate_factor: F32 | None = None,
) -> I64:
    """Let splats have children, one each at most, where the pattern is high and there is room.

    A child is its parent, half a spacing further; the two share the parent's optical depth. It has
    the next identity, in the order of the parents', so new rows are the last. Those that are FREE
    or DYING have none.

    Args:
        device: Where.
        state: All of its arrays may be replaced.
        growth: Rate and thresholds.
        step: The substep.
        neighborhood: Of the splats. At its usual support the rate is `growth.birth_rate`; it scales
            with the area or volume of a splat's support.
        maximum: Splats at which births end, first identities first.
        rate_factor: Of the rate, shape (n,); where it is 0 nobody has a child.

    Returns:
        Rows of the parents, ascending, one for each of the last rows, shape (b,).
    """
    n = len(state)
    progress = _remembered(state, PROGRESS, -1)
    ripe = np.empty(n, np.uint8)
    device.run(
        kernels.ripen,
        progress,
        device.upload(state.ids),
        device.upload(state.uv),
        device.upload(state.support),
        device.upload(neighborhood.crowding),
        device.upload(np.empty(0, np.float32) if rate_factor is None else rate_factor),
        device.upload(state.flags),
        np.float32(growth.birth_rate * step.dt),
        np.float32(growth.v_min),
        np.float32(growth.v_max),
        np.float32(neighborhood.usual_support),
        neighborhood.dimension,
        np.float32(growth.crowd_max),
        ALIVE,
        FREE | DYING,
        step.seed,
        ripe,
    )
    due = np.flatnonzero(ripe)
    parents: I64 = due[: max(0, maximum - n)].astype(np.int64)
    progress[parents] = np.minimum(progress[parents] - 1, 1)
    progress[due[len(parents) :]] = 1
    if not len(parents):
        return parents
    _remembered(state, SPLIT, NEVER)
    rows = np.concatenate([np.arange(n), parents])
    ids = state.ids
    frame: list[npt.NDArray[Any]]
    frame = [ids, state.support, neighborhood.normals, state.rotations, state.rest_rotations]
    _take(state, rows)
    device.run(
        kernels.put,
        device.upload(parents),
        *(device.upload(array) for array in frame),
        float(neighborhood.target),
        neighborhood.dimension,
        step.seed,
        state.step,
        state.rest_positions[n:],
        state.positions[n:],
    )
    for opacities in (state.opacities, state.rest_opacities):
        opacities[parents] = opacities[n:] = _halved(opacities[parents])
    state.ids[n:] = state.next_id + np.arange(len(parents))
    state.next_id += len(parents)
    state.parents[n:] = ids[parents]
    state.births[n:] = step.now
    state.flags[n:] |= BORN
    state.memory[PROGRESS][n:] = 0
    state.memory[SPLIT][parents] = step.now
    state.memory[SPLIT][n:] = NEVER
    if HUNGRY in state.memory:
        state.memory[HUNGRY][n:] = 0
    return parents


def deaths(state: State, growth: GrowthParameters, *, now: float, dt: float) -> I64 | None:
    """Let those born die of age and hunger, and take away those that have vanished, and any that
    is nowhere.

    Args:
        state: All of its arrays may be replaced; others keep their order.
        growth: Life, hunger and how long dying takes.
        now: After the simulation's start [s].
        dt: [s].

    Returns:
        Rows of those that are left, shape (m,), or None where all are.
    """
    is_gone = ~np.isfinite(state.positions).all(-1)
    born = (state.flags & BORN) != 0
    if np.isfinite(growth.starve) or HUNGRY in state.memory:
        hungry = _remembered(state, HUNGRY, 0)
        hungry[:] = np.where(state.uv[:, 1] < growth.v_min, hungry + np.float32(dt), 0)
    if born.any():
        ends = np.float64(now) - state.births > growth.life
        if HUNGRY in state.memory:
            ends |= state.memory[HUNGRY] >= growth.starve
        ends &= born & ((state.flags & DYING) == 0)
        if ends.any():
            _remembered(state, DYING_SINCE, np.inf)[ends] = now
            state.flags[ends] |= DYING
    if DYING_SINCE in state.memory:
        is_gone |= np.float32(now) - state.memory[DYING_SINCE] >= np.float32(growth.death_fade)
    if not is_gone.any():
        return None
    left: I64 = np.flatnonzero(~is_gone).astype(np.int64)
    _take(state, left)
    return left


def fades(state: State, growth: GrowthParameters, *, now: float) -> tuple[F32, F32]:
    """Factors of `rest_opacities` and `rest_scales` at a time, shapes (n,) and (n,).

    Those born grow from nothing over `growth.birth_fade`; meanwhile their parents go from the
    opacity they had to the one that they share, by a factor of 1 to 2. The dying become transparent
    over `growth.death_fade`.
    """
    alpha, size = np.ones(len(state), np.float32), np.ones(len(state), np.float32)
    rows = np.flatnonzero(state.flags & BORN)
    size[rows] = _eased(now - state.births[rows].astype(np.float64), growth.birth_fade)
    if SPLIT in state.memory:
        age = now - state.memory[SPLIT].astype(np.float64)
        rows = np.flatnonzero(age < growth.birth_fade)
        alpha[rows] = _unsplit(state.rest_opacities[rows], _eased(age[rows], growth.birth_fade))
    if DYING_SINCE in state.memory:
        rows = np.flatnonzero(state.flags & DYING)
        age = now - state.memory[DYING_SINCE][rows].astype(np.float64)
        alpha[rows] *= 1 - _eased(age, growth.death_fade)
    return alpha, size


def _remembered(state: State, key: str, first: float | np.float32) -> F32:
    """The state's memory under a key, begun where it has none."""
    if key not in state.memory:
        state.memory[key] = np.full(len(state), first, np.float32)
    array: F32 = state.memory[key]
    return array


def _take(state: State, rows: npt.NDArray[np.integer]) -> None:
    """Make rows of all arrays the state's own; `sh` stays `rest_sh` where it was."""
    shared = state.sh is state.rest_sh
    # `take` lets other threads run meanwhile, indexing does not
    arrays = {n: a.take(rows, axis=0) for n, a in state.per_splat() if not (shared and n == "sh")}
    if shared:
        arrays["sh"] = arrays["rest_sh"]
    state.replace_rows(arrays)


def _halved(opacities: F32) -> F32:
    """Opacity of each of two layers that are as dense as one: 1 - sqrt(1 - a), without the
    difference of like numbers."""
    a = opacities.astype(np.float64)
    return (a / (1 + np.sqrt(1 - a))).astype(np.float32)


def _unsplit(opacities: F32, part: F32) -> F32:
    """Factor of a shared opacity a that gives both layers' depth at part 0, and one's at 1."""
    a = opacities.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = -np.expm1((2.0 - part) * np.log1p(-a)) / a
    return np.where(a > 0, factor, 2.0 - part).astype(np.float32)


def _eased(age: npt.NDArray[np.float64], span: float) -> F32:
    """Smoothstep of an age [s] over a span, 1 where the span is 0; float32."""
    if span <= 0:
        return np.ones(len(age), np.float32)
    t = np.clip(age / span, 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)
