"""Tests of simulations that cannot be done as asked: they do something else, and say so."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.cli.test_hostile_simulations import FIELD, SIM, make, sphere
from usdsplat import schema
from usdsplat.sim.stage.authoring import author

LINE = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
RUBBER = {"matter:enabled": True, "matter:material": "rubber"}
GROW = {
    "rd:enabled": True, "accretion:enabled": True, "accretion:style": "coral",
    "rd:frontSpeed": 5.0, "rd:seeds": 3,
}  # fmt: skip
ONTO = {"conform:weight": 1.0}


def sets(values):
    """What authors parameters."""
    return lambda stage: author(stage.GetPrimAtPath(SIM), values)


def onto(points):
    """What adds a triangle to conform to."""

    def edit(stage):
        mesh = UsdGeom.Mesh.Define(stage, "/World/Target")
        mesh.CreatePointsAttr(points)
        mesh.CreateFaceVertexCountsAttr([3])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
        relationship = stage.GetPrimAtPath(SIM).CreateRelationship("splatSim:conform:target")
        relationship.SetTargets([mesh.GetPath()])

    return edit


def slow(stage):
    """Five seconds a frame."""
    stage.SetTimeCodesPerSecond(0.2)


CASES = {
    "flat target": (40, [onto(LINE), sets(ONTO)], "flat-target", "splats move to the closest"),
    "point target": (40, [onto([(1, 1, 1)] * 3), sets(ONTO)], "flat-target", "closest points"),
    "three onto": (3, [onto(TRIANGLE), sets(ONTO)], "no-carriers", "found 3 splats without a"),
    "one of rubber": (1, [sphere(), sets(RUBBER)], "no-carriers", "its splats move alone"),
    "three of stone": (
        3, [sphere(), sets({**RUBBER, "matter:material": "stone"})], "no-carriers",
        "without matter",
    ),
    "growth on splats": (
        40, [sets({**GROW, **RUBBER, "rd:domain": "self"})], "unused",
        "found new matter and rd:domain self, expected rd:domain carrier",
    ),
    "growth without room": (
        400, [sets({**GROW, "sim:maxCount": 400, "refine:enabled": "off"})], "no-room",
        "found 400, with 400 splats before growth, expected up to",
    ),
    "weak matter": (
        40,
        [sphere(), sets({"matter:enabled": True, "matter:tear": 1.1, "matter:stretch": 2.0})],
        "weak-matter", "found 1.1, and a stretch limit of 2",
    ),
    "small budget": (
        40, [sets({"rd:enabled": True, "refine:maxSize": 0.01, "refine:budget": 1})],
        "large-splats", "none is divided",
    ),
    "vast ball": (40, [sphere(1e6)], "vast-affector", "found /World/Ball, of 1e+06, and a capture"),
    "vast ball, rubber": (40, [sphere(1e6), sets(RUBBER)], "vast-affector", "moved that far"),
    "slow": (40, [slow, sphere()], "long-steps", "found steps of 1.25 s, expected at most 0.25 s"),
    "slow sand": (
        40, [slow, sphere(), sets({**RUBBER, "matter:material": "sand"})], "long-steps", "1.25 s",
    ),
    "slow growth": (40, [slow, sets(GROW)], "long-steps", "1.25 s"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda name: name.replace(" ", "_"))
def test_what_cannot_be_done_is_said_and_the_result_is_finite(run, tmp_path, case):
    """Oracle: the finding, status 0, numbers that are finite, and status 1 with --strict."""
    count, edits, code, sentence = CASES[case]
    stage = make(tmp_path / "shot.usda", count)
    for edit in edits:
        edit(stage)
    stage.Save()
    words = ("simulate", tmp_path / "shot.usda", "-o", tmp_path / "bake.usda", "--frames", "1:4")
    status, _, err = run(*words)
    assert status == 0
    (line,) = (line for line in err.splitlines() if f"[{code}]" in line)
    assert sentence in line and "warning" in line
    baked = Usd.Stage.Open(str(tmp_path / "bake.usda"))
    for frame in (1, 4):
        cloud = schema.fetch(baked.GetPrimAtPath(FIELD), frame)
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            assert np.isfinite(getattr(cloud, name)).all()
    status, _, err = run(*words, "--force", "--strict")
    assert status == 1 and f"[{code}]" in err


def test_what_can_be_done_says_nothing(run, tmp_path):
    """Oracle: no finding for usual values of the same parameters."""
    stage = make(tmp_path / "shot.usda", 400)
    for edit in (sphere(), onto(TRIANGLE), sets({**ONTO, "matter:enabled": True})):
        edit(stage)
    stage.Save()
    words = ("simulate", tmp_path / "shot.usda", "-o", tmp_path / "bake.usda", "--frames", "1:2")
    status, _, err = run(*words)
    codes = ("no-carriers", "flat-target", "weak-matter", "long-steps", "vast-affector", "no-room")
    assert status == 0 and not [code for code in codes if f"[{code}]" in err]


def test_matter_that_may_grow_in_few_places_has_room(run, tmp_path):
    """Oracle: ten selected splats of 400, of whose carriers all new matter has room."""
    stage = make(tmp_path / "shot.usda", 400)
    sets({**GROW, "sim:maxCount": 900, "refine:enabled": "off"})(stage)
    weight = stage.GetPrimAtPath(FIELD).CreateAttribute(
        "primvars:splatSim:weight", Sdf.ValueTypeNames.FloatArray
    )
    weight.Set([float(number < 10) for number in range(400)])
    stage.Save()
    bake = tmp_path / "bake.usda"
    status, _, err = run("simulate", tmp_path / "shot.usda", "-o", bake, "--frames", "1:2")
    assert status == 0 and "[no-room]" not in err


@pytest.mark.parametrize(("most", "said"), [(4_000_000, []), (600, ["note"])])
def test_new_matter_that_lacks_room_on_some_carriers_is_a_note(run, tmp_path, most, said):
    """Oracle: the finding's severity, and the number of splats, which is at most what was asked."""
    stage = make(tmp_path / "shot.usda", 400)
    sets({**GROW, "sim:maxCount": most, "refine:enabled": "off", "rd:frontSpeed": 500.0})(stage)
    stage.Save()
    bake = tmp_path / "bake.usda"
    status, _, err = run("simulate", tmp_path / "shot.usda", "-o", bake, "--frames", "1:4")
    lines = [line for line in err.splitlines() if "[no-room]" in line]
    assert status == 0 and len(lines) == len(said)
    assert all("usdsplat: note" in line and "growth ends before" in line for line in lines)
    baked = Usd.Stage.Open(str(bake))
    count = len(schema.fetch(baked.GetPrimAtPath(FIELD), 4))
    assert 400 < count <= most
