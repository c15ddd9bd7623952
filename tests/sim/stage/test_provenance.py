"""Tests of the provenance of a bake."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Sdf, Usd, Vt

from tests.schema.clouds import cloud
from tests.schema.test_value_clips import clipped
from tests.sim.stage.bakes import PATH, save_stage
from usdsplat.sim.stage.provenance import input_hash, parameter_hash, parameter_lines

TIMES = (1.0, 2.0, 3.0)


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """A field with parameters of a simulation beside it."""
    stage = save_stage(tmp_path, {PATH: cloud(n=5, degree=0)})
    sim = stage.DefinePrim("/World/Sim")
    sim.CreateAttribute("splatSim:rd:feed", Sdf.ValueTypeNames.Float).Set(0.5)
    stage.Save()
    return stage


def sim(stage: Usd.Stage) -> Usd.Prim:
    return stage.GetPrimAtPath("/World/Sim")


CHANGES: dict[str, Callable[[Usd.Stage], object]] = {
    "value": lambda s: sim(s).GetAttribute("splatSim:rd:feed").Set(0.25),
    "sample": lambda s: sim(s).GetAttribute("splatSim:rd:feed").Set(0.25, 2.0),
    "added": lambda s: (
        sim(s).CreateAttribute("splatSim:rd:kill", Sdf.ValueTypeNames.Float).Set(0.1)
    ),
    "type": lambda s: (
        sim(s).CreateAttribute("splatSim:rd:kill", Sdf.ValueTypeNames.Token).Set("no")
    ),
    "target": lambda s: sim(s).CreateRelationship("splatSim:conform:target").SetTargets([PATH]),
    "weight": lambda s: (
        s.GetPrimAtPath(PATH)
        .CreateAttribute("primvars:splatSim:weight", Sdf.ValueTypeNames.FloatArray)
        .Set(Vt.FloatArray([0, 0, 1, 0, 0]))
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_parameters_count_whatever_they_are(stage: Usd.Stage, name: str) -> None:
    """Oracle: the hash before and after a change, and after it is taken back."""
    before = parameter_hash(stage, TIMES)
    assert parameter_hash(stage, TIMES) == before
    said = stage.GetRootLayer().ExportToString()
    CHANGES[name](stage)
    assert parameter_hash(stage, TIMES) != before
    stage.GetRootLayer().ImportFromString(said)
    assert parameter_hash(stage, TIMES) == before


def test_frames_count_and_other_properties_do_not(stage: Usd.Stage) -> None:
    """Oracle: the hash."""
    before = parameter_hash(stage, TIMES)
    assert parameter_hash(stage, TIMES[:-1]) != before
    sim(stage).CreateAttribute("note", Sdf.ValueTypeNames.String).Set("x")
    assert parameter_hash(stage, TIMES) == before


def test_what_is_chosen_when_a_stage_is_opened_counts(stage: Usd.Stage) -> None:
    """Oracle: the hash; no file differs. A variant on the session layer, then a population mask."""
    sets = sim(stage).GetVariantSets().AddVariantSet("look")
    for name in ("a", "b"):
        sets.AddVariant(name)
    sets.SetVariantSelection("a")
    stage.Save()
    before, files = parameter_hash(stage, TIMES), input_hash(stage)
    masked = Usd.Stage.OpenMasked(stage.GetRootLayer(), Usd.StagePopulationMask(["/World/Sim"]))
    assert parameter_hash(masked, TIMES) != before
    session = stage.GetSessionLayer()
    with Usd.EditContext(stage, session):
        sets.SetVariantSelection("b")
    assert parameter_hash(stage, TIMES) != before
    assert input_hash(stage, without=[session.identifier]) == files


@pytest.mark.parametrize("kind", ["Asset", "AssetArray"])
def test_a_file_of_a_mask_counts_by_its_content_wherever_it_is(
    stage: Usd.Stage, tmp_path: Path, kind: str
) -> None:
    """Oracle: the hash, of the stage in another folder, then with another picture, and with another
    name; and the property that is named."""
    file = sim(stage).CreateAttribute("splatSim:mask:m:file", getattr(Sdf.ValueTypeNames, kind))
    path = Sdf.AssetPath("./mask.png")
    file.Set(path if kind == "Asset" else [path])
    stage.Save()
    (tmp_path / "mask.png").write_bytes(b"one")
    moved = tmp_path.with_name(f"{tmp_path.name} moved")

    def found(folder: Path) -> tuple[str, tuple[str, ...]]:
        opened = Usd.Stage.Open(str(folder / Path(stage.GetRootLayer().realPath).name))
        return parameter_hash(opened, TIMES), parameter_lines(opened, TIMES)

    before = found(tmp_path)
    shutil.copytree(tmp_path, moved)
    assert found(moved) == before
    (moved / "mask.png").write_bytes(b"two")
    other, lines = found(moved)
    assert other != before[0]
    (changed,) = set(lines) - set(before[1])
    assert changed.endswith("  /World/Sim.splatSim:mask:m:file")
    (moved / "mask.png").unlink()
    assert found(moved)[0] not in (before[0], other)


def test_every_file_of_a_stage_is_an_input(stage: Usd.Stage, tmp_path: Path) -> None:
    """Oracle: hashlib over the files; edits in memory count as well."""
    other = Sdf.Layer.CreateNew(str(tmp_path / "other.usda"))
    Sdf.CreatePrimInLayer(other, "/World/More")
    other.Save()
    stage.GetRootLayer().subLayerPaths.append("./other.usda")
    stage.Save()
    expected = [
        f"{hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()}  {name}"
        for name in ("other.usda", "shot.usda")
    ]
    assert list(input_hash(stage)) == expected
    stage.SetEditTarget(stage.GetSessionLayer())
    sim(stage).GetAttribute("splatSim:rd:feed").Set(0.1)
    assert len(input_hash(stage)) == 3
    assert input_hash(stage, [stage.GetSessionLayer().identifier]) == tuple(expected)


def test_a_clip_is_an_input_whether_it_was_read_or_not(tmp_path: Path) -> None:
    """Oracle: the hash, of a stage that has read no clip yet and of the same one later."""
    stage = clipped(tmp_path, "a.usdc")
    before = input_hash(stage)
    stage.GetAttributeAtPath("/F.positions").Get(1)
    assert input_hash(stage) == before
    digest = hashlib.sha256((tmp_path / "a.usdc").read_bytes()).hexdigest()
    assert f"{digest}  a.usdc" in before
