"""Target positions of splats, and how they get there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class SettleParameters:
    """The way back after a push: critically damped, never beyond the goal."""

    omega: float = knob(
        8.0, "how fast splats settle; half the way takes 1.68 / omega; 0 leaves them", unit="1/s",
        range=(0.0, 100.0),
    )  # fmt: skip
    delay: float = knob(
        0.0,
        "how long splats stay put after the last contact before they settle",
        unit="s",
        range=(0.0, INF),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformParameters:
    """Onto a target: the mesh that rel splatSim:conform:target names."""

    weight: float = knob(
        0.0, "how far: 0 is the capture, 1 the target; needs rel conform:target", range=(0.0, 1.0)
    )
    start: float = knob(
        0.0, "when the first splats set off, after the simulation's start", unit="s",
        range=(-INF, INF),
    )  # fmt: skip
    duration: float = knob(2.0, "time that a splat takes on its way", unit="s", range=(0.0, INF))
    stagger: float = knob(
        1.0, "how much later than the first the last splat sets off", unit="s", range=(0.0, INF)
    )
    order: Literal["random", "distance"] = knob(
        "random", "who sets off first: anyone, or the nearest to the target", uniform=True
    )
    mode: Literal["closest", "projectAlong", "normalRay", "optimalSpread"] = knob(
        "closest",
        "where on the target: its closest point, along axis, along the splat's own normal, or the "
        "closest and then spread evenly over it",
        uniform=True,
    )
    axis: tuple[float, float, float] = knob(
        (0.0, -1.0, 0.0),
        "of mode projectAlong, in the field's space",
        usd_type="vector3f",
        uniform=True,
    )
    path: Literal["straight", "slide"] = knob(
        "straight", "the way there: a line, or down the distance field", uniform=True
    )
    orient: float = knob(1.0, "how far splats turn to lie on the target", range=(0.0, 1.0))
    scale_mode: Literal["preserve", "density", "flatten"] = knob(
        "preserve",
        "sizes there: as they were, larger as splats are further apart, or flattened onto it",
    )
    keep_thickness: float = knob(
        1.0, "how much of its height over the capture's surface a splat keeps", range=(0.0, 1.0)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinParameters:
    """By joints: those of the skeleton that rel splatSim:skin:skeleton names."""

    weight: float = knob(
        1.0,
        "how far: 0 leaves splats where they are, 1 follows; needs rel skin:skeleton",
        range=(0.0, 1.0),
    )
    method: Literal["linear", "dualQuaternion"] = knob(
        "linear", "how joints are blended; dualQuaternion keeps volume in twists"
    )
    binding: Literal["weights", "triangles"] = knob(
        "weights",
        "what splats follow where rel splatSim:skin:mesh names a mesh: its points' joint weights, "
        "or its triangles",
        uniform=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DeformParameters:
    """One deformer of the stack, SplatDeformerAPI:<name>; in the space of the prim that rel
    splatSim:deform:<name>:frame names, or the field's."""

    type: Literal["transform", "bend", "twist", "taper", "lattice", "noise", "curl", "wave"] = knob(
        "transform", "what it does to space", uniform=True
    )
    order: int = knob(0, "place in the stack, lowest first", range=(-1000, 1000), uniform=True)
    weight: float = knob(1.0, "how much of it", range=(0.0, 1.0))
    mask: str = knob("", "primvar of the field, float[], that it is multiplied by", uniform=True)
    falloff: float = knob(
        0.0, "distance from the frame's origin at which it fades out; 0 is never", unit="unit",
        range=(0.0, INF),
    )  # fmt: skip
    axis: Literal["X", "Y", "Z"] = knob("Y", "along which it acts", uniform=True)
    length: float = knob(
        1.0, "of bend, twist and taper: how far they reach along the axis, from the origin",
        unit="unit", range=(1e-6, INF),
    )  # fmt: skip
    angle: float = knob(
        0.0, "of bend and twist: over the length", unit="deg", range=(-3600.0, 3600.0)
    )
    translate: tuple[float, float, float] = knob((0.0, 0.0, 0.0), "of transform", usd_type="float3")
    rotate: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "of transform: about X, then Y, then Z", unit="deg", usd_type="float3"
    )
    scale: tuple[float, float, float] = knob(
        (1.0, 1.0, 1.0),
        "of transform; of taper, that at the end of the length, across the axis",
        usd_type="float3",
    )
    amount: float = knob(
        0.1, "of noise, curl and wave: how far splats move", unit="unit", range=(-INF, INF)
    )
    size: float = knob(1.0, "of noise, curl and wave: wavelength", unit="unit", range=(1e-6, INF))
    speed: float = knob(
        1.0, "of noise, curl and wave: wavelengths that pass by", unit="1/s", range=(-INF, INF)
    )
    seed: int = knob(0, "of noise and curl", range=(0, 2**31 - 1), uniform=True)
    divisions: tuple[int, int, int] = knob(
        (2, 2, 2), "of lattice: control points along x, y and z", range=(2, 16), usd_type="int3",
        uniform=True,
    )  # fmt: skip
    points: tuple[tuple[float, float, float], ...] = knob(
        (), "of lattice: where the control points are, x fastest, in a cube from 0 to 1",
        usd_type="point3f[]",
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ParticlesParameters:
    """Free flight."""

    enabled: bool = knob(False, "whether all splats fly; else only those that dissolve let go")
    gravity: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "acceleration in the space of the stage", unit="unit/s^2",
        usd_type="vector3f",
    )  # fmt: skip
    wind: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "velocity of the air in the space of the stage", unit="unit/s",
        usd_type="vector3f",
    )  # fmt: skip
    turbulence: float = knob(0.0, "speed of the air's whirls", unit="unit/s", range=(0.0, INF))
    turbulence_scale: float = knob(1.0, "size of the whirls", unit="unit", range=(1e-6, INF))
    turbulence_speed: float = knob(0.5, "how often the whirls change", unit="1/s", range=(0.0, INF))
    drag: float = knob(
        0.5, "how fast splats take the velocity of the air", unit="1/s", range=(0.0, INF)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DissolveParameters:
    """Splats let go, one after the other; or, time reversed, come together."""

    enabled: bool = knob(False, "whether splats let go")
    mode: Literal["dissolve", "assemble"] = knob(
        "dissolve",
        "whether splats fly off, or come back from where they would have flown",
        uniform=True,
    )
    by: Literal["noise", "distance", "random"] = knob(
        "noise", "who goes first: patches of a size, the nearest to origin, or anyone", uniform=True
    )
    origin: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "of distance, in the field's space", usd_type="point3f", uniform=True
    )
    size: float = knob(
        0.25, "of the patches of by noise", unit="unit", range=(1e-6, INF), uniform=True
    )
    start: float = knob(
        0.0, "when the first goes, after the simulation's start", unit="s", range=(-INF, INF),
        uniform=True,
    )  # fmt: skip
    duration: float = knob(
        2.0, "time from the first to the last", unit="s", range=(0.0, INF), uniform=True
    )
    speed: float = knob(
        0.0,
        "with which splats go, along their normal",
        unit="unit/s",
        range=(0.0, INF),
        uniform=True,
    )
    spread: float = knob(
        30.0,
        "half the angle of the cone about the normal",
        unit="deg",
        range=(0.0, 180.0),
        uniform=True,
    )
    fade: float = knob(
        0.5,
        "time in which a splat that goes vanishes; 0 is never",
        unit="s",
        range=(0.0, INF),
        uniform=True,
    )
    shrink: float = knob(
        1.0, "part of their size that splats lose while they vanish", range=(0.0, 1.0)
    )
