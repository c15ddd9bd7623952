"""Parameters of the target positions of splats, and of their motion towards them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from usdsplat.core.knobs import knob

INF = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class SettleParameters:
    """Return to the target position after a push, critically damped and without overshoot."""

    omega: float = knob(
        8.0, "speed of settling; half the way takes 1.68 / omega; 0 turns it off", unit="1/s",
        range=(0.0, 100.0),
        takes_mask=True,
    )  # fmt: skip
    delay: float = knob(
        0.0,
        "time after the last contact before splats settle",
        unit="s",
        range=(0.0, INF),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConformParameters:
    """Motion onto a target, the mesh or splat field of rel splatSim:conform:target."""

    weight: float = knob(
        0.0,
        "blend from the capture, 0, to the target, 1; needs rel conform:target",
        range=(0.0, 1.0),
        takes_mask=True,
    )
    start: float = knob(
        0.0, "time after the simulation's start at which the first splats start to move", unit="s",
        range=(-INF, INF),
    )  # fmt: skip
    duration: float = knob(2.0, "time that a splat takes to arrive", unit="s", range=(0.0, INF))
    stagger: float = knob(
        1.0, "time between the start of the first splat and the last", unit="s", range=(0.0, INF)
    )
    order: Literal["random", "distance", "height"] = knob(
        "distance",
        "which splats start first: random ones, those with the shortest way, or in mode transport "
        "the upper ones, so that a front passes down; others then take the shortest way first",
        uniform=True,
    )
    order_primvar: str = knob(
        "",
        "primvar of the field, float[], that says which splats start first, 0, and last, 1; "
        "replaces order in mode transport",
        uniform=True,
    )
    mode: Literal["transport", "closest", "projectAlong", "normalRay", "optimalSpread"] = knob(
        "transport",
        "point on the target: transport covers a mesh or another capture evenly and keeps "
        "neighbours together; the others take the closest point of a mesh, that of a ray along "
        "axis, that of a ray along the splat's normal, or the closest one, redistributed evenly",
        uniform=True,
    )
    axis: tuple[float, float, float] = knob(
        (0.0, -1.0, 0.0),
        "axis of mode projectAlong, in the field's space",
        usd_type="vector3f",
        uniform=True,
    )
    path: Literal["straight", "slide"] = knob(
        "straight",
        "path to the target: a straight line, or along the target's surface with decreasing "
        "height; for mode transport see arc",
        uniform=True,
    )
    arc: float = knob(
        0.25,
        "height of the arcs on which mode transport moves splats, relative to the way; 0 is a "
        "straight line, less than 0 bends inwards",
        range=(-4.0, 4.0),
    )
    orient: float = knob(1.0, "how far splats rotate to lie flat on the target", range=(0.0, 1.0))
    scale_mode: Literal["preserve", "density", "flatten"] = knob(
        "preserve",
        "sizes on the target: unchanged, scaled with the spacing of splats, or flattened onto the "
        "surface; mode transport always follows the spacing",
    )
    keep_thickness: float = knob(
        0.1,
        "fraction of its height over the capture's surface that a splat keeps",
        range=(0.0, 1.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinParameters:
    """Skinning by the joints of a skeleton, rel splatSim:skin:skeleton."""

    weight: float = knob(
        1.0,
        "weight of the skin: 0 leaves splats at rest, 1 follows the skeleton; needs rel "
        "skin:skeleton",
        range=(0.0, 1.0),
        takes_mask=True,
    )
    method: Literal["linear", "dualQuaternion"] = knob(
        "linear", "blending of joints; dualQuaternion preserves volume in twists"
    )
    binding: Literal["weights", "triangles"] = knob(
        "weights",
        "what splats follow where rel splatSim:skin:mesh names a mesh: its points' joint weights, "
        "or its triangles",
        uniform=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DeformParameters:
    """One deformer of the stack, SplatDeformerAPI:<name>, in the space of the prim of rel
    splatSim:deform:<name>:frame, or of the field."""

    type: Literal["transform", "bend", "twist", "taper", "lattice", "noise", "curl", "wave"] = knob(
        "transform", "type of deformation", uniform=True
    )
    order: int = knob(0, "position in the stack, lowest first", range=(-1000, 1000), uniform=True)
    weight: float = knob(1.0, "weight of the deformation", range=(0.0, 1.0), takes_mask=True)
    mask: str = knob(
        "",
        "primvar of the field, float[], that multiplies the deformation; a mask of weight can "
        "do more",
        uniform=True,
    )
    falloff: float = knob(
        0.0,
        "distance from the frame's origin at which the deformation has faded out; 0: no fading",
        unit="unit",
        range=(0.0, INF),
    )  # fmt: skip
    axis: Literal["X", "Y", "Z"] = knob("Y", "axis of the deformation", uniform=True)
    length: float = knob(
        1.0, "length of bend, twist and taper along the axis, from the origin",
        unit="unit", range=(1e-6, INF),
    )  # fmt: skip
    angle: float = knob(
        0.0, "angle of bend and twist over the length", unit="deg", range=(-3600.0, 3600.0)
    )
    translate: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "translation of type transform", usd_type="float3"
    )
    rotate: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0),
        "rotation of type transform, about X, then Y, then Z",
        unit="deg",
        usd_type="float3",
    )
    scale: tuple[float, float, float] = knob(
        (1.0, 1.0, 1.0),
        "scale of type transform; for taper, the scale across the axis at the end of the length",
        usd_type="float3",
    )
    amount: float = knob(
        0.1, "amplitude of noise, curl and wave", unit="unit", range=(-INF, INF), takes_mask=True
    )
    size: float = knob(1.0, "wavelength of noise, curl and wave", unit="unit", range=(1e-6, INF))
    speed: float = knob(
        1.0, "speed of noise, curl and wave, in wavelengths", unit="1/s", range=(-INF, INF)
    )
    seed: int = knob(0, "seed of noise and curl", range=(0, 2**31 - 1), uniform=True)
    divisions: tuple[int, int, int] = knob(
        (2, 2, 2), "control points of the lattice along x, y and z", range=(2, 16), usd_type="int3",
        uniform=True,
    )  # fmt: skip
    points: tuple[tuple[float, float, float], ...] = knob(
        (), "positions of the control points of the lattice, x fastest, in a cube from 0 to 1",
        usd_type="point3f[]",
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ParticlesParameters:
    """Free flight."""

    enabled: bool = knob(
        False, "whether all splats fly; otherwise only those that dissolve has detached"
    )
    gravity: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "acceleration in the space of the stage", unit="unit/s^2",
        usd_type="vector3f",
        takes_mask=True,
    )  # fmt: skip
    wind: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0), "velocity of the air in the space of the stage", unit="unit/s",
        usd_type="vector3f",
        takes_mask=True,
    )  # fmt: skip
    turbulence: float = knob(
        0.0, "speed of the turbulence", unit="unit/s", range=(0.0, INF), takes_mask=True
    )
    turbulence_scale: float = knob(1.0, "size of the turbulence", unit="unit", range=(1e-6, INF))
    turbulence_speed: float = knob(
        0.5, "rate at which the turbulence changes", unit="1/s", range=(0.0, INF)
    )
    drag: float = knob(
        0.5,
        "rate at which splats take on the velocity of the air",
        unit="1/s",
        range=(0.0, INF),
        takes_mask=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DissolveParameters:
    """Dissolving: splats detach one after the other. Assembling is the same, reversed in time."""

    enabled: bool = knob(False, "whether splats detach")
    mode: Literal["dissolve", "assemble"] = knob(
        "dissolve",
        "whether splats fly away, or return from where they would have flown",
        uniform=True,
    )
    by: Literal["noise", "distance", "random", "mask"] = knob(
        "noise",
        "order in which splats detach: in patches of dissolve:size, nearest to origin first, "
        "random, or by the mask that dissolve:by:mask names: where it is 0 first, where it is 1 "
        "last, and where a moving mask falls early enough",
        uniform=True,
        takes_mask=True,
    )
    origin: tuple[float, float, float] = knob(
        (0.0, 0.0, 0.0),
        "point in the field's space from which order distance is measured",
        usd_type="point3f",
        uniform=True,
    )
    size: float = knob(
        0.25, "size of the patches of order noise", unit="unit", range=(1e-6, INF), uniform=True
    )
    start: float = knob(
        0.0,
        "time after the simulation's start at which the first splat detaches",
        unit="s", range=(-INF, INF),
        uniform=True,
    )  # fmt: skip
    duration: float = knob(
        2.0, "time from the first splat to the last", unit="s", range=(0.0, INF), uniform=True
    )
    speed: float = knob(
        0.0,
        "initial speed along the normal",
        unit="unit/s",
        range=(0.0, INF),
        uniform=True,
        takes_mask=True,
    )
    spread: float = knob(
        30.0,
        "half angle of the cone of directions about the normal",
        unit="deg",
        range=(0.0, 180.0),
        uniform=True,
    )
    fade: float = knob(
        0.5,
        "time in which a detached splat vanishes; with 0 it stays visible",
        unit="s",
        range=(0.0, INF),
        uniform=True,
        takes_mask=True,
    )
    shrink: float = knob(
        1.0,
        "fraction of their size that splats lose while they vanish",
        range=(0.0, 1.0),
        takes_mask=True,
    )
