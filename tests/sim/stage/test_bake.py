"""Tests that a bake contains the simulated values, at every sample and between samples."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from tests.schema.clouds import cloud
from tests.sim.stage.bakes import PATH, everything, layer_of, save_stage, shot
from usdsplat import schema
from usdsplat.core import quaternion
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.extent import REACH
from usdsplat.schema import tokens
from usdsplat.sim.stage.epochs import BEFORE, UNBORN_SCALE

HALF_ULP = 2.0**-10
ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")


def field(path: Path, where: str = PATH) -> Usd.Prim:
    """The prim on a stage that is kept open by it."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath(where)
    prim.holder = stage
    return prim


def rows(of: SplatCloud, found: SplatCloud) -> np.ndarray:
    """Where the splats of one cloud are in another."""
    at = np.searchsorted(found.ids, of.ids)
    np.testing.assert_array_equal(found.ids[at], of.ids)
    return at


@pytest.mark.parametrize("mode", ["dense", "clips"])
@pytest.mark.parametrize("form", ["float", "half", "packed"])
@pytest.mark.parametrize("lives", [True, False], ids=["births", "fixed"])
def test_22_every_sample_is_the_state(tmp_path: Path, mode: str, form: str, lives: bool) -> None:
    """Oracle: the solver's own arrays: exact in float, within one unit in the last place in half.
    Splats that are not alive have no opacity."""
    bake = shot(tmp_path, mode, form=form, lives=lives)
    prim = field(bake.run())
    for frame in bake.frames[PATH]:
        found = schema.fetch(prim, frame.time)
        at = rows(frame.cloud, found)
        np.testing.assert_array_equal(found.positions[at], frame.cloud.positions)
        for name in ARRAYS:
            actual, expected = getattr(found, name)[at], getattr(frame.cloud, name)
            if form == "half":
                np.testing.assert_allclose(
                    actual, expected, rtol=HALF_ULP, atol=2e-7 + 1e-3 * (name == "rotations")
                )
            else:
                np.testing.assert_array_equal(actual, expected)
        absent = np.setdiff1d(np.arange(len(found)), at)
        assert not found.opacities[absent].any()
        assert lives or len(found) == len(frame.cloud)


@pytest.mark.parametrize("mode", ["dense", "clips", "packed"])
def test_between_frames_splats_are_on_lines(tmp_path: Path, mode: str) -> None:
    """Oracle: the mean of both frames, for all that live at both, at births, deaths and ends of
    epochs too; those that begin or end fade half way."""
    bake = shot(tmp_path, mode)
    prim = field(bake.run())
    frames = bake.frames[PATH]
    coming = going = 0
    for before, after in itertools.pairwise(frames):
        found = schema.fetch(prim, before.time + 0.5)
        old, new = rows(before.cloud, found), rows(after.cloud, found)
        both = np.intersect1d(before.cloud.ids, after.cloud.ids)
        here = [np.searchsorted(ids, both) for ids in (before.cloud.ids, after.cloud.ids)]
        at = np.searchsorted(found.ids, both)
        expected = (before.cloud.positions[here[0]] + after.cloud.positions[here[1]]) / 2
        np.testing.assert_allclose(found.positions[at], expected, atol=2e-6)
        shade = (before.cloud.opacities[here[0]] + after.cloud.opacities[here[1]]) / 2
        close = 1 / 500 if mode == "packed" else 5e-5  # BEFORE an epoch is 3e-5 early
        np.testing.assert_allclose(found.opacities[at], shade, atol=close)
        gone = ~np.isin(before.cloud.ids, both)
        np.testing.assert_allclose(
            found.opacities[old[gone]], before.cloud.opacities[gone] / 2, atol=close
        )
        born = ~np.isin(after.cloud.ids, both)
        place = new[born]
        np.testing.assert_allclose(
            found.opacities[place], after.cloud.opacities[born] / 2, atol=close
        )
        np.testing.assert_array_equal(found.positions[place], after.cloud.positions[born])
        coming, going = coming + born.sum(), going + gone.sum()
    assert coming
    assert going


@pytest.mark.parametrize("velocities", [True, False])
def test_velocities_lead_to_the_next_frame(tmp_path: Path, velocities: bool) -> None:
    """Oracle: the forward difference; the solver's after the last frame. Without them a capture's
    own are silent."""
    stage = save_stage(tmp_path, {PATH: cloud(0, n=12, degree=1)})
    prim = stage.GetPrimAtPath(PATH)
    prim.CreateAttribute(tokens.VELOCITIES, Sdf.ValueTypeNames.Vector3fArray).Set(
        Vt.Vec3fArray(12, (9, 9, 9))
    )
    stage.Save()
    found = shot(tmp_path, stage=stage, lives=False, velocities=velocities)
    prim = field(found.run())
    attribute = prim.GetAttribute(tokens.VELOCITIES)
    if not velocities:
        assert attribute.Get(1.0) is None
        return
    frames = found.frames[PATH]
    for before, after in itertools.pairwise(frames):
        speeds = np.asarray(attribute.Get(before.time))
        difference = (after.cloud.positions - before.cloud.positions) * 24
        np.testing.assert_allclose(speeds, difference, rtol=1e-6, atol=1e-5)
    np.testing.assert_array_equal(attribute.Get(frames[-1].time), frames[-1].cloud.velocities)
    assert not len(attribute.Get(99.0))


def test_what_does_not_change_gets_no_opinion(tmp_path: Path) -> None:
    """Oracle: the names in the layer; a fixed population needs no second sample where epochs
    meet."""
    bake = shot(tmp_path, lives=False, writes=frozenset({"positions"}), pattern=True)
    bake.run()
    layer = layer_of(tmp_path / "bake_data" / "samples.usdc")
    prim = layer.GetPrimAtPath(PATH)
    assert prim.specifier == Sdf.SpecifierOver
    assert set(prim.properties.keys()) == {
        "positions", "velocities", "extent", "ids", "primvars:splatSim:u", "primvars:splatSim:v",
    }  # fmt: skip
    assert layer.ListTimeSamplesForPath(f"{PATH}.positions") == bake.times
    starts = bake.times[::4]
    assert layer.ListTimeSamplesForPath(f"{PATH}.ids") == starts
    for time in starts:
        np.testing.assert_array_equal(layer.QueryTimeSample(f"{PATH}.ids", time), np.arange(12))
    one = layer.QueryTimeSample(f"{PATH}.primvars:splatSim:u", 1.0)
    np.testing.assert_array_equal(one, bake.frames[PATH][0].uv[:, 0])


def test_counts_change_between_epochs_alone(tmp_path: Path) -> None:
    """Oracle: the rule: as many splats, in one order, at all samples of an epoch, and at one just
    before the next, which has that one's values, those that are born there included."""
    bake = shot(tmp_path)
    bake.run()
    layer = layer_of(tmp_path / "bake_data" / "samples.usdc")
    times = layer.ListTimeSamplesForPath(f"{PATH}.positions")
    starts = bake.times[::4]
    assert times == sorted([*bake.times, *(time - BEFORE for time in starts[1:])])
    for start in starts:
        inside = [time for time in times if start <= time < start + 4]
        alive = [f.cloud.ids for f in bake.frames[PATH] if start <= f.time <= start + 4]
        for name in ("positions", "opacities", "velocities", "orientations", "scales"):
            values = [layer.QueryTimeSample(f"{PATH}.{name}", time) for time in inside]
            assert {len(value) for value in values} == {len(np.unique(np.concatenate(alive)))}
        if start + 4 in starts:
            ids = np.asarray(layer.QueryTimeSample(f"{PATH}.ids", inside[-1]))
            last = np.asarray(layer.QueryTimeSample(f"{PATH}.positions", inside[-1]))
            after = next(f.cloud for f in bake.frames[PATH] if f.time == start + 4)
            np.testing.assert_array_equal(last[np.searchsorted(ids, after.ids)], after.positions)


def test_the_unborn_wait_where_they_are_born(tmp_path: Path) -> None:
    """Oracle: their first frame."""
    bake = shot(tmp_path)
    prim = field(bake.run())
    first = bake.frames[PATH][3].cloud  # two are born at frame 4, of the epoch 1 to 4
    found = schema.fetch(prim, 1.0)
    new = np.isin(found.ids, first.ids[-2:])
    np.testing.assert_array_equal(found.positions[new], first.positions[-2:])
    np.testing.assert_array_equal(found.sh[new], first.sh[-2:])
    assert np.all(found.scales[new] == UNBORN_SCALE)
    assert not found.opacities[new].any()
    assert not found.velocities[new].any()


@pytest.mark.parametrize("mode", ["dense", "clips", "packed", "edit"])
def test_muting_the_results_gives_the_capture_back(tmp_path: Path, mode: str) -> None:
    """Oracle: every bit of every attribute of the stage, and the bytes of its files."""
    bake = shot(tmp_path, mode, lives=mode != "edit")
    source = tmp_path / "shot.usda"
    bytes_before, said = source.read_bytes(), everything(source)
    bake.run()
    assert source.read_bytes() == bytes_before
    stage = Usd.Stage.Open(str(bake.target))
    assert everything(bake.target) != said
    results = Sdf.ComputeAssetPathRelativeToLayer(
        stage.GetRootLayer(), stage.GetRootLayer().subLayerPaths[0]
    )
    stage.MuteLayer(results)
    muted = tmp_path / "muted.usda"
    for prim in stage.TraverseAll():
        path = str(prim.GetPath())
        assert prim.GetTypeName() == said[path][0]
        for attribute in prim.GetAttributes():
            assert not attribute.GetNumTimeSamples()
    stage.GetRootLayer().subLayerPaths.remove(stage.GetRootLayer().subLayerPaths[0])
    stage.GetRootLayer().GetPrimAtPath(PATH).ClearInfo("customData")
    stage.Export(str(muted))
    flat = tmp_path / "flat.usda"
    Usd.Stage.Open(str(source)).Export(str(flat))
    assert everything(muted) == everything(flat) == said


def test_layers_of_text_are_small(tmp_path: Path) -> None:
    """Oracle: their sizes, for more splats than they have bytes."""
    bake = shot(tmp_path, "clips", lives=False, n=10_000, count=5)
    for file in (bake.run(), *(tmp_path / "bake_data").glob("*.usda")):
        assert file.stat().st_size < 5000


def test_nothing_but_overs_lies_over_the_capture(tmp_path: Path) -> None:
    """Oracle: the specifiers of the result layer."""
    bake = shot(tmp_path)
    bake.run()
    for file in (bake.target, tmp_path / "bake_data" / "samples.usdc"):
        layer = layer_of(file)
        for path in ("/World", PATH):
            assert layer.GetPrimAtPath(path).specifier == Sdf.SpecifierOver
            assert not layer.GetPrimAtPath(path).typeName


def test_the_extent_holds_splats_at_all_times(tmp_path: Path) -> None:
    """Oracle: ellipsoids of REACH standard deviations from the covariances, at samples and between
    them, of splats that turn by a right angle a frame."""
    bake = shot(tmp_path, spin=1.5)
    prim = field(bake.run())
    for time in np.arange(1, 14, 0.25):
        found = schema.fetch(prim, float(time))
        seen = found.opacities > 0
        deviations = np.sqrt(np.einsum("nii->ni", _matrices(found)))
        low, high = np.asarray(prim.GetAttribute("extent").Get(float(time)))
        assert (found.positions - REACH * deviations >= low - 1e-5)[seen].all()
        assert (found.positions + REACH * deviations <= high + 1e-5)[seen].all()


def _matrices(found: SplatCloud) -> np.ndarray:
    axes = quaternion.to_matrix(found.rotations.astype(np.float64)) * found.scales[:, None, :]
    return axes @ np.swapaxes(axes, 1, 2)


def test_several_fields_wherever_they_are(tmp_path: Path) -> None:
    """Oracle: each solver's arrays, for fields in a group, in a reference and with a variant."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    schema.author(asset, "/Asset/Scan", cloud(3, n=12, degree=1))
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Asset"))
    asset.Save()
    stage = save_stage(tmp_path, {"/World/Deep/Down/Splats": cloud(4, n=12, degree=0)})
    stage.DefinePrim("/World/Ref").GetReferences().AddReference("./asset.usda")
    varied = stage.DefinePrim("/World/Varied")
    variants = varied.GetVariantSets().AddVariantSet("look")
    variants.AddVariant("a")
    variants.SetVariantSelection("a")
    with variants.GetVariantEditContext():
        schema.author(stage, "/World/Varied/Splats", cloud(5, n=12, degree=2))
    stage.Save()
    paths = ("/World/Deep/Down/Splats", "/World/Ref/Scan", "/World/Varied/Splats")
    bake = shot(tmp_path, stage=stage, paths=paths)
    target = bake.run()
    for path in paths:
        prim = field(target, path)
        for frame in bake.frames[path]:
            found = schema.fetch(prim, frame.time)
            at = rows(frame.cloud, found)
            for name in ARRAYS:
                np.testing.assert_array_equal(getattr(found, name)[at], getattr(frame.cloud, name))


def test_the_stage_says_what_it_said(tmp_path: Path) -> None:
    """Oracle: the source's metadata; the range is wide enough for the frames."""
    bake = shot(tmp_path)
    stage = Usd.Stage.Open(str(bake.run()))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert stage.GetTimeCodesPerSecond() == 24
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 14)
    prim = stage.GetPrimAtPath(PATH)
    for record in (
        stage.GetRootLayer().customLayerData["usdsplat"]["bake"],
        prim.GetCustomDataByKey("usdsplat:bake"),
    ):
        assert record["completedFrames"] == 14
        assert record["checkpoint"] == ""
        assert len(record["paramHash"]) == 64
        assert record["inputHash"][0].endswith("  shot.usda")
    assert bake.target.stat().st_size < 5000
    leftovers = {path.name for path in (tmp_path / "bake_data").iterdir()}
    assert leftovers == {"samples.usdc", "kept_checkpoint"}
