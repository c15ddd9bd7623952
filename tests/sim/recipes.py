"""Recipes written by hand, for tests of the solver without USD."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.sim.affectors import affector, placed, rotation
from tests.sim.clouds import even_sphere
from tests.sim.shapes import sphere
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.kernels.device import CpuDevice
from usdsplat.sim.parameters import (
    DeformParameters,
    DriverParameters,
    MaskParameters,
    Parameters,
)
from usdsplat.sim.solver import Solver
from usdsplat.sim.specs import (
    Affector,
    Deformer,
    Driver,
    Mask,
    Moment,
    SkinBinding,
    SkinPose,
    Surface,
)
from usdsplat.sim.state import Frame
from usdsplat.sim.uses import uses_over

Says = Callable[[float], dict[str, Any]]


@dataclass
class Written:
    """A recipe: what is so at a time code is what `says` gives."""

    rest: SplatCloud
    says: Says
    selection: F32 | None = None
    binding: SkinBinding | None = None
    codes_per_second: float = 24.0
    path: str = "/World/Field"

    def at(self, time: float) -> Moment:
        given = {"parameters": Parameters(), "to_world": np.eye(4), **self.says(time)}
        return Moment(time=time, **given)


def knobs(**groups: dict[str, Any]) -> Parameters:
    """Parameters that differ from the defaults, by group."""
    plain = Parameters()
    return replace(
        plain, **{group: replace(getattr(plain, group), **each) for group, each in groups.items()}
    )


def always(**given: Any) -> Says:
    """The same at all times."""
    return lambda time: given


def ball(count: int = 800, degree: int = 1, seed: int = 3) -> SplatCloud:
    """Flat splats on the unit sphere, facing out."""
    rng = np.random.default_rng(seed)
    points = even_sphere(count)
    half = np.stack([1 + points[:, 2], -points[:, 1], points[:, 0], np.zeros(count)], axis=1)
    half[half[:, 0] < 1e-6] = (0, 1, 0, 0)
    size = 2.0 / np.sqrt(count)
    return SplatCloud(
        positions=points,
        scales=(size * rng.uniform(0.8, 1.2, (count, 3)) * (1, 1, 0.2)).astype(np.float32),
        rotations=(half / np.linalg.norm(half, axis=1, keepdims=True)).astype(np.float32),
        opacities=rng.uniform(0.3, 0.95, count).astype(np.float32),
        sh=rng.normal(0, 0.3, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def deformer(type: str, name: str = "d", **given: Any) -> Deformer:
    parameters = DeformParameters(type=type, **given)
    return Deformer(name=name, parameters=parameters, frame=np.eye(4))


def painted(values: F32, *knobs: str, **given: Any) -> dict[str, Any]:
    """Values of a moment: a mask of the capture's splats, and the parameters that have it."""
    own = MaskParameters(source="primvar", primvar="paint", **{"clamp": False, **given})
    mask = Mask(name="paint", parameters=own, frame=np.eye(4), primvar=values)
    return {"masks": {"paint": mask}, "masked": dict.fromkeys(knobs, ("paint",))}


def mask(source: str, name: str = "m", frame: Any = None, **given: Any) -> Mask:
    """A mask; parameters and parts by name."""
    parts = {key: given.pop(key) for key in list(given) if key in Mask.__dataclass_fields__}
    matrix = np.eye(4) if frame is None else frame
    parameters = MaskParameters(source=source, **given)
    return Mask(name=name, parameters=parameters, frame=matrix, **parts)


def driver(output: str, name: str = "r", **given: Any) -> Driver:
    return Driver(name=name, parameters=DriverParameters(output=output, **given))


def started(
    device: CpuDevice,
    recipe: Written,
    frames: int,
    *,
    start: float = 1.0,
    state: Any = None,
) -> Solver:
    """A solver that knows what is needed in so many frames."""
    uses = uses_over(recipe, [start + number for number in range(frames)])
    return Solver(recipe, uses, device=device, start=start, state=state)


def played(device: CpuDevice, recipe: Written, frames: int, **given: Any) -> list[Frame]:
    """All frames."""
    solver = started(device, recipe, frames, **given)
    found = [solver.frame()]
    for _ in range(frames - 1):
        solver.advance()
        found.append(solver.frame())
    return found


ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")


def changed(frames: list[Any], rest: SplatCloud) -> set[str]:
    """Arrays of which some bit differs from the capture in some frame."""
    return {
        name
        for frame in frames
        for name in ARRAYS
        if not np.array_equal(getattr(frame.cloud, name), getattr(rest, name))
    }


def pusher(time: float, **given: Any) -> dict[str, Any]:
    """A capsule that comes in until time 8 and is far away from 9 on."""
    x = 2.0 - 0.15 * time if time < 9 else 50.0
    body = affector("capsule", (0.4, 0.4, 0.5), placed((x, 0, 0)), ccd=False, clearance=0.5)
    return {"affectors": (body,), **given}


# --- everything at once ------------------------------------------------------------------

LIVELY = {
    "sim": {"substeps": 2, "seed": 5},
    "rd": {"enabled": True, "preset": "coral", "substeps": 10, "seed_density": 0.02},
    "growth": {
        "rate": 0.05, "birth_rate": 2.0, "life": 0.6, "starve": 0.8, "death_fade": 0.2,
        "birth_fade": 0.2, "size_follow": 0.7, "v_min": 0.05, "v_max": 0.25, "crowd_max": 1.6,
    },
    "settle": {"omega": 6.0, "delay": 0.05},
    "dissolve": {
        "enabled": True, "by": "random", "start": 1.5, "duration": 3.0, "speed": 0.4, "fade": 0.5,
    },
    "particles": {"gravity": (0.0, -0.5, 0.0), "turbulence": 0.3, "drag": 0.7},
    "appearance": {"keep_opacity": True},
}  # fmt: skip


def _bodies(time: float) -> tuple[Affector, ...]:
    """Two capsules that collide, and one affector of every other role, all moving."""
    swing = np.sin(time / 7)
    turn = rotation((0.2, 1, 0.3), time / 9)
    small, large = (0.25, 0.25, 0.5), (0.5, 0.5, 0.3)
    near = placed((1.1 * np.cos(time / 5), 0.6 * swing, 0.9), turn)
    far = placed((-0.9, swing, 0.4 * np.cos(time / 6)), turn.T)
    roles = [
        affector(
            "sphere", (0.6, 0, 0), placed(np.roll((0.9, 0.3 * swing, 0.0), shift)),
            path=f"/b{role}", role=role, amount=amount, falloff=0.4,
        )
        for shift, (role, amount) in enumerate(
            [("seed", 0.6), ("feed", 0.01), ("wind", 0.8), ("growth", 2.0), ("opacity", 0.3)]
        )
    ]  # fmt: skip
    return (
        affector("capsule", small, near, path="/a0", friction=0.6, clearance=0.5, blend=0.05),
        affector("capsule", large, far, path="/a1", friction=0.2, restitution=0.3),
        *roles,
        affector("box", (3, 3, 3), placed((0, 0.6 * swing, 2.2)), path="/m", role="mask",
                 falloff=0.5),
    )  # fmt: skip


def _drivers() -> tuple[Driver, ...]:
    return (
        driver("color", "a", source="v", in_max=0.3, color=(0.9, 0.1, 0.2)),
        driver("scale", "b", source="speed", in_max=2.0, amount=0.7),
        driver("opacity", "c", source="age", in_max=2.0, amount=0.8),
        driver("displacement", "d", source="crowding", in_max=2.0, amount=0.03),
        driver("thickness", "e", source="distance", in_max=0.5, amount=2.0),
    )


def joints(time: float) -> SkinPose:
    """Two: one that stays, one that turns about z and moves up."""
    matrices = np.stack([np.eye(4), placed((0, 0.01 * time, 0), rotation((0, 0, 1), time / 30))])
    return SkinPose(joints=matrices)


def halves(positions: F32) -> SkinBinding:
    """Splats follow one of two joints more, the further they are to its side."""
    share = (0.5 + 0.5 * np.clip(2 * positions[:, 0], -1, 1)).astype(np.float32)
    indices = np.tile(np.array([0, 1], np.int32), (len(share), 1))
    return SkinBinding(indices=indices, weights=np.stack([1 - share, share], 1), bind=np.eye(4))


def on_carriers(count: int = 800) -> Written:
    """Reaction on carriers, bend and curl with a mask, a skin, and everything of `_bodies`."""
    rest = ball(count)
    mask = (0.5 + 0.5 * rest.positions[:, 2]).astype(np.float32)
    parameters = knobs(**LIVELY)

    def says(time: float) -> dict[str, Any]:
        bend = deformer("bend", "a", angle=2 * time, length=1.0)
        curl = deformer("curl", "b", amount=0.05, size=0.7, speed=0.6)
        return {
            "parameters": parameters, "affectors": _bodies(time), "drivers": _drivers(),
            "deformers": (bend, curl), "skin": joints(time), **painted(mask, "deform:a:weight"),
        }  # fmt: skip

    selection = np.ones(count, np.float32)
    selection[::9] = 0
    return Written(rest, says, selection=selection, binding=halves(rest.positions))


def ellipsoid(time: float) -> Surface:
    """A mesh that breathes."""
    mesh = sphere(3, 1.2)
    size = np.array([1.0, 1.2 + 0.2 * np.sin(time / 8), 0.8], np.float32)
    return Surface(points=mesh.points * size, triangles=mesh.triangles)


def on_themselves(count: int = 800) -> Written:
    """The splats themselves react and conform to a mesh that moves, sliding."""
    groups = {
        **LIVELY,
        "rd": {**LIVELY["rd"], "domain": "self"},
        "growth": {**LIVELY["growth"], "rate": 0.0},
        "relax": {"iterations": 4},
        "conform": {"weight": 1.0, "duration": 1.2, "stagger": 0.6, "path": "slide",
                    "scale_mode": "density"},
    }  # fmt: skip
    parameters = knobs(**groups)

    def says(time: float) -> dict[str, Any]:
        return {
            "parameters": parameters, "affectors": _bodies(time), "drivers": _drivers(),
            "target": ellipsoid(time),
        }  # fmt: skip

    return Written(ball(count), says)
