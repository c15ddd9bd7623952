"""Tests of registering our types. Each test is a separate process, because the registry is built
once."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from usdsplat.schema.registration import plugin_folder

AUTHOR = """
import numpy as np
from usdsplat.core.cloud import SplatCloud

def cloud():
    return SplatCloud(positions=np.zeros((2, 3), "f4"), scales=np.ones((2, 3), "f4"),
        rotations=np.float32([[1, 0, 0, 0]] * 2), opacities=np.ones(2, "f4"),
        sh=np.ones((2, 4, 3), "f4"))
"""
BUILT_FIRST = "from pxr import Usd; s = Usd.Stage.CreateInMemory(); s.DefinePrim('/X', 'Xform')\n"


def run(code: str, *, plugin_path: bool = False) -> subprocess.CompletedProcess[str]:
    """Run Python code; stdout and stderr are captured."""
    environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
    if plugin_path:
        environment["PXR_PLUGINPATH_NAME"] = str(plugin_folder())
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_importing_first_makes_the_types_known_without_building_the_registry() -> None:
    """Oracle: USD: a plug-in that comes after the import is still taken, so none was built."""
    code = """
import json, pathlib, tempfile
import usdsplat.schema
from pxr import Plug, Usd
folder = pathlib.Path(tempfile.mkdtemp())
(folder / "generatedSchema.usda").write_text('#usda 1.0\\nclass Late "Late" {}\\n')
info = {"Plugins": [{"Type": "resource", "Name": "late", "Root": ".", "ResourcePath": ".",
    "LibraryPath": "", "Info": {"Types": {"TypeLate": {"alias": {"UsdSchemaBase": "Late"},
    "bases": ["UsdTyped"], "schemaKind": "concreteTyped", "schemaIdentifier": "Late"}}}}]}
(folder / "plugInfo.json").write_text(json.dumps(info))
Plug.Registry().RegisterPlugins(str(folder))
find = Usd.SchemaRegistry().FindConcretePrimDefinition
assert find("ParticleFieldPackedSplat") and find("Late")
"""
    done = run(code)
    assert (done.returncode, done.stderr) == (0, "")


def test_too_late_stock_works_and_packed_says_how_to_cure_it() -> None:
    """Oracle: the documented behaviour, and a clean stderr."""
    code = (
        BUILT_FIRST
        + AUTHOR
        + """
import usdsplat.schema as schema
from usdsplat.core.errors import SchemaUnavailableError
hints = schema.DrawingHints(rasterize_mode="antialiased")
prim = schema.author(s, "/Stock", cloud(), drawing=hints)
assert schema.fetch(prim).sh.sum() == 24 and schema.rasterize_mode(prim) == "antialiased"
assert {finding.path for finding in schema.validate(s)} == {"/"}
for action in (lambda: schema.author(s, "/Packed", cloud(), form="packed"),
               lambda: schema.fetch(s.DefinePrim("/P", "ParticleFieldPackedSplat"))):
    try:
        action()
    except SchemaUnavailableError as error:
        print(error)
assert not s.GetPrimAtPath("/Packed")
"""
    )
    done = run(code)
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first.startswith("/Packed: found no ParticleFieldPackedSplat")
    assert second.startswith("/P: found no ParticleFieldPackedSplat")
    assert f"PXR_PLUGINPATH_NAME={plugin_folder()}" in first


def test_the_cure_works() -> None:
    """Oracle: the same order of events with the line that the error gives."""
    code = (
        BUILT_FIRST
        + AUTHOR
        + """
import usdsplat.schema as schema
prim = schema.author(s, "/Packed", cloud(), form="packed")
assert len(schema.fetch(prim)) == 2
"""
    )
    done = run(code, plugin_path=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("plugin_path", [False, True])
def test_a_packed_file_falls_back_to_its_base_type_without_our_plugin(
    tmp_path, plugin_path
) -> None:
    """Oracle: USD's own IsA in a process that never heard of us, unless told by the environment."""
    path = tmp_path / "packed.usdc"
    code = (
        AUTHOR
        + f"""
import usdsplat.schema as schema
from pxr import Usd
s = Usd.Stage.CreateInMemory()
schema.author(s, "/Packed", cloud(), form="packed")
s.Export({str(path)!r})
"""
    )
    assert run(code).returncode == 0
    look = f"""
from pxr import Usd, UsdVol
s = Usd.Stage.Open({str(path)!r})
p = s.GetPrimAtPath("/Packed")
print(p.IsA(UsdVol.ParticleField), p.GetPrimTypeInfo().GetSchemaTypeName())
"""
    expected = "True ParticleFieldPackedSplat" if plugin_path else "True ParticleField"
    assert run(look, plugin_path=plugin_path).stdout.strip() == expected
