"""Tests of `usdsplat plugin-path`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from usdsplat.schema import registration


def test_the_folders_hold_our_schemas_and_the_plugin_of_usdview(run):
    """Oracle: the plugInfo.json in each, in USD's own words."""
    status, out, err = run("plugin-path")
    assert (status, err) == (0, "")
    folders = [Path(folder) for folder in out.strip().split(os.pathsep)]
    told = [json.loads((folder / "plugInfo.json").read_text())["Plugins"] for folder in folders]
    schemas, (viewport,) = told
    assert [plugin["Type"] for plugin in schemas] == ["resource"]
    assert "UsdSplatParticleFieldPackedSplat" in schemas[0]["Info"]["Types"]
    assert viewport["Type"] == "python"
    assert [*viewport["Info"]["Types"]] == [f"{viewport['Name']}.UsdSplatContainer"]


def test_the_folders_are_told_as_json(run):
    """Oracle: the line without --json."""
    _, plain, _ = run("plugin-path", "--validators")
    status, out, err = run("plugin-path", "--validators", "--json")
    assert (status, err) == (0, "")
    folders = plain.strip().split(os.pathsep)
    assert json.loads(out) == {"variable": "PXR_PLUGINPATH_NAME", "folders": folders}


def test_the_validators_are_added_only_on_request(run):
    """Oracle: the plugInfo.json of the third folder, and the first two as without the flag."""
    _, plain, _ = run("plugin-path")
    _, out, _ = run("plugin-path", "--validators")
    *rest, last = out.strip().split(os.pathsep)
    assert os.pathsep.join(rest) == plain.strip()
    (plugin,) = json.loads((Path(last) / "plugInfo.json").read_text())["Plugins"]
    assert "SplatArrays" in plugin["Info"]["Validators"]


def test_a_usd_without_validators_of_python_is_one_sentence(run, monkeypatch):
    """Oracle: the sentence; usd-core 26.3 has no `RegisterPluginPrimValidator`."""
    monkeypatch.setattr(registration, "VALIDATORS_SINCE", (99, 0, 0))
    status, out, err = run("plugin-path", "--validators")
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: --validators: found a USD that takes none from Python")


@pytest.mark.skipif(os.name == "nt", reason="a shell of Unix")
@pytest.mark.parametrize("before", [None, "/else where"])
def test_a_shell_takes_the_exported_line(run, before):
    """Oracle: what sh has in the variable after the line; no empty entry, of which USD warns."""
    _, folders, _ = run("plugin-path")
    _, line, _ = run("plugin-path", "--export")
    environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
    if before is not None:
        environment["PXR_PLUGINPATH_NAME"] = before
    script = f'{line}\nprintf %s "$PXR_PLUGINPATH_NAME"'
    shell = subprocess.run(
        ["sh", "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert shell.stdout == ":".join(filter(None, (folders.strip(), before)))


def test_other_processes_know_our_types_by_the_variable(run):
    """Oracle: USD's schema registry in a process that never imports usdsplat."""
    _, folders, _ = run("plugin-path")
    code = (
        "from pxr import Usd; print(Usd.SchemaRegistry().FindConcretePrimDefinition('{}') != None)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code.format("ParticleFieldPackedSplat")],
        env={**os.environ, "PXR_PLUGINPATH_NAME": folders.strip()},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (process.stdout, process.stderr) == ("True\n", "")
