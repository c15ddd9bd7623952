"""Random values of all parameters at once, on small stages.

Oracle of every case: numbers that are finite, the same bits for one thread and two, and an error
that says what is wrong instead of an exception of Python where values cannot be used together.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.cli.conftest import passing_sphere
from tests.sim.recipes import ball
from tests.sim.stage.stages import FIELD, SIM
from usdsplat import schema
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.kernels.device import CpuDevice
from usdsplat.sim.parameters import GROUPS, INSTANCED, camel
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.simulation import Simulation

FEW, MANY = 24, 300
FRAMES = 4
ON = {
    "rd": {"rd:enabled": True}, "accretion": {"rd:enabled": True, "accretion:enabled": True},
    "growth": {"rd:enabled": True, "growth:rate": 0.1, "growth:birthRate": 1.0},
    "matter": {"matter:enabled": True}, "dissolve": {"dissolve:enabled": True},
    "conform": {"conform:weight": 1.0}, "particles": {"particles:enabled": True},
    "refine": {"refine:enabled": "on"}, "mask": {"mask:m:source": "noise"},
    "deform": {"deform:d:type": "bend"}, "driver": {"driver:v:output": "scale"},
}  # fmt: skip
"""Groups -> what turns them on."""
NAMES = {"deform": "d", "driver": "v", "mask": "m"}
LEFT_OUT = {
    "affector:role", "mask:m:source", "mask:m:file", "mask:m:primvar", "mask:m:inputs",
    "conform:orderPrimvar", "sim:maxCount", "sim:startTime", "sim:endTime", "sim:treeLevel",
    "sim:treeSplats", "refine:budget", "carriers:count", "conform:path",
}  # fmt: skip
"""Names of files and primvars, and sizes that only make a case slow."""
MOST = {"sim:substeps": 4, "rd:substeps": 12, "relax:iterations": 4, "matter:iterations": 8}


def drawn(rng: np.random.Generator, name: str, knob: Knob) -> Any:
    """Return a legal value: its default, a limit, or anything between; None leaves it."""
    if knob.choices:
        return rng.choice(np.array(knob.choices, object))
    if knob.type is bool:
        return bool(rng.random() < 0.5)
    if knob.type not in (int, float):
        return None
    low, high = knob.range or (-10.0, 10.0)
    high = min(high, MOST.get(name, 1e4))
    low = max(low, -1e4)
    kind = rng.random()
    if kind < 0.15:
        value = low
    elif kind < 0.25:
        value = min(high, 100.0)
    elif low > 0 or kind < 0.6:  # small numbers are as likely as large ones
        value = max(low, 0.0) + math.exp(rng.uniform(math.log(1e-3), math.log(max(high, 1e-2))))
    else:
        value = rng.uniform(low, min(high, 10.0))
    value = min(max(value, low), high)
    return round(value) if knob.type is int else float(value)


def some_values(rng: np.random.Generator) -> dict[str, Any]:
    """Draw which groups are on, and a third of the parameters of these."""
    found: dict[str, Any] = {"refine:budget": 600, "carriers:count": 200, "sim:maxCount": 900}
    groups = [group for group in ON if rng.random() < 0.35]
    for group in groups:
        found |= ON[group]
    known = {**GROUPS, **INSTANCED}
    for group in (*groups, "sim", "settle", "neighbors", "appearance", "carriers", "relax"):
        for knob in knobs(known.get(group, GROUPS["sim"])) if group in known else ():
            lead = f"{group}:{NAMES[group]}" if group in NAMES else group
            name = f"{lead}:{camel(knob.name)}"
            if name in LEFT_OUT or name in found or rng.random() > 0.33:
                continue
            value = drawn(rng, name, knob)
            if value is not None:
                found[name] = value
    if "mask" in groups:
        found["settle:omega:mask"] = "m"
    return found


def stage_of(seed: int) -> tuple[Usd.Stage, dict[str, Any]]:
    """Return a stage of a few splats, an affector, a target, and random parameters."""
    rng = np.random.default_rng(seed)
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(float(rng.choice([24.0, 24.0, 2.0])))
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, FIELD, ball(int(rng.choice([3, 60, 150]))))
    sim = stage.DefinePrim(SIM, "SplatSim")
    passing_sphere(stage, "/World/Sphere")
    values = some_values(rng)
    author(sim, values)
    if "conform:weight" in values:
        mesh = UsdGeom.Mesh.Define(stage, "/World/Mesh")
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
        mesh.CreateFaceVertexCountsAttr([3, 3, 3, 3])
        mesh.CreateFaceVertexIndicesAttr([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2])
        relationship = sim.CreateRelationship("splatSim:conform:target", custom=False)
        relationship.SetTargets([mesh.GetPath()])
    return stage, values


def played(seed: int, threads: int) -> list[bytes] | str:
    """Return the bytes of all frames, or the sentence of an error."""
    stage, _ = stage_of(seed)
    found = []
    try:
        device = CpuDevice(threads=threads)
        times = [1.0 + number for number in range(FRAMES)]
        simulation = Simulation(stage, times, device=device)
        simulation.begin()
        for number in range(FRAMES):
            if number:
                simulation.advance()
            cloud = simulation.frame(FIELD).cloud
            for name in ("positions", "rotations", "scales", "opacities", "sh"):
                array = getattr(cloud, name)
                assert np.isfinite(array).all(), f"{name} at frame {number}"
                found.append(array.tobytes())
    except UsdSplatError as error:
        assert ": found " in str(error) and ", expected " in str(error)
        return str(error)
    return found


def check(seed: int) -> None:
    """Check one case."""
    one = played(seed, 1)
    assert played(seed, 2) == one, stage_of(seed)[1]


@pytest.mark.parametrize("seed", range(FEW))
def test_any_parameters_give_finite_numbers_and_the_same_bits(seed: int) -> None:
    """Oracle: that of the module."""
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(FEW, MANY))
def test_many_parameters_give_finite_numbers_and_the_same_bits(seed: int) -> None:
    """Oracle: that of the module."""
    check(seed)
