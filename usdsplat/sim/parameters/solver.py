"""Parameters of the solver: clock, neighbours, reaction, redistribution, growth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class SimParameters:
    """The simulation as a whole."""

    enabled: bool = knob(True, "whether the simulation runs; while it is off splats do not change")
    substeps: int = knob(
        4,
        "solver steps per frame: more for fast motion or stiff settling",
        range=(1, 64),
        uniform=True,
    )
    seed: int = knob(
        0,
        "seed of all random numbers; each seed gives another variation",
        range=(0, 2**31 - 1),
        uniform=True,
    )
    space: Literal["local", "world"] = knob(
        "local",
        "space of the simulation: local is the field's own space, which may move; world is the "
        "space of the stage, as seen from the field at the first frame",
        uniform=True,
    )
    start_time: float = knob(
        -INF,
        "first frame of the simulation, before which splats are as captured; -inf is the first "
        "requested frame",
        unit="time code",
        range=(-INF, INF),
        usd_type="timecode",
        uniform=True,
    )
    end_time: float = knob(
        INF,
        "last frame of the simulation; splats do not change after it",
        unit="time code",
        range=(-INF, INF),
        usd_type="timecode",
        uniform=True,
    )
    max_count: int = knob(
        4_000_000,
        "number of splats of a field at which births end",
        range=(0, 2**31 - 1),
        uniform=True,
    )
    dimension: Literal["auto", "2", "3"] = knob(
        "auto",
        "2 for splats on surfaces, 3 for splats that fill a volume, auto detects it",
        uniform=True,
    )
    tree_level: int = knob(
        -1,
        "level of detail of a splat tree that is simulated, 0 the leaves; negative is the finest "
        "cut of treeSplats",
        range=(-1, 63),
        uniform=True,
    )
    tree_splats: int = knob(
        1_000_000,
        "largest number of splats of a splat tree that are simulated, by refining the largest "
        "errors first",
        range=(1, 2**31 - 1),
        uniform=True,
    )
    max_speed: float = knob(INF, "largest speed of a splat", unit="unit/s", range=(0.0, INF))
    contact: float = knob(
        1.0,
        "whether affectors push splats: with a mask, those where it is above 0",
        range=(0.0, 1.0),
        takes_mask=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NeighborsParameters:
    """Neighbourhoods of splats."""

    target: float = knob(16.0, "number of neighbours wanted for each splat", range=(6.0, 48.0))
    gain: float = knob(
        0.8,
        "fraction of the difference from the target that a step corrects",
        range=(0.0, 1.0),
    )
    h_min: float = knob(
        -1.0, "least radius of the neighbourhood; negative is automatic", unit="unit",
        range=(-1.0, INF),
    )  # fmt: skip
    h_max: float = knob(
        -1.0, "largest radius, at most 8 times the least; negative is automatic", unit="unit",
        range=(-1.0, INF),
    )  # fmt: skip
    skin: float = knob(
        0.15,
        "margin of neighbour lists, as a fraction of the radius, so that they last for several "
        "steps",
        range=(0.0, 0.5),
    )
    k_max: int = knob(
        64, "longest neighbour list; the nearest are kept", range=(8, 512), uniform=True
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RdParameters:
    """Gray-Scott reaction-diffusion, which makes the pattern."""

    enabled: bool = knob(False, "whether a pattern grows")
    preset: Literal[
        "custom", "spots", "worms", "labyrinth", "coral", "holes", "chaos", "uskate"
    ] = knob("custom", "a feed and a kill rate by name; custom uses rd:feed and rd:kill")
    feed: float = knob(0.037, "feed rate F of u", range=(0.0, 0.1), takes_mask=True)
    kill: float = knob(
        0.060, "kill rate k: decay of v in addition to F", range=(0.03, 0.075), takes_mask=True
    )
    diffusion_u: float = knob(0.16, "diffusion of u, in lattice units", range=(0.0, 0.25))
    diffusion_v: float = knob(
        0.08, "diffusion of v, in lattice units; patterns form at half of u's", range=(0.0, 0.25)
    )
    pattern_scale: float = knob(
        -1.0,
        "length of a lattice unit: a pattern repeats after 10 to 15 of them; negative is the mean "
        "spacing",
        unit="unit",
        range=(-1.0, INF),
    )
    substeps: int = knob(
        8,
        "reaction steps per frame; a pattern takes about 6000 in all to fill a capture",
        range=(0, 256),
    )
    d_tau: float = knob(
        1.0,
        "duration of a reaction step, in lattice units; a step that would be unstable is split",
        range=(0.0, 2.0),
    )
    domain: Literal["carrier", "self"] = knob(
        "carrier",
        "points on which the reaction runs: carrier is an even set of points on the capture, self "
        "the splats themselves, which are distributed evenly first",
        uniform=True,
    )
    conservative: bool = knob(False, "whether diffusion preserves the sums of u and v exactly")
    anisotropy: float = knob(
        0.0,
        "fraction by which diffusion is slower across direction than along it",
        range=(0.0, 0.9),
    )
    direction: tuple[float, float, float] = knob(
        (0.0, 1.0, 0.0), "direction of anisotropy, in the field's space", usd_type="vector3f"
    )
    seed_mode: Literal["points", "selection", "noise", "affectors"] = knob(
        "points",
        "where the pattern starts: balls around random points, splats with a weight above one "
        "half, patches of noise, or only affectors of the role seed, which start it in all modes",
        uniform=True,
    )
    front_speed: float = knob(
        -1.0,
        "speed at which the pattern spreads from its seeds over the surface, in distances of "
        "carriers; negative: the pattern starts everywhere at once",
        unit="1/s",
        range=(-1.0, INF),
        uniform=True,
    )
    seeds: int = knob(
        12,
        "number of seeds from which a front spreads, for seedMode points",
        range=(1, 10_000),
        uniform=True,
    )
    seed_density: float = knob(
        0.002,
        "fraction of the points that are seeded, for seedMode points and noise",
        range=(0.0, 1.0),
        uniform=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaxParameters:
    """Redistribution to an even spacing."""

    iterations: int = knob(
        20,
        "redistribution sweeps before the first frame, if rd:domain is self",
        range=(0, 200),
        uniform=True,
    )  # fmt: skip
    strength: float = knob(
        0.3, "fraction of the spacing error that a sweep corrects", range=(0.0, 0.5)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthParameters:
    """Growth, births and deaths by the pattern."""

    rate: float = knob(
        0.0,
        "speed along the normal where v is high",
        unit="unit/s",
        range=(-INF, INF),
        takes_mask=True,
    )
    v_min: float = knob(0.15, "v below which nothing grows, moves or is born", range=(0.0, 1.0))
    v_max: float = knob(
        0.35, "v above which growth and births have their full rate", range=(0.0, 1.0)
    )
    birth_rate: float = knob(
        0.0, "births per splat where v is high", unit="1/s", range=(0.0, INF), takes_mask=True
    )
    crowd_max: float = knob(
        1.25, "neighbours, as a fraction of neighbors:target, from which a splat has no children",
        range=(0.0, INF),
    )  # fmt: skip
    birth_fade: float = knob(
        0.25, "time in which a child grows to its full size", unit="s", range=(0.0, INF)
    )
    life: float = knob(
        INF,
        "age at which born splats die; captured ones do not",
        unit="s",
        range=(0.0, INF),
    )
    starve: float = knob(
        INF,
        "time with v below v_min after which born splats die",
        unit="s",
        range=(0.0, INF),
    )
    death_fade: float = knob(0.25, "time in which dying splats vanish", unit="s", range=(0.0, INF))
    size_follow: float = knob(
        0.0,
        "how far the drawn size follows the spacing: 0 not at all, 1 proportionally",
        range=(0.0, 1.0),
        takes_mask=True,
    )
