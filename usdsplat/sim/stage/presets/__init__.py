"""Presets: simulations that are ready to run, with a capture, affectors and parameters to edit.

Each is a module of this package that defines a `Preset`; `PRESETS` lists them, and the command's
flags and help derive from it. All sizes derive from the capture: from the box that contains nine
tenths of its splats along each axis. Affectors and targets have the purpose guide.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.readable import check_referable
from usdsplat.schema.layer_times import scale_times
from usdsplat.schema.lod_roots import find_roots
from usdsplat.schema.stage_values import stage_unit, up_axis
from usdsplat.schema.usd_files import export_layer
from usdsplat.sim.stage.presets.conform import CONFORM
from usdsplat.sim.stage.presets.dissolve import DISSOLVE
from usdsplat.sim.stage.presets.grow import GROW
from usdsplat.sim.stage.presets.morph import MORPH
from usdsplat.sim.stage.presets.preset import Choice, OptionName, Preset, PresetOption
from usdsplat.sim.stage.presets.push import PUSH
from usdsplat.sim.stage.presets.scene import FIRST, LAST, RATE, measured
from usdsplat.sim.stage.presets.shatter import SHATTER
from usdsplat.sim.stage.presets.wade import WADE
from usdsplat.sim.stage.trees import is_simulated

__all__ = ["PRESETS", "OptionName", "Preset", "PresetOption", "author_preset", "find_preset"]

PRESETS: dict[str, Preset] = {
    each.name: each for each in (GROW, PUSH, WADE, CONFORM, MORPH, DISSOLVE, SHATTER)
}
"""Presets by name, in the order of the help."""


def find_preset(name: str, *, where: str = "preset") -> Preset:
    """Return the preset of a name.

    Args:
        name: The name.
        where: Origin of the name in error messages.

    Raises:
        UsageError: If there is none.
    """
    if name not in PRESETS:
        raise UsageError(where, repr(name), f"one of {', '.join(PRESETS)}")
    return PRESETS[name]


def author_preset(
    name: str,
    capture: Usd.Stage,
    target: Path | str,
    *,
    last: int = LAST,
    options: Mapping[str, str | None] | None = None,
    goal: Usd.Stage | None = None,
    edits: Sdf.Layer | None = None,
) -> None:
    """Write a stage in which a capture is simulated, from frame 1 on at 24 frames per second.

    It has the capture as a sublayer, a SplatSim prim `Simulation/Sim` under the capture's default
    prim, and the affectors beside it.

    Args:
        name: A key of `PRESETS`.
        capture: A stage from a file, with one splat field or splat tree.
        target: A .usda or .usdc file, replaced when complete; it refers to the capture by a
            relative path.
        last: Frame at which affectors have passed and patterns have formed, at least 24.
        options: Values by the names of options, such as {"style": "coral"}; None stands for an
            option that is not given. The option target is `goal`.
        goal: A stage from a file, with meshes to conform to or a capture to become.
        edits: Opinions over the capture's, such as those of a session layer. The new stage has
            them, and the preset is made for the capture as they leave it.

    Raises:
        UsageError: If there is no such preset, or it does not take an option or its value.
        StageError: If the stage is not from a file, or from one of a name that a layer cannot refer
            to, does not have exactly one field or tree, or has a simulation; or if `goal` has not
            what the preset needs.
        OutputError: If the target cannot be written.
    """
    preset = find_preset(name)
    given = None if goal is None else goal.GetRootLayer().identifier
    chosen = preset.chosen({**(options or {}), "target": given})
    field, file = _only_field(capture), Path(capture.GetRootLayer().realPath)
    check_referable(file)
    final = Path(os.path.realpath(target))
    if file == final:
        raise UsageError("target", str(target), "another file than the capture's")
    stage = Usd.Stage.CreateInMemory()
    root = stage.GetRootLayer()
    if edits is not None:
        root.TransferContent(edits)
        scale_times(root, RATE / edits.timeCodesPerSecond)
    root.subLayerPaths.append(str(file))
    UsdGeom.SetStageUpAxis(stage, up_axis(capture))
    UsdGeom.SetStageMetersPerUnit(stage, stage_unit(capture))
    for setter in (stage.SetFramesPerSecond, stage.SetTimeCodesPerSecond):
        setter(RATE)
    stage.SetStartTimeCode(FIRST)
    stage.SetEndTimeCode(last)
    if capture.GetDefaultPrim():
        root.defaultPrim = capture.GetRootLayer().defaultPrim
    scene = measured(stage, field, last)
    UsdGeom.Scope.Define(stage, scene.parent)
    sim = stage.DefinePrim(scene.parent.AppendChild("Sim"), "SplatSim")
    _include(sim, "splats", field.GetPath())
    _include(sim, "affectors", scene.parent)
    preset.author(scene, sim, Choice(name=None if goal else chosen, goal=goal))
    copy = Sdf.Layer.CreateAnonymous(".usda")  # of no stage, which would look for the capture
    copy.TransferContent(root)
    for used in (capture, goal):
        if used is not None:
            layer = used.GetRootLayer().realPath
            copy.UpdateCompositionAssetDependency(layer, _relative(Path(layer), final.parent))
    export_layer(copy, final)


def _only_field(capture: Usd.Stage) -> Usd.Prim:
    """Return the only field or tree of the stage."""
    where = capture.GetRootLayer().identifier
    if not capture.GetRootLayer().realPath:
        raise StageError(where, "a stage without a file", "one that can be a sublayer")
    roots = find_roots(capture)
    everything = (prim for prim in capture.Traverse() if not roots.is_replaced(prim))
    fields = list(filter(is_simulated, everything))
    if len(fields) != 1:
        raise StageError(where, f"{len(fields)} splat fields", "one")
    for prim in capture.Traverse():
        if prim.GetTypeName() == "SplatSim":
            raise StageError(where, f"the simulation {prim.GetPath()}", "a capture without one")
    return fields[0]


def _include(sim: Usd.Prim, name: str, path: Sdf.Path) -> None:
    """Include a prim in a collection of the simulation."""
    sim.CreateRelationship(f"collection:{name}:includes", custom=False).SetTargets([path])


def _relative(file: Path, folder: Path) -> str:
    """Return the path of a file relative to a folder, with forward slashes."""
    path = Path(os.path.relpath(file, folder)).as_posix()
    return path if path.startswith("../") else f"./{path}"
