"""Tests of `usdsplat validate`."""

from __future__ import annotations

import json

import pytest
from pxr import Sdf, Usd, UsdGeom

from usdsplat.sim.stage.authoring import author


def break_scales(shot):
    """One deviation of the ball becomes negative."""
    stage = Usd.Stage.Open(str(shot))
    scales = stage.GetPrimAtPath("/World/Ball").GetAttribute("scales")
    values = list(scales.Get())
    values[7] = (-1, 1, 1)
    scales.Set(values)
    stage.GetRootLayer().Save()


def test_a_clean_stage_is_status_0(run, run_json, shot):
    """Oracle: the fixture is written by our own author, which must satisfy our own rules."""
    status, out, err = run("validate", shot)
    assert (status, err) == (0, "")
    assert out.startswith(f"{shot}: 0 errors, 0 warnings; looked at 2 layers, 3 prims, 1 field, ")
    assert run_json("validate", shot)["findings"] == []


def test_a_broken_stage_is_status_1_and_says_the_cure(run, shot):
    """Oracle: the one value broken here; a scale of -1 is found, with a
    cure; its splat also reaches out of the extent, as a warning says."""
    break_scales(shot)
    status, out, err = run("validate", shot)
    assert (status, err) == (1, "")
    first, cure, *_ = out.splitlines()
    assert first.startswith("error [negative-scale] /World/Ball.scales: found ")
    assert cure.startswith("  cure: ")
    assert out.splitlines()[-1].startswith(f"{shot}: 1 error, 1 warning; looked at ")


def test_findings_say_which_published_rule_they_break(run, shot):
    """Oracle: NVIDIA's rule VG.035 asks for scales above 0, and nothing of a colour space."""
    break_scales(shot)
    stage = Usd.Stage.Open(str(shot))
    stage.GetPrimAtPath("/World/Ball").RemoveProperty("colorSpace:name")
    stage.GetRootLayer().Save()
    status, out, _ = run("validate", shot)
    assert status == 1
    assert out.count("  rule: VG.035 of NVIDIA's validator for splats\n") == 1
    told = json.loads(run("validate", shot, "--json")[1])["findings"]
    rules = {finding["code"]: finding["rule"] for finding in told}
    assert (rules["negative-scale"], rules["no-color-space"]) == ("VG.035", "")


def test_json_findings_carry_every_field(run, shot):
    """Oracle: the fields of schema.Finding."""
    break_scales(shot)
    status, out, _ = run("validate", shot, "--json")
    finding = json.loads(out)["findings"][0]
    assert status == 1
    assert (finding["severity"], finding["path"]) == ("error", "/World/Ball")
    assert finding["attribute"] == "scales"
    assert finding["cure"]


def test_a_missing_stage_is_status_2(run):
    """Oracle: 1 is for findings, 2 for mistakes."""
    status, out, err = run("validate", "missing.usda")
    assert (status, out) == (2, "")
    assert err == "usdsplat: missing.usda: found no such file, expected a USD file\n"


@pytest.fixture
def simulation(shot):
    """The shot, and a simulation of it in which a ball acts."""
    stage = Usd.Stage.Open(str(shot))
    author(stage.DefinePrim("/World/Sim", "SplatSim"), {"settle:omega": 2.0})
    sphere = UsdGeom.Sphere.Define(stage, "/World/Sphere")
    author(sphere.GetPrim(), {"affector:friction": 0.1})
    stage.GetRootLayer().Save()
    return stage


def found_in(simulation, run):
    """Findings as (severity, where, name), and the status."""
    simulation.GetRootLayer().Save()
    status, out, _ = run("validate", simulation.GetRootLayer().realPath, "--json")
    found = [
        (x["severity"], f"{x['path']}.{x['attribute']}", x["code"])
        for x in json.loads(out)["findings"]
    ]
    return status, found


def test_nothing_is_wrong_with_a_simulation(simulation, run):
    """Oracle: a stage that `simulate` takes without a word."""
    assert found_in(simulation, run) == (0, [])


@pytest.mark.parametrize(
    ("name", "kind", "values", "expected"),
    [
        ("rd:fed", "float", [0.1], ("warning", "rd:fed", "unknown-name")),
        ("sim:seed", "int", [1, 2], ("warning", "sim:seed", "unused")),
        ("growth:rate", "float", [1.0], ("warning", "growth:rate", "unused")),
        ("settle:omega", "float", [500.0], ("error", "settle:omega", "not-simulated")),
        ("settle:delay", "float", [1.0, -1.0], ("error", "settle:delay", "not-simulated")),
        ("rd:enabled", "string", ["yes"], ("error", "rd:enabled", "not-simulated")),
    ],
)
def test_a_simulations_parameters_are_validated(name, kind, values, expected, simulation, run):
    """Oracle: one finding about the attribute; a value out of range is found at any sample."""
    prim = simulation.GetPrimAtPath("/World/Sim")
    prim.RemoveProperty(f"splatSim:{name}")
    attribute = prim.CreateAttribute(f"splatSim:{name}", Sdf.ValueTypeNames.Find(kind))
    for frame, value in enumerate(values, 1):
        attribute.Set(value, frame if len(values) > 1 else Usd.TimeCode.Default())
    severity, where, what = expected
    status, found = found_in(simulation, run)
    assert found == [(severity, f"/World/Sim.splatSim:{where}", what)]
    assert status == (severity == "error")


def test_what_a_simulation_names_and_is_not_there_is_found(simulation, run):
    """Oracle: a target, a member of a collection and a shape that cannot act."""
    prim = simulation.GetPrimAtPath("/World/Sim")
    prim.CreateRelationship("collection:affectors:includes").SetTargets(["/No"])
    assert ("warning", "/World/Sim.collection:affectors:includes", "unused") in found_in(
        simulation, run
    )[1]
    prim.GetRelationship("collection:affectors:includes").ClearTargets(True)
    prim.CreateRelationship("splatSim:conform:target").SetTargets(["/No"])
    found = found_in(simulation, run)
    assert found[0] == 1
    assert ("error", "/World/Sim.splatSim:conform:target", "not-simulated") in found[1]
    prim.RemoveProperty("splatSim:conform:target")
    author(UsdGeom.Cone.Define(simulation, "/World/Cone").GetPrim(), {"affector:friction": 0.1})
    assert found_in(simulation, run) == (1, [("error", "/World/Cone.", "not-simulated")])


def test_a_bake_without_its_data_is_found(simulation, run, tmp_path):
    """Oracle: nothing before the folder of the data is away, an error after."""
    bake = tmp_path / "bake.usda"
    assert run("simulate", simulation.GetRootLayer().realPath, "-o", bake)[0] == 0
    assert run("validate", bake)[0] == 0
    (tmp_path / "bake_data").rename(tmp_path / "elsewhere")
    status, out, _ = run("validate", bake, "--json")
    found = json.loads(out)["findings"]
    assert status == 1 and [each["code"] for each in found] == ["missing-asset", "no-results"]
    assert "bake_data/samples.usdc" in found[1]["found"]
