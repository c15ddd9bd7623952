"""Tests of `usdsplat doctor`."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys

import usdsplat
from usdsplat.cli import doctor
from usdsplat.kernels import ahead, store
from usdsplat.kernels.cuda import support
from usdsplat.schema.registration import plugin_folder


def lines(run_json):
    """The lines by name; names are unique within a section."""
    found = run_json("doctor")
    return {(section, line["name"]): line for section, all_ in found.items() for line in all_}


def test_versions_are_those_of_the_installed_packages(run_json):
    """Oracle: importlib.metadata."""
    found = lines(run_json)
    assert found["usdsplat", "version"]["found"] == usdsplat.__version__
    for name in ("numpy", "numba", "usd-core"):
        assert found["packages", name]["found"] == importlib.metadata.version(name)
    assert found["USD plug-ins", "schemas"]["found"] == str(plugin_folder())
    assert found["USD plug-ins", "types"]["found"] == "known to USD in this process"


def test_a_missing_package_is_named_with_what_it_is_for(run, monkeypatch):
    """Oracle: the requirements, written out."""
    asked = [
        "numpy>=2.0",
        "brush",
        'PySide6-Essentials>=6.6; extra == "view"',
        "ruff; extra == 'dev'",
    ]
    monkeypatch.setattr(doctor.importlib.metadata, "requires", lambda _: asked)

    def version(name):
        if name != "numpy":
            raise importlib.metadata.PackageNotFoundError(name)
        return "2.2.0"

    monkeypatch.setattr(doctor.importlib.metadata, "version", version)
    status, out, err = run("doctor")
    packages = out[out.index("packages\n") : out.index("devices\n")].splitlines()
    assert (status, err) == (1, "")  # brush is needed
    assert packages[1:] == [
        "  numpy                  2.2.0",
        "  brush                  missing",
        "    -> pip install brush",
        "  PySide6-Essentials     not installed; needed for the window of 'view'",
        "    -> pip install 'usdsplat[view]'",
    ]


def test_it_says_what_lacks_also_where_it_cannot_know_the_rest():
    """Oracle: by hand: a Python without Numba, and with a USD that no installer knows."""
    code = """
import importlib.metadata, sys
known = importlib.metadata.version
def version(name):
    if name in ("numba", "usd-core"):
        raise importlib.metadata.PackageNotFoundError(name)
    return known(name)
importlib.metadata.version = version
sys.modules["numba"] = None
from usdsplat.cli.main import main
sys.exit(main(["doctor", "--json"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (1, "")
    told = json.loads(done.stdout)
    packages = {line["name"]: line for line in told["packages"]}
    assert packages["numba"]["cure"] == "pip install numba"
    assert packages["usd-core"]["found"] == "none, but the pxr of another USD is there"
    assert all(told[section] for section in ("devices", "kernels", "USD plug-ins"))


def test_the_rest_of_a_section_may_need_what_lacks():
    """Oracle: by hand."""

    def section():
        yield doctor.Line(name="CPU", found="2 cores")
        raise ImportError("no module", name="numba")

    rest = doctor.Line(name="the rest", found="cannot be known without numba")
    assert doctor._known(section()) == [doctor.Line(name="CPU", found="2 cores"), rest]


def test_a_cache_that_cannot_be_written_is_named(run_json, tmp_path, monkeypatch):
    """Oracle: the answer of the system, for the nearest folder that exists."""
    monkeypatch.setattr(store, "_chosen", tmp_path / "new" / "kernels")
    monkeypatch.setattr(doctor.os, "access", lambda path, _: path != tmp_path)
    assert lines(run_json)["kernels", "access"]["found"] == "read only"
    monkeypatch.setattr(doctor.os, "access", lambda path, _: path == tmp_path)
    assert ("kernels", "access") not in lines(run_json)


def test_kernels_that_are_not_compiled_have_a_cure(run_json, tmp_path, monkeypatch):
    """Oracle: an empty folder, then the note that `compile` leaves."""
    monkeypatch.setattr(support, "has_gpu", lambda: False)
    monkeypatch.setattr(store, "_chosen", tmp_path)
    found = lines(run_json)
    assert found["kernels", "stored"]["found"].startswith("0 files, ")
    assert found["kernels", "cpu"]["cure"] == "usdsplat compile"
    ahead.note("cpu", None)
    found = lines(run_json)
    assert found["kernels", "stored"]["found"].startswith("1 file, ")
    assert found["kernels", "cpu"] == {
        "name": "cpu", "found": "all compiled", "cure": "", "is_needed": False,
    }  # fmt: skip


def test_a_gpu_without_its_packages_has_the_command_that_installs_them(run_json, monkeypatch):
    """Oracle: the values that the driver would give, put in its place."""
    monkeypatch.setattr(support, "capability", lambda: (9, 0))
    monkeypatch.setattr(support, "gpu_count", lambda: 2)
    monkeypatch.setattr(support, "obstacle", lambda: ("no package numba-cuda", support.INSTALL))
    gpu = lines(run_json)["devices", "GPU"]
    assert (gpu["found"], gpu["cure"]) == ("2 GPUs, compute capability 9.0", support.INSTALL)


def test_plugins_and_settings_of_the_environment_are_seen(run_json, monkeypatch, tmp_path):
    """Oracle: the variables, as they are set here."""
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", f"/nowhere{os.pathsep}{plugin_folder()}")
    monkeypatch.setenv("OCIO", str(tmp_path / "config.ocio"))
    found = lines(run_json)
    assert found["USD plug-ins", "other applications"]["found"] == "on PXR_PLUGINPATH_NAME"
    assert found["environment", "OCIO"]["cure"] == "name a config that exists, or unset it"
    monkeypatch.setenv("OCIO", "ocio://default")
    assert lines(run_json)["environment", "OCIO"]["cure"] == ""
