"""USD's own validators on files that we write, in this process and in one without our plug-ins."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd, UsdValidation

from usdsplat.schema import registration

registration.register()  # before the first stage

_WITHOUT = """
import json, sys

class Without:
    def find_spec(self, name, *_):
        if name.split(".")[0] == "usdsplat":
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Without())
from pxr import Usd, UsdGeom, UsdValidation
assert not Usd.SchemaRegistry().FindConcretePrimDefinition("ParticleFieldPackedSplat")
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
context = UsdValidation.ValidationContext(validators)
told = {}
for path in sys.argv[1:]:
    stage = Usd.Stage.Open(path)
    root = stage.GetDefaultPrim() or stage.GetPseudoRoot()
    time = Usd.TimeCode.EarliestTime()
    told[path] = {
        "errors": [f"{error.GetName()}: {error.GetMessage()}" for error in context.Validate(stage)],
        "shown": [
            str(prim.GetPath())
            for prim in stage.Traverse()
            if prim.IsA(UsdGeom.Points)
            and UsdGeom.Imageable(prim).ComputeVisibility() == "inherited"
        ],
        "bounded": [
            not UsdGeom.BBoxCache(time, ["default", "proxy"], use).ComputeWorldBound(root)
            .GetRange().IsEmpty()
            for use in (False, True)
        ],
    }
print(json.dumps(told))
"""


@cache
def _validators() -> list[Any]:
    return list(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())


def errors(path: Path) -> list[str]:
    """What all validators that USD has here, ours among them, say about a file."""
    stage = Usd.Stage.Open(str(path))
    found = UsdValidation.ValidationContext(_validators()).Validate(stage)
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found]


def without_plugin(paths: Iterable[Path]) -> dict[Path, dict[str, Any]]:
    """What a process that has nothing of ours sees: errors, visible points, and whether the stage
    is bounded, without and with its hints."""
    environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
    command = [sys.executable, "-c", _WITHOUT, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return {Path(path): told for path, told in json.loads(done.stdout).items()}


def is_ours(path: Path) -> bool:
    """Return whether a file is a stage that says that we made it.

    The topology of value clips is a layer below one: its arrays are in the clips.
    """
    if path.name == "topology.usda":
        return False
    try:
        layer = Sdf.Layer.FindOrOpen(str(path)) if path.is_file() else None
    except Tf.ErrorException:
        return False
    creator = layer.customLayerData.get("creator", "") if layer else ""
    return str(creator).startswith("usdsplat")
