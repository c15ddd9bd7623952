"""Generate plugInfo/ from schema.usda and simulation.usda, and the plug-in of the validators:
`python -m usdsplat.schema.generate [--check]`.

Runs USD's own generator in a separate process; it needs jinja2 from the dev extra. Then replaces
its first sentences by the full documentation. Documentation of inherited properties is dropped,
because its wording changes between USD versions. The validators are a plug-in in a folder of its
own: they need our Python package, which schemas do not.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pxr import Sdf

from usdsplat.schema.registration import VALIDATORS_NAME, plugin_folder, validators_folder
from usdsplat.schema.validation import TREES, VALIDATORS

SOURCES = (
    Path(__file__).with_name("schema.usda"),
    Path(__file__).with_name("simulation.usda"),
)
"""Schema sources; simulation.usda is itself generated from the simulation's parameters."""
VALIDATED_TYPES = ["UsdVolParticleField3DGaussianSplat", "UsdSplatParticleFieldPackedSplat"]
VALIDATED_TREES = ["UsdSplatParticleFieldSplatTree"]

_BRIEF = "userDocBrief"
_INSTANCE = "__INSTANCE_NAME__"
"""Placeholder between prefix and name in the generated properties of a multiple-apply schema."""


def generate() -> dict[Path, str]:
    """Return the text of each generated file by its path.

    Raises:
        subprocess.CalledProcessError: If USD's generator rejects the schema or lacks jinja2.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "schema.usda"), Path(folder, "out")
        target.mkdir()
        own = _merged()
        source.write_text(_documented(own), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "pxr.Usd.usdGenSchema",
            "--quiet",
            str(source),
            str(target),
        ]
        # With our plug-in registered, the generator would find these classes twice.
        environment = {k: v for k, v in os.environ.items() if k != "PXR_PLUGINPATH_NAME"}
        # Under -m, USD is loaded before the generator can set this itself. Without it, the
        # generator fails on API schemas with built-in API schemas.
        environment["USD_DISABLE_PRIM_DEFINITIONS_FOR_USDGENSCHEMA"] = "true"
        subprocess.run(command, check=True, capture_output=True, env=environment)
        schema = (target / "generatedSchema.usda").read_text(encoding="utf-8")
        plugin = (target / "plugInfo.json").read_text(encoding="utf-8")
    return {
        plugin_folder() / "generatedSchema.usda": _without_inherited(schema, own),
        plugin_folder() / "plugInfo.json": _completed(plugin),
        validators_folder() / "plugInfo.json": _validators(),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Write the files, or with --check list stale ones; return 1 if --check finds any."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args(argv).check
    stale = 0
    for path, text in generate().items():
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale += 1
        if not check:
            path.write_text(text, encoding="utf-8")
        print(f"{path}: {'stale' if check else 'written'}")
    return 1 if check and stale else 0


def _merged() -> Sdf.Layer:
    """Return all classes in one layer, because the generator reads a single file."""
    first, *others = (_parse(path.read_text(encoding="utf-8")) for path in SOURCES)
    for layer in others:
        for prim in layer.rootPrims:
            Sdf.CopySpec(layer, prim.path, first, prim.path)
    return first


def _documented(own: Sdf.Layer) -> str:
    """Return the schema's text with full documentation in `userDocBrief`."""
    layer = _parse(own.ExportToString())
    for prim in layer.rootPrims:
        for spec in (prim, *prim.properties):
            if spec.documentation:
                spec.customData[_BRIEF] = inspect.cleandoc(spec.documentation)
    return layer.ExportToString()


def _without_inherited(text: str, own: Sdf.Layer) -> str:
    """Drop the documentation of properties that our sources do not declare."""
    layer = _parse(text)
    for prim in layer.rootPrims:
        for spec in prim.properties:
            name = spec.name.rpartition(f"{_INSTANCE}:")[2]
            if not own.GetPropertyAtPath(prim.path.AppendProperty(name)):
                spec.ClearInfo("customData")
    return layer.ExportToString()


def _completed(text: str) -> str:
    """Return plugInfo.json with the generator's placeholders filled in."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    info: dict[str, Any] = json.loads("\n".join(lines))
    info["Plugins"][0].update(LibraryPath="", ResourcePath=".", Root=".")
    return json.dumps(info, indent=4) + "\n"


def _validators() -> str:
    """Return plugInfo.json of the validators: a plug-in that imports our package."""
    validators = {
        name: {
            "doc": text,
            "schemaTypes": VALIDATED_TREES if name == TREES else VALIDATED_TYPES,
            "isTimeDependent": True,
        }
        for name, text in VALIDATORS.items()
    }
    plugin = {
        "Type": "python",
        "Name": VALIDATORS_NAME,
        "Info": {"Validators": {**validators, "keywords": ["usdsplat"]}},
    }
    return json.dumps({"Plugins": [plugin]}, indent=4) + "\n"


def _parse(text: str) -> Sdf.Layer:
    """Parse text into an anonymous layer without composing it."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    return layer


if __name__ == "__main__":
    raise SystemExit(main())
