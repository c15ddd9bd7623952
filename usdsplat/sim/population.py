"""Growth, birth and death: where the pattern is high, splats rise, have children, and die.

Errors do not accumulate: the size of a child and the opacity of a dying splat are functions of the
time since birth or since dying began, see `fades`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import population as kernels
from usdsplat.sim.carriers import NEAR
from usdsplat.sim.parameters import GrowthParameters
from usdsplat.sim.state import ALIVE, BORN, DYING, FREE, PINNED, State
from usdsplat.sim.support import Neighborhood
from usdsplat.sim.timeline import Step

PROGRESS, SPLIT, HUNGRY, DYING_SINCE = (
    f"growth:{name}" for name in ("progress", "split", "hungry", "dying")
)
"""In `State.memory`, all float32: accumulated probability of a child, below 0 before the
accumulation starts; time of the last child [s]; how long a splat has starved [s]; when it began to
die [s]."""

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
    """Move splats along their normals in proportion to the pattern, by at most a fifth of the
    support. PINNED, FREE and DYING splats stay.

    Args:
        device: Runs the kernels.
        state: Its rest positions change, and its positions by the same, rotated with the splat.
        growth: Rate and thresholds.
        dt: Duration [s].
        normals: Normals at rest, shape (n, 3).
        rate_factor: Factor of the rate, shape (n,).
    """
    positions = device.copied(state.positions)
    device.run(
        kernels.grow,
        positions,
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
    state.positions = device.publish(positions)


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
    """Create children, at most one per splat, where the pattern is high and there is room.

    A child is a copy of its parent, half a spacing away; the two share the parent's optical depth.
    Identities continue in the order of the parents, so that new rows are the last. FREE and DYING
    splats have no children.

    Args:
        device: Runs the kernels.
        state: All of its arrays may be replaced.
        growth: Rate and thresholds.
        step: The substep.
        neighborhood: Neighbourhood of the splats. At its usual support the rate is
            `growth.birth_rate`; it scales with the area or volume of a splat's support.
        maximum: Number of splats at which births end; lower identities come first.
        rate_factor: Factor of the rate, shape (n,); a splat with 0 has no children.

    Returns:
        Rows of the parents, ascending, one for each new row, shape (b,).
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
    ids = state.ids
    frame: list[npt.NDArray[Any]]
    frame = [ids, state.support, neighborhood.normals, state.rotations, state.rest_rotations]
    append(state, parents, now=step.now)
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
    state.flags[n:] |= BORN
    state.memory[PROGRESS][n:] = 0
    state.memory[SPLIT][parents] = step.now
    state.memory[SPLIT][n:] = NEVER
    if HUNGRY in state.memory:
        state.memory[HUNGRY][n:] = 0
    return parents


def append(state: State, parents: I64, *, now: float) -> None:
    """Append a copy of a row for each of its children, with identities that continue in order.

    Args:
        state: All of its arrays are replaced.
        parents: Rows of the parents, shape (b,).
        now: Time since the simulation's start [s].
    """
    n, ids = len(state), state.ids
    _replace(state, lambda array: np.concatenate((array, array.take(parents, axis=0))))
    state.ids[n:] = state.next_id + np.arange(len(parents))
    state.next_id += len(parents)
    state.parents[n:] = ids[parents]
    state.births[n:] = now


def deaths(state: State, growth: GrowthParameters, *, now: float, dt: float) -> I64 | None:
    """Start the death of born splats by age and hunger, and remove those that have vanished or are
    not finite.

    Args:
        state: All of its arrays may be replaced; remaining rows keep their order.
        growth: Life, hunger and duration of dying.
        now: Time since the simulation's start [s].
        dt: Duration [s].

    Returns:
        The remaining rows, shape (m,), or None if all remain.
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
    # `take` releases the GIL, indexing does not
    _replace(state, lambda array: array.take(left, axis=0))
    return left


def join(state: State, cloud: SplatCloud, *, now: float) -> None:
    """Append the splats of another capture as the last rows, with new identities.

    They have no carriers, and are no children: they neither grow nor age.

    Args:
        state: All of its arrays may be replaced. Its harmonics have at least the cloud's degree.
        cloud: The other capture.
        now: Time since the simulation's start [s].
    """
    n, m = len(state), len(cloud)
    first = np.zeros(m, np.int64)
    _replace(state, lambda array: np.concatenate((array, array.take(first, axis=0))))
    sh = padded(cloud.sh, state.rest_sh.shape[1])
    given = {
        "positions": cloud.positions, "rotations": cloud.rotations, "scales": cloud.scales,
        "opacities": cloud.opacities, "sh": sh,
    }  # fmt: skip
    for name, array in given.items():
        getattr(state, name)[n:] = array
        getattr(state, f"rest_{name}")[n:] = array
    for key, array in state.memory.items():
        if array.dtype.kind in "fu" and key != NEAR:
            array[n:] = 0
    state.velocities[n:] = 0
    state.uv[n:] = (1, 0)
    state.weight[n:] = 1
    state.flags[n:] = ALIVE
    state.parents[n:] = -1
    state.births[n:] = now
    state.ids[n:] = state.next_id + np.arange(m)
    state.next_id += m


def padded(sh: F32, count: int) -> F32:
    """Return harmonics with `count` coefficients or more, shape (n, k, 3); new ones are 0."""
    missing = max(0, count - sh.shape[1])
    return np.pad(sh, ((0, 0), (0, missing), (0, 0))) if missing else sh


def fades(state: State, growth: GrowthParameters, *, now: float) -> tuple[F32, F32]:
    """Return the factors of `rest_opacities` and `rest_scales` at a time, shapes (n,) and (n,).

    Born splats grow from size 0 over `growth.birth_fade`. Meanwhile the opacity of their parents
    goes from the original one to the shared one, by a factor between 1 and 2. Dying splats become
    transparent over `growth.death_fade`.
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
    """Return the state's memory under a key; create it if it is missing."""
    if key not in state.memory:
        state.memory[key] = np.full(len(state), first, np.float32)
    array: F32 = state.memory[key]
    return array


def _replace(state: State, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> None:
    """Replace all arrays of the state by a function of each; `sh` stays the same array as `rest_sh`
    if it was."""
    shared = state.sh is state.rest_sh
    arrays = {n: change(array) for n, array in state.per_splat() if not (shared and n == "sh")}
    if shared:
        arrays["sh"] = arrays["rest_sh"]
    state.replace_rows(arrays)


def _halved(opacities: F32) -> F32:
    """Return the opacity of each of two layers that together are as dense as one: 1 - sqrt(1 - a),
    without cancellation."""
    a = opacities.astype(np.float64)
    return (a / (1 + np.sqrt(1 - a))).astype(np.float32)


def _unsplit(opacities: F32, part: F32) -> F32:
    """Return the factor that changes a shared opacity a to the optical depth of both layers at part
    0, and of one layer at part 1."""
    a = opacities.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = -np.expm1((2.0 - part) * np.log1p(-a)) / a
    return np.where(a > 0, factor, 2.0 - part).astype(np.float32)


def _eased(age: npt.NDArray[np.float64], span: float) -> F32:
    """Return the smoothstep of an age [s] over a span, 1 where the span is 0; float32."""
    if span <= 0:
        return np.ones(len(age), np.float32)
    t = np.clip(age / span, 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)
