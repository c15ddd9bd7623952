"""What the solver does with splats: clock, neighbours, reaction, redistribution, growth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class SimParameters:
    """The simulation as a whole."""

    enabled: bool = knob(True, "whether splats move; where it is off they stay as they are")
    substeps: int = knob(
        4,
        "steps of the solver in a frame: more for what moves fast or settles hard",
        range=(1, 64),
        uniform=True,
    )
    seed: int = knob(
        0,
        "of all random numbers: another one gives another variation",
        range=(0, 2**31 - 1),
        uniform=True,
    )
    space: Literal["local", "world"] = knob(
        "local",
        "where the simulation takes place: local is the field's own space, which may move; world "
        "is the space of the stage, seen from where the field is at the first frame",
        uniform=True,
    )
    start_time: float = knob(
        -INF,
        "first frame of the simulation; before it splats are as captured; -inf is the first frame "
        "that is simulated",
        unit="time code",
        range=(-INF, INF),
        usd_type="timecode",
        uniform=True,
    )
    end_time: float = knob(
        INF,
        "last frame of the simulation; splats stay as they are then",
        unit="time code",
        range=(-INF, INF),
        usd_type="timecode",
        uniform=True,
    )
    max_count: int = knob(
        4_000_000, "births end when a field has as many splats", range=(0, 2**31 - 1), uniform=True
    )
    dimension: Literal["auto", "2", "3"] = knob(
        "auto",
        "2 for splats that lie on surfaces, 3 for those that fill a volume, auto finds out",
        uniform=True,
    )
    max_speed: float = knob(INF, "fastest that a splat may move", unit="unit/s", range=(0.0, INF))


@dataclass(frozen=True, slots=True, kw_only=True)
class NeighborsParameters:
    """Who is a neighbour of whom."""

    target: float = knob(16.0, "neighbours that a splat is to have", range=(6.0, 48.0))
    gain: float = knob(
        0.8,
        "part of what the number of neighbours is off by that a step corrects",
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
        "how much longer lists of neighbours are than the radius, as a part of it, so that they "
        "last for several steps",
        range=(0.0, 0.5),
    )
    k_max: int = knob(64, "longest list; the nearest are kept", range=(8, 512), uniform=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class RdParameters:
    """Gray and Scott's reaction-diffusion: the pattern."""

    enabled: bool = knob(False, "whether a pattern grows")
    preset: Literal[
        "custom", "spots", "worms", "labyrinth", "coral", "holes", "chaos", "uskate"
    ] = knob("custom", "a feed and a kill rate by name; custom takes feed and kill")
    feed: float = knob(0.037, "how fast u is fed, F", range=(0.0, 0.1))
    kill: float = knob(0.060, "how fast v decays beyond F, k", range=(0.03, 0.075))
    diffusion_u: float = knob(0.16, "how fast u spreads, in lattice units", range=(0.0, 0.25))
    diffusion_v: float = knob(
        0.08, "how fast v spreads, in lattice units; half of u's makes patterns", range=(0.0, 0.25)
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
        "reaction steps in a frame; a pattern takes some 6000 in all to fill a capture",
        range=(0, 256),
    )
    d_tau: float = knob(
        1.0,
        "time of a reaction step, in lattice units; split where it would be unstable",
        range=(0.0, 2.0),
    )
    domain: Literal["carrier", "self"] = knob(
        "carrier",
        "where the reaction runs: carrier is an even set of points on the capture, self the splats "
        "themselves, which are spread evenly first",
        uniform=True,
    )
    conservative: bool = knob(False, "whether diffusion keeps the sum of u and of v exactly")
    anisotropy: float = knob(0.0, "how much faster it diffuses along direction", range=(0.0, 0.9))
    direction: tuple[float, float, float] = knob(
        (0.0, 1.0, 0.0), "of anisotropy, in the field's space", usd_type="vector3f"
    )
    seed_mode: Literal["points", "selection", "noise"] = knob(
        "points",
        "where it begins: balls about random points, where the splats' weight is above one half, "
        "or patches of noise; affectors of the role seed begin it too",
        uniform=True,
    )
    seed_density: float = knob(
        0.002,
        "of points and noise: part of the points at which a seed is",
        range=(0.0, 1.0),
        uniform=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RelaxParameters:
    """Even spacing."""

    iterations: int = knob(
        20, "sweeps before the first frame, where the reaction's domain is self", range=(0, 200),
        uniform=True,
    )  # fmt: skip
    strength: float = knob(0.3, "part of the spacing that a sweep corrects", range=(0.0, 0.5))


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthParameters:
    """What a pattern makes grow."""

    rate: float = knob(
        0.0, "speed along the normal where v is high", unit="unit/s", range=(-INF, INF)
    )
    v_min: float = knob(0.15, "v below which nothing grows, moves or is born", range=(0.0, 1.0))
    v_max: float = knob(
        0.35, "v above which growth and births have their full rate", range=(0.0, 1.0)
    )
    birth_rate: float = knob(
        0.0, "new splats beside each one where v is high", unit="1/s", range=(0.0, INF)
    )
    crowd_max: float = knob(
        1.25, "neighbours, as a part of neighbors:target, from which a splat has no children",
        range=(0.0, INF),
    )  # fmt: skip
    birth_fade: float = knob(
        0.25, "time in which a child grows to its size", unit="s", range=(0.0, INF)
    )
    life: float = knob(
        INF,
        "age at which splats that were born die; captured ones do not",
        unit="s",
        range=(0.0, INF),
    )
    starve: float = knob(
        INF,
        "time with v below v_min after which splats that were born die",
        unit="s",
        range=(0.0, INF),
    )
    death_fade: float = knob(0.25, "time in which the dying vanish", unit="s", range=(0.0, INF))
    size_follow: float = knob(
        0.0,
        "how far drawn size follows the spacing: 0 keeps it, 1 scales with it",
        range=(0.0, 1.0),
    )
