"""`usdsplat validate`."""

from __future__ import annotations

import json

from pxr import Usd


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
    assert run("validate", shot) == (0, f"{shot}: 0 errors, 0 warnings\n", "")
    assert run_json("validate", shot) == []


def test_a_broken_stage_is_status_1_and_says_the_cure(run, shot):
    """Oracle: the one value broken here; a scale of -1 is found, with a
    cure; its splat also reaches out of the extent, as a warning says."""
    break_scales(shot)
    status, out, err = run("validate", shot)
    assert (status, err) == (1, "")
    first, cure, *_ = out.splitlines()
    assert first.startswith("error: /World/Ball.scales: found ")
    assert cure.startswith("  cure: ")
    assert out.splitlines()[-1] == f"{shot}: 1 error, 1 warning"


def test_json_findings_carry_every_field(run, shot):
    """Oracle: the fields of schema.Finding."""
    break_scales(shot)
    status, out, _ = run("validate", shot, "--json")
    finding = json.loads(out)[0]
    assert status == 1
    assert (finding["severity"], finding["path"]) == ("error", "/World/Ball")
    assert finding["attribute"] == "scales"
    assert finding["cure"]


def test_a_missing_stage_is_status_2(run):
    """Oracle: 1 is for findings, 2 for mistakes."""
    status, out, err = run("validate", "missing.usda")
    assert (status, out) == (2, "")
    assert err == "usdsplat: missing.usda: found no such file, expected a USD file\n"
