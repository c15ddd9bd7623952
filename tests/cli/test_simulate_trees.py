"""Tests of `usdsplat simulate` on splat trees: the cut, its bake, and what is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.cli.conftest import ball, passing_sphere
from tests.trees import little_tree
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.tree_reading import TreeChoice, tree_reading
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.lod_root_authoring import author_lod_root
from usdsplat.sim.stage.authoring import author

TREE = "/tree/splats"
ARRAYS = ("positions", "scales", "rotations", "opacities", "sh")
FRAMES = ("--frames", "1:3")


def with_simulation(stage: Usd.Stage, **parameters: str) -> None:
    """Add a SplatSim prim, and a ball that passes, and save."""
    author(stage.DefinePrim("/tree/Sim", "SplatSim"), {"bake:checkpointEvery": 2} | parameters)
    sphere = passing_sphere(stage, "/tree/Sphere")
    UsdGeom.Imageable(sphere).MakeInvisible()
    UsdGeom.Camera.Define(stage, "/Camera").AddTranslateOp().Set((0, 0, 4))
    stage.Save()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A stage with a simulated tree of 200 splats."""
    path = little_tree(tmp_path, ball(200))
    with_simulation(Usd.Stage.Open(str(path)))
    return path


def cut_as_field(tree: Path, choice: TreeChoice) -> Path:
    """The same stage with a cut as a field in place of the tree, as an export reads it."""
    source = Usd.Stage.Open(str(tree))
    reading = tree_reading(source.GetPrimAtPath(TREE), choice)
    path = tree.with_name("field.usda")
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(stage.DefinePrim("/tree", "Xform"))
    hints = schema.DrawingHints(rasterize_mode=reading.rasterize_mode)
    schema.author(stage, TREE, reading.cloud(), drawing=hints)
    with_simulation(stage)
    return path


def fetched(path: Path, frame: float) -> SplatCloud:
    """The splats of a frame."""
    stage = Usd.Stage.Open(str(path))
    return schema.fetch(stage.GetPrimAtPath(TREE), frame)


def picture(path: Path, frame: float) -> np.ndarray:
    """The colour of a frame."""
    with Engine(Usd.Stage.Open(str(path)), device="cpu", time=frame) as engine:
        view = engine.view("/Camera", resolution=(64, 48))
        return engine.picture(view, RenderSettings(), ("color",))["color"].copy()


def baked(run, path: Path, *flags: str) -> Path:
    """The bake of a stage."""
    target = path.with_name(f"{path.stem}_bake.usda")
    status, _, err = run("simulate", path, "-o", target, *FRAMES, "--device", "cpu", *flags)
    assert status == 0, err
    return target


@pytest.mark.parametrize(
    ("flags", "choice"),
    [
        (("--lod", "0"), TreeChoice()),
        (("--lod", "1"), TreeChoice(level=1)),
        (("--max-splats", "150"), TreeChoice(max_splats=150)),
        ((), TreeChoice()),
    ],
)
def test_the_bake_of_a_cut_is_that_of_a_field_and_drawn_in_its_place(run, tree, flags, choice):
    """Oracle: a field with the splats that an export of the cut reads, simulated and drawn; arrays
    and pictures bit for bit."""
    field = cut_as_field(tree, choice)
    ours, theirs = baked(run, tree, *flags), baked(run, field)
    for frame in (1, 2, 3):
        one, other = fetched(ours, frame), fetched(theirs, frame)
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        np.testing.assert_array_equal(picture(ours, frame), picture(theirs, frame))
    assert (picture(ours, 1) != picture(ours, 3)).any()


def test_a_packed_bake_is_drawn_in_place_of_the_tree(run, tree):
    """Oracle: the bake of the field of the same splats."""
    for path in (tree, cut_as_field(tree, TreeChoice())):
        layer = Sdf.Layer.FindOrOpen(str(path))
        mode = Sdf.AttributeSpec(
            layer.GetPrimAtPath("/tree/Sim"), "splatSim:bake:mode", Sdf.ValueTypeNames.Token
        )
        mode.default = "packed"
        layer.Save()
    ours, theirs = baked(run, tree, "--lod", "0"), baked(run, tree.with_name("field.usda"))
    stage = Usd.Stage.Open(str(ours))
    assert schema.is_packed(stage.GetPrimAtPath(TREE))
    np.testing.assert_array_equal(picture(ours, 3), picture(theirs, 3))


def test_the_lod_root_of_a_tree_is_hidden_and_the_tree_returns_with_a_muted_bake(run, tree):
    """Oracle: the bake without an LOD root; muting the layer of results shows the stage as it
    was."""
    stage = Usd.Stage.Open(str(tree))
    fields = [ball(20)]
    hints = schema.DrawingHints()
    prim = stage.GetPrimAtPath(TREE)
    target = baked(run, tree)
    plain = picture(target, 2)
    author_lod_root(stage, "/tree/coarse", fields, thresholds=[], drawing=hints, tree=prim)
    stage.Save()
    before = picture(tree, 2)
    target = baked(run, tree, "--force")
    np.testing.assert_array_equal(picture(target, 2), plain)
    samples = Sdf.Layer.FindOrOpen(str(tree.parent / "tree_bake_data" / "samples.usdc"))
    assert not samples.GetPrimAtPath("/tree/coarse/lod0")  # its items are not simulated
    result = Usd.Stage.Open(str(target))
    root = UsdGeom.Imageable(result.GetPrimAtPath("/tree/coarse"))
    assert root.ComputeVisibility() == UsdGeom.Tokens.invisible
    result.MuteLayer(samples.identifier)
    assert schema.is_tree(result.GetPrimAtPath(TREE))
    with Engine(result, device="cpu", time=2) as engine:
        view = engine.view("/Camera", resolution=(64, 48))
        found = engine.picture(view, RenderSettings(), ("color",))["color"]
        np.testing.assert_array_equal(found, before)


def test_a_bake_is_resumed_with_the_same_cut_and_chunks_only(run, tree):
    """Oracle: by hand: another cut is another parameter; a changed chunk is another input."""
    target = baked(run, tree, "--lod", "1")
    words = ("simulate", tree, "-o", target, *FRAMES, "--resume", "--device", "cpu")
    status, _, err = run(*words, "--lod", "2")
    assert status == 2 and "/tree/Sim.splatSim:sim:treeLevel" in err
    assert run(*words, "--lod", "1")[0] == 0
    chunk = tree.parent / "tree_chunks" / "0001.usdc"
    chunk.write_bytes(chunk.read_bytes() + b"0")
    status, _, err = run(*words, "--lod", "1")
    assert status == 2 and "tree_chunks/0001.usdc" in err


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--lod", "3"), "/tree/splats, splatSim:sim:treeLevel: found level 3, expected 0 to 2"),
        (("--lod", "-1"), "--lod: found -1, expected a level, 0 the finest"),
        (("--max-splats", "0"), "--max-splats: found 0, expected at least 1"),
        (("--max-splats", "3"), "/tree/splats: found 14 splats at its coarsest level"),
        (("--lod", "1", "--max-splats", "9"), "--lod"),
        (("--set", "bake:mode=edit"), "found a splat tree, expected a stock field"),
    ],
)
def test_a_cut_that_cannot_be_had_is_one_sentence(run, tree, flags, said):
    """Oracle: by hand; nothing is written."""
    target = tree.with_name("bake.usda")
    status, out, err = run("simulate", tree, "-o", target, *FRAMES, *flags)
    assert (status, out) == (2, "") and said in err and err.count("\n") == 1, err
    assert not target.exists()


def test_a_cut_of_a_stage_without_a_tree_is_one_sentence(run, tree):
    """Oracle: by hand."""
    field = cut_as_field(tree, TreeChoice())
    for flag in ("--lod", "--max-splats"):
        status, _, err = run("simulate", field, "-o", tree.with_name("b.usda"), *FRAMES, flag, "1")
        said = f"{flag}: found a stage without a simulated splat tree, expected one with a tree"
        assert (status, err) == (2, f"usdsplat: {said}\n")


def test_a_missing_chunk_is_one_sentence_and_validate_says_the_same(run, tree):
    """Oracle: by hand."""
    (tree.parent / "tree_chunks" / "0002.usdc").unlink()
    target = tree.with_name("bake.usda")
    status, _, err = run("simulate", tree, "-o", target, *FRAMES)
    assert status == 2 and "without 0002.usdc in ./tree_chunks" in err.splitlines()[-1]
    status, out, _ = run("validate", tree)
    assert status == 1 and "[not-simulated]" in out


def test_a_preset_is_made_for_a_tree(run, tmp_path):
    """Oracle: the simulation runs, and its result has the splats of the leaves."""
    source = little_tree(tmp_path, ball(200))
    made = tmp_path / "made.usda"
    status, _, err = run("simulate", "--preset", "push", source, "-o", made)
    assert status == 0, err
    target = baked(run, made)
    assert len(fetched(target, 2)) == 200
